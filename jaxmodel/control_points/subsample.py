"""Control points by plain subsampling (MISSION control points C): every one is a measured point.

``voxel_subsample`` spreads points evenly and follows the surface whatever the scan's density: the default.
``random_subsample`` keeps the scan's density. ``farthest_point_subsample`` gives the widest spread of the three,
reaches the rims and thin parts, and takes time proportional to ``count * n``.
All three return sorted, distinct indices, and all of them when ``count >= n``.
"""

import jax
import numpy as np
from jaxtyping import Float, Int, PRNGKeyArray

from jaxmodel.errors import InputError
from jaxmodel.geometry.voxel_grid import VoxelGrid

_BISECTIONS = 40
_FINEST = 2**20  # cells along the cloud's longest side: their keys still fit in 64 bits


def voxel_subsample(points: Float[np.ndarray, "n 3"], count: int, exact: bool = True) -> Int[np.ndarray, " m"]:
    """Indices of one point for each occupied voxel: the one nearest to the mean of the voxel's points.

    The edge of the voxels is found by bisection, so the cells are as large as the count allows.

    Args:
        points: ``(n, 3)``, any frame and unit, finite.
        count: how many points are wanted, at least 1.
        exact: give exactly ``count`` points. The grid has then at least as many occupied voxels as asked, and those
            holding the fewest points (partly filled, at rims) are left out. Otherwise the nearest count found.

    Raises:
        InputError: ``count`` is below 1 or a coordinate is not finite.
    """
    points = _checked(points, count)
    n = len(points)
    if count >= n:
        return np.arange(n)
    high = 1.01 * float(np.ptp(points, axis=0).max())  # the farthest point then shares the last cell
    low = high / _FINEST
    best: np.ndarray | None = None
    for _ in range(_BISECTIONS):
        edge = 0.5 * (low + high)
        found = _occupied(points, edge)
        enough = int(found.max()) + 1
        if enough >= count:
            low = edge
        else:
            high = edge
        if _closer(enough, best, count, exact):
            best = found
        if enough == count:
            break
    if best is None:  # fewer distinct places than asked
        best = _occupied(points, low)
    chosen, members = _nearest_to_means(points, best)
    if not exact:
        return np.sort(chosen)
    if len(chosen) >= count:
        order = np.lexsort((chosen, -members))
        return np.sort(chosen[order[:count]])
    rest = np.setdiff1d(np.arange(n), chosen)
    extra = rest[np.linspace(0, len(rest) - 1, count - len(chosen)).round().astype(int)]
    return np.sort(np.concatenate([chosen, extra]))


def random_subsample(points: Float[np.ndarray, "n 3"], count: int, key: PRNGKeyArray) -> Int[np.ndarray, " m"]:
    """Indices of ``count`` points drawn without replacement. With the same key a smaller draw is part of a larger one.

    Args:
        points: ``(n, 3)``, any frame and unit, finite.
        count: how many points are wanted, at least 1.
        key: ``jax.random.key(...)``; the draw depends on it and on n alone.

    Raises:
        InputError: ``count`` is below 1 or a coordinate is not finite.
    """
    n = len(_checked(points, count))
    words = np.asarray(jax.random.key_data(key)).ravel().tolist()
    return np.sort(np.random.default_rng(words).permutation(n)[:count])


def farthest_point_subsample(points: Float[np.ndarray, "n 3"], count: int) -> Int[np.ndarray, " m"]:
    """Indices of ``count`` points, each the farthest from those before it; the first is farthest from the centroid.

    No two chosen points are closer to each other than any point is to its nearest chosen one (Gonzalez 1985).

    Args:
        points: ``(n, 3)``, any frame and unit, finite.
        count: how many points are wanted, at least 1.

    Raises:
        InputError: ``count`` is below 1 or a coordinate is not finite.
    """
    points = _checked(points, count)
    n = len(points)
    if count >= n:
        return np.arange(n)
    x, y, z = np.ascontiguousarray((points - points.mean(axis=0)).T)
    squared = np.full(n, np.inf)
    chosen = np.empty(count, dtype=np.int64)
    newest = int(np.argmax(x * x + y * y + z * z))
    for step in range(count):
        chosen[step] = newest
        np.minimum(squared, (x - x[newest]) ** 2 + (y - y[newest]) ** 2 + (z - z[newest]) ** 2, out=squared)
        squared[newest] = -1.0  # never twice, also among coincident points
        newest = int(np.argmax(squared))
    return np.sort(chosen)


def _checked(points: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "n 3"]:
    if count < 1:
        raise InputError(f"count is {count}, expected at least 1 control point")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise InputError(f"point {int(np.argmax(bad))} is not finite, expected finite coordinates")
    return np.asarray(points, dtype=np.float64)


def _occupied(points: Float[np.ndarray, "n 3"], edge: float) -> Int[np.ndarray, " n"]:
    """Number of the occupied voxel each point lies in, counted from 0; all in one where the points coincide."""
    if not edge > 0:
        return np.zeros(len(points), dtype=np.int64)
    origin = points.min(axis=0)
    i, j, k = np.floor((points.max(axis=0) - origin) / edge).astype(int).tolist()
    grid = VoxelGrid(origin, edge, (i + 1, j + 1, k + 1))
    return np.unique(grid.keys(grid.indices(points)), return_inverse=True)[1]


def _closer(found: int, best: np.ndarray | None, count: int, exact: bool) -> bool:
    """Whether a grid with ``found`` occupied voxels is the better one; an exact count needs at least ``count``."""
    if exact and found < count:
        return False
    return best is None or abs(found - count) < abs(int(best.max()) + 1 - count)


def _nearest_to_means(
    points: Float[np.ndarray, "n 3"], voxels: Int[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " v"], Int[np.ndarray, " v"]]:
    """For each voxel the index of the point nearest to its mean (lowest index on a tie), and its number of points."""
    members = np.bincount(voxels)
    means = np.stack([np.bincount(voxels, weights=axis) for axis in points.T], axis=1) / members[:, None]
    squared = ((points - means[voxels]) ** 2).sum(axis=1)
    order = np.lexsort((squared, voxels))  # stable: the index decides a tie
    first = np.concatenate([[0], np.cumsum(members)[:-1]])
    return order[first], members
