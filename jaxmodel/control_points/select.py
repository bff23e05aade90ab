"""Which points drive a registration: the options as they stand in a configuration, and the selection itself."""

from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Float

from jaxmodel.control_points.decimate import mesh_control_points
from jaxmodel.control_points.subsample import farthest_point_subsample, random_subsample, voxel_subsample
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.range_image import RangeImage


@dataclass(frozen=True)
class Subsample:
    """Measured points spread over the scan (see ``subsample.py`` for when to prefer which)."""

    kind: Literal["subsample"] = "subsample"
    count: int = 2000
    how: Literal["voxel", "random", "farthest"] = "voxel"

    def __post_init__(self) -> None:
        _check_count(self.count)
        _check_word("how", self.how, ("voxel", "random", "farthest"))


@dataclass(frozen=True)
class Vertices:
    """Vertices, or triangle centres, of the decimated range image (see ``decimate.py``)."""

    kind: Literal["vertices"] = "vertices"
    count: int = 2000
    at: Literal["vertices", "centres"] = "vertices"
    snap: bool = True

    def __post_init__(self) -> None:
        _check_count(self.count)
        _check_word("at", self.at, ("vertices", "centres"))


ControlPoints = Subsample | Vertices


def select(scan: RangeImage | Cloud | Float[np.ndarray, "n 3"], options: ControlPoints, seed: int = 0) -> Cloud:
    """Control points of a scan: measured points that stand for it in a registration (thesis §2.4).

    Args:
        scan: range image, cloud or ``(n, 3)`` array, sensor frame.
        options: which kind and how many. Subsampling gives exactly the count, mesh vertices come within 2 % of it;
            a scan with fewer points gives all it has.
        seed: of the random draw; the other kinds do not depend on it.

    Returns:
        Cloud in the scan's frame, with the normals and border flags the scan has (a range image has both).

    Raises:
        InputError: the scan is not a valid cloud, or mesh vertices are asked of a scan without a grid.
    """
    if isinstance(options, Vertices):
        if not isinstance(scan, RangeImage):
            raise InputError(
                "mesh vertices need a range image or mesh, and this cloud has no grid: use the kind subsample"
            )
        return mesh_control_points(scan, options.count, at=options.at, snap=options.snap)
    cloud = as_cloud(scan)
    if options.how == "voxel":
        kept = voxel_subsample(cloud.points, options.count)
    elif options.how == "random":
        kept = random_subsample(cloud.points, options.count, jax.random.key(seed))
    else:
        kept = farthest_point_subsample(cloud.points, options.count)
    return cloud.take(kept)


def _check_count(count: int) -> None:
    if count < 3:
        raise InputError(f"count is {count}, expected at least 3 points to fit a motion to")


def _check_word(key: str, word: str, allowed: tuple[str, ...]) -> None:
    if word not in allowed:
        raise InputError(f"{key} is '{word}', expected one of {', '.join(allowed)}")
