"""A cloud of points on the host: positions, and where the scan gave them, normals and border flags."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from jaxmodel.errors import InputError


class Cloud(eqx.Module):
    """Points in one frame, in the unit of the data.

    ``points (n, 3)``; ``normals (n, 3)`` unit, towards the sensor, or None; ``border (n,)`` True where the point
    lies beside a place without reading, the image edge or a depth jump, or None where the scan had no grid.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"] | None = None
    border: Bool[np.ndarray, " n"] | None = None

    def __len__(self) -> int:
        return self.points.shape[0]

    def take(self, indices: np.ndarray) -> "Cloud":
        """The rows ``indices`` (integers or a mask), normals and border flags carried along."""
        return Cloud(
            points=self.points[indices],
            normals=None if self.normals is None else self.normals[indices],
            border=None if self.border is None else self.border[indices],
        )

    def moved(self, T_a_b: Float[np.ndarray, "4 4"]) -> "Cloud":
        """The same cloud (in frame b) expressed in frame a: points moved, normals turned."""
        R = T_a_b[:3, :3]
        return Cloud(
            points=self.points @ R.T + T_a_b[:3, 3],
            normals=None if self.normals is None else self.normals @ R.T,
            border=self.border,
        )


def resolution(points: Float[np.ndarray, "n 3"]) -> float:
    """Median distance from a point to its nearest neighbour, in the unit of the data.

    Coincident points are merged first, so a repeated point does not pull the figure to zero. Raises
    :class:`InputError` with fewer than two distinct points.
    """
    distinct = np.unique(points, axis=0)
    if len(distinct) < 2:
        raise InputError(f"The resolution of a cloud needs two distinct points, got {len(distinct)}.")
    distance, _ = KDTree(distinct).query(distinct, k=2)
    return float(np.median(distance[:, 1]))


def check_points(points: object, what: str = "the cloud") -> np.ndarray:
    """``points`` as a float array (n, 3), or :class:`InputError` naming ``what`` and what is wrong.

    Refused: another shape, a NaN or infinite row (named), fewer than three points, all points equal.
    """
    try:
        array = np.asarray(points)
    except ValueError as error:
        raise InputError(f"{what} is not an array of points (n, 3): {error}.") from error
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise InputError(f"{what}: expected numbers of shape (n, 3), found {array.dtype} of shape {array.shape}.")
    if array.dtype.kind != "f":
        array = array.astype(np.float64)
    if len(array) == 0:
        raise InputError(f"{what} is empty: expected at least 3 points.")
    if len(array) < 3:
        plural = "" if len(array) == 1 else "s"
        raise InputError(f"{what} has only {len(array)} point{plural}: expected at least 3.")
    bad = ~np.isfinite(array).all(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        raise InputError(
            f"{what}: point {row} (counted from 0) is {array[row].tolist()}, expected finite numbers; "
            f"{int(bad.sum())} of {len(array)} points are not."
        )
    if (array == array[0]).all():
        raise InputError(f"{what}: all {len(array)} points are equal, so it has no extent.")
    return array


def as_cloud(scan: object, what: str = "the cloud") -> Cloud:
    """Any scan as a checked :class:`Cloud`, in the frame it came in.

    ``scan`` is a :class:`Cloud`, a :class:`jaxmodel.scan.range_image.RangeImage` (its valid pixels, row-major,
    with normals and borders) or an array (n, 3). ``what`` names it in messages. Raises :class:`InputError` for
    NaN or infinite points (row named), fewer than three, all equal, or another shape.
    """
    from jaxmodel.scan.range_image import RangeImage, to_cloud

    if isinstance(scan, RangeImage):
        check_points(scan.points[scan.valid], what)
        return to_cloud(scan)
    if isinstance(scan, Cloud):
        check_points(scan.points, what)
        return scan
    return Cloud(points=check_points(scan, what))
