"""Which points drive a registration: the options as they stand in a configuration, and the selection itself."""

from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Float

from jaxmodel.control_points.contour_points import contour_control_points
from jaxmodel.control_points.decimate import mesh_control_points
from jaxmodel.control_points.edges import EdgeKind
from jaxmodel.control_points.split_mesh import split_control_points
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


@dataclass(frozen=True)
class Contours:
    """Points on the 3D contours of the range image (see ``contours.py``).

    ``labels``: which edges. Creases alone, the default, suit free forms and cylinders; all three suit polyhedra. Where
    depth or border points are asked for, the border filter of the pairing finds no border to drop.
    """

    kind: Literal["contours"] = "contours"
    count: int = 2000
    labels: tuple[Literal["crease", "depth", "border"], ...] = ("crease",)

    @property
    def kinds(self) -> list[EdgeKind]:
        """The labels as kinds of edges."""
        return [EdgeKind[label.upper()] for label in self.labels]

    def __post_init__(self) -> None:
        _check_count(self.count)
        if not self.labels:
            raise InputError("labels is empty, expected at least one of crease, depth, border")
        for label in self.labels:
            _check_word("labels", label, ("crease", "depth", "border"))
        if len(set(self.labels)) < len(self.labels):
            raise InputError(f"labels names one kind of edge twice, expected each once: {', '.join(self.labels)}")


@dataclass(frozen=True)
class SplitVertices:
    """Vertices, or triangle centres, of the split mesh of the range image (see ``split_mesh.py``).

    ``contours``: the contours of the image are edges of the mesh.
    """

    kind: Literal["split_vertices"] = "split_vertices"
    count: int = 2000
    at: Literal["vertices", "centres"] = "vertices"
    contours: bool = True

    def __post_init__(self) -> None:
        _check_count(self.count)
        _check_word("at", self.at, ("vertices", "centres"))


ControlPoints = Subsample | Vertices | Contours | SplitVertices


def select(scan: RangeImage | Cloud | Float[np.ndarray, "n 3"], options: ControlPoints, seed: int = 0) -> Cloud:
    """Control points of a scan: measured points that stand for it in a registration (thesis §2.4).

    Args:
        scan: range image, cloud or ``(n, 3)`` array, sensor frame.
        options: which kind and how many. Subsampling and contours give exactly the count, vertices come within 2 % of
            it, those of the split mesh within 5 %; a scan with fewer points gives all it has.
        seed: of the random draw; the other kinds do not depend on it.

    Returns:
        Cloud in the scan's frame, with the normals and border flags the scan has (a range image has both).

    Raises:
        InputError: the scan is not a valid cloud, another kind than subsample is asked of a scan without a grid, or
            contours of a scan without edges.
    """
    if not isinstance(options, Subsample):
        if not isinstance(scan, RangeImage):
            what = "contours" if isinstance(options, Contours) else "mesh vertices"
            raise InputError(f"{what} need a range image or mesh, and this cloud has no grid: use the kind subsample")
        if isinstance(options, Vertices):
            return mesh_control_points(scan, options.count, at=options.at, snap=options.snap)
        if isinstance(options, SplitVertices):
            return split_control_points(scan, options.count, at=options.at, contours=options.contours)
        return contour_control_points(scan, options.count, options.kinds)
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
