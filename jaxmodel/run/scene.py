"""``scene.npz``: the few small arrays the pictures need beyond the table, so that ``jaxmodel report`` can redraw them.

For pair p: ``p{p}_target``, ``p{p}_source`` (thinned points, each in its own frame), ``p{p}_directions`` (where each
start puts the source's sensor, target frame), and for its kind k ``p{p}k{k}_before`` and ``_after`` (T_target_source
of the best start and of its result), ``_error``, ``_shared_rate``, ``_strategy`` (iteration by iteration).
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxmodel.control_points import voxel_subsample
from jaxmodel.errors import InputError
from jaxmodel.register import register_trace
from jaxmodel.register.method import IcpMethod
from jaxmodel.run.cases import Case
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.range_image import RangeImage

MOST_PAIRS = 12
"""Pairs that get pictures; a larger experiment shows its first ones."""
_MOST_POINTS = 2500


def make_scene(cases: Sequence[Case], method: IcpMethod, best: Sequence[int], poses: Sequence[np.ndarray]) -> bytes:
    """The content of ``scene.npz``; the best start of each case is run once more, keeping its trace.

    Args:
        cases: all cases of the experiment, pairs in order.
        method: of the sweep.
        best: the best start of each case.
        poses: T_target_source that each best start led to.
    """
    pairs: dict[str, int] = {}
    kinds: dict[str, int] = {}
    arrays: dict[str, np.ndarray] = {}
    for case, start, pose in zip(cases, best, poses, strict=True):
        name = case.pair.name
        if name not in pairs and len(pairs) == MOST_PAIRS:
            break
        if name not in pairs:
            pairs[name] = number = len(pairs)
            arrays[f"p{number}_target"] = _thin(as_cloud(case.pair.target).points)
            arrays[f"p{number}_source"] = _thin(as_cloud(case.pair.source).points)
            arrays[f"p{number}_directions"] = sensor_directions(case).astype(np.float32)
        kind = f"p{pairs[name]}k{kinds.setdefault(case.control_points, len(kinds))}"
        _, trace = register_trace(case.target, case.source, init=case.starts[start], method=method)
        arrays[f"{kind}_before"] = case.starts[start]
        arrays[f"{kind}_after"] = np.asarray(pose, dtype=np.float64)
        for field in ("error", "shared_rate", "strategy"):
            arrays[f"{kind}_{field}"] = np.asarray(getattr(trace, field))
    arrays["pairs"], arrays["kinds"] = np.array(list(pairs)), np.array(list(kinds))
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # pyright: ignore[reportArgumentType]
    return buffer.getvalue()


def read_scene(path: Path) -> dict[str, np.ndarray]:
    """The arrays of ``scene.npz``; missing or broken is an ``InputError``."""
    try:
        with np.load(path, allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except FileNotFoundError:
        raise InputError(f"{path}: no such file, so {path.parent} holds no finished run") from None
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not readable as arrays ({error})") from None


def sensor_directions(case: Case) -> Float[np.ndarray, "s 3"]:
    """Unit vectors from the object to where each start puts the source's sensor, target frame.

    A cloud without a sensor is taken as seen from its own +z.
    """
    view = np.array([0.0, 0.0, 1.0])
    source: Any = case.pair.source
    if isinstance(source, RangeImage):
        view = source.eye[:3] - source.eye[3] * case.source_centroid
    elif not isinstance(source, Cloud):
        raise TypeError(type(source))
    length = np.linalg.norm(view)
    return case.starts[:, :3, :3] @ (view / length if length > 0 else np.array([0.0, 0.0, 1.0]))


def _thin(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    return points[voxel_subsample(points, min(_MOST_POINTS, len(points)))].astype(np.float32)
