"""Hand-eye pose files of any form: one file with both streams, two files, or a folder with a file for each pose."""

from pathlib import Path

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.io.hand_eye import read_pairs_storage, read_visp_pose
from jaxmodel.io.pose_tables import read_table
from jaxmodel.io.pose_trees import read_tree
from jaxmodel.io.pose_values import Forms, PoseStream, make_stream
from jaxmodel.io.text_files import read_text

TABLES = (".csv", ".txt", ".tsv", ".tum")
TREES = (".json", ".yaml", ".yml")
STREAM_ORDER = ("hand", "camera")
VISP = {"hand": "*pose_rPe_*.yaml", "camera": "*pose_cPo_*.yaml"}


def read_both(path: Path, forms: Forms) -> tuple[PoseStream, PoseStream]:
    """The hand's and the camera's poses from one file (or ViSP folder) that holds both.

    Raises :class:`InputError` where it holds a single stream, naming it.
    """
    found = _streams(path, forms, None)
    if len(found) != 2:
        raise InputError(
            f"{path}: holds one stream of poses; name the camera's file after it, give --images, or name the columns "
            "hand_x .. and camera_x .."
        )
    return found["hand"], found["camera"]


def read_single(path: Path, stream: str, forms: Forms) -> PoseStream:
    """The poses of ``stream`` (``hand`` or ``camera``) from a file of its own, or from one that holds both."""
    found = _streams(path, forms, "camera" if stream == "camera" else "hand")
    if stream not in found:
        raise InputError(f"{path}: holds the poses of the {next(iter(found))}, expected those of the {stream}")
    return found[stream]


def _streams(path: Path, forms: Forms, alone: str | None) -> dict[str, PoseStream]:
    """Streams by name; a stream without a name is that of ``alone`` (or the hand)."""
    if path.is_dir():
        return _visp(path)
    name: str = alone or "hand"
    suffix = path.suffix.lower()
    quaternion = forms.of("camera" if name == "camera" else "hand").quaternion
    if suffix in TABLES:
        columns, rows = read_table(path, quaternion)
        said = {column.stream for column in columns}
        names = [of for of in STREAM_ORDER if of in said] or [name]
        return {of: make_stream(path, columns, rows, of, forms.of(of)) for of in names}  # pyright: ignore
    if suffix in TREES:
        if suffix != ".json" and _is_opencv(path):
            pairs = read_pairs_storage(path)
            places = tuple(f"frame {k}" for k in range(len(pairs.hand)))
            return {of: PoseStream(path, (path,), poses, places) for of, poses in
                    (("hand", pairs.hand), ("camera", pairs.camera))}  # fmt: skip
        return {
            of or name: make_stream(path, *table, of or name, forms.of(of or name))  # pyright: ignore
            for of, table in read_tree(path, quaternion).items()
        }
    if not path.exists():
        raise InputError(f"There is no file {path}")
    raise InputError(f"{path}: unknown extension {path.suffix!r}, expected one of {', '.join((*TABLES, *TREES))}")


def _is_opencv(path: Path) -> bool:
    text = read_text(path)
    return text.startswith("%YAML:") or "!!opencv-matrix" in text


def _visp(folder: Path) -> dict[str, PoseStream]:
    """A folder of ViSP: ``*pose_rPe_N.yaml`` (T_base_hand) and, where there are such, ``*pose_cPo_N.yaml``."""
    found = {}
    for stream, pattern in VISP.items():
        files = sorted(folder.glob(pattern), key=natural)
        if files:
            poses = np.stack([read_visp_pose(file) for file in files])
            names = tuple(file.stem for file in files)
            found[stream] = PoseStream(folder, tuple(files), poses, tuple(file.name for file in files), images=names)
    if not found:
        raise InputError(f"{folder}: the folder holds no file named {VISP['hand']}, one for each pose of the hand")
    return found


def natural(path: Path) -> tuple[str, int]:
    """Sorts names by the number at their end, 2 before 10."""
    stem = path.stem.rstrip("0123456789")
    digits = path.stem[len(stem) :]
    return stem, int(digits) if digits else -1
