"""Flat regions of a mesh: triangles merged with their best neighbours as long as one plane fits both (thesis §3.3.2).

Rounds instead of a queue: every region names the neighbour it fits best, pairs that name each other become one
region, its sums are those of both (Attene et al., Hierarchical mesh segmentation, 2006). Nothing loops over triangles.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

LEVELS = (6.0, 20.0, 60.0, np.inf)
"""How much a merger may add to the squared plane error, in expected noise, in order: sure mergers come first."""
SINGLE, MANY = 10.0, 4.0
"""Largest mean squared distance from the common plane, in variances: of one triangle, of a large region."""
FACING = 0.3
"""Least cosine between the mean normals of two regions that merge."""
BLOCK = 8192
"""Mergers weighed at once: few enough that all their sums stay in the processor's cache."""
SECOND = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


class Moments(NamedTuple):
    """Sums over regions, each column one region: they add when regions merge.

    ``table`` rows: area, triangles, squared distance from the own plane, then sums by area of points (3), of products
    of coordinates (6: xx xy xz yy yz zz) and of normals (3).
    """

    table: Float[np.ndarray, "15 r"]


def face_moments(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], vectors: Float[np.ndarray, "m 3"]
) -> Moments:
    """The sums of single triangles, a third of the area at each corner; ``vectors`` are their normals times 2 area."""
    area = np.sqrt(np.einsum("ij,ij->i", vectors, vectors)) / 2
    area = np.maximum(area, 1e-12 * max(area.mean(), 1e-300))
    corners = [[vertices[faces[:, k], axis] for axis in range(3)] for k in range(3)]
    first = [sum(corner[axis] for corner in corners) * area / 3 for axis in range(3)]
    second = [sum(corner[a] * corner[b] for corner in corners) * area / 3 for a, b in SECOND]
    return Moments(np.stack([area, np.ones_like(area), np.zeros_like(area), *first, *second, *(vectors.T / 2)]))


def plane_of(table: Float[np.ndarray, "15 r"]) -> tuple[Float[np.ndarray, "3 r"], Float[np.ndarray, "3 r"]]:
    """Centre and unit normal of the plane of least squares of each region."""
    mean = table[3:6] / table[0]
    xx, xy, xz, yy, yz, zz = (table[6 + k] / table[0] - mean[a] * mean[b] for k, (a, b) in enumerate(SECOND))
    normal = _smallest(xx, xy, xz, yy, yz, zz)
    x, y, z = normal
    # the least eigenvalue is small against the others where a plane fits: one shift by it leaves nothing to see
    least = xx * x * x + yy * y * y + zz * z * z + 2 * (xy * x * y + xz * x * z + yz * y * z)
    return mean, _smallest(xx - least, xy, xz, yy - least, yz, zz - least)


def _smallest(xx, xy, xz, yy, yz, zz):
    """Unit eigenvector of the eigenvalue nearest zero: the longest column of the adjugate."""
    ax, ay, az = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    by, bz, cz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    use_a = (np.abs(ax) >= np.abs(by)) & (np.abs(ax) >= np.abs(cz))
    use_b = ~use_a & (np.abs(by) >= np.abs(cz))
    x = np.where(use_a, ax, np.where(use_b, ay, az))
    y = np.where(use_a, ay, np.where(use_b, by, bz))
    z = np.where(use_a, az, np.where(use_b, bz, cz))
    length = np.sqrt(x * x + y * y + z * z)
    nothing = length <= 1e-300
    length = np.where(nothing, 1.0, length)
    return np.stack([np.where(nothing, 1.0, x / length), y / length, z / length])


def mean_square(
    table: Float[np.ndarray, "15 r"], centre: Float[np.ndarray, "3 r"], normal: Float[np.ndarray, "3 r"]
) -> Float[np.ndarray, " r"]:
    """Mean squared distance of each region from a plane given for it."""
    x, y, z = normal
    square = table[6] * x * x + table[9] * y * y + table[11] * z * z
    square = square + 2 * (table[7] * x * y + table[8] * x * z + table[10] * y * z)
    along = (table[3] * x + table[4] * y + table[5] * z) / table[0]
    level = np.einsum("ir,ir->r", centre, normal)
    return np.maximum(square / table[0] - along * along + (along - level) ** 2, 0.0)


def grow_flat(moments: Moments, pairs: Int[np.ndarray, "p 2"], noise: float) -> tuple[Int[np.ndarray, " m"], Moments]:
    """The region of each triangle, numbered from 0, and the sums of each region.

    ``pairs`` are neighbouring triangles in an order that does not depend on the order of the triangles, ``noise`` the
    standard deviation of vertices across the surface. Regions never merge except across ``pairs``.
    """
    table = moments.table.copy()
    count = table.shape[1]
    owner, best, changed = np.arange(count), np.full(count, np.inf), np.zeros(count, bool)
    i, j = pairs[:, 0], pairs[:, 1]
    # equal costs, as all are on a flat mesh, must not favour one direction
    toss = np.random.default_rng(0).random(len(i)) / 2
    cost = _cost(table, i, j, noise) + toss
    for level in LEVELS:
        while True:
            able = np.flatnonzero(np.isfinite(cost) & (cost <= level))
            chosen = able[_match(i[able], j[able], cost[able], best)]
            if len(chosen) == 0:
                break
            keep, drop = np.minimum(i[chosen], j[chosen]), np.maximum(i[chosen], j[chosen])
            merged = table[:, keep] + table[:, drop]
            merged[2] = merged[0] * mean_square(merged, *plane_of(merged))
            table[:, keep] = merged
            owner[drop] = keep
            changed[keep] = changed[drop] = True
            stale = changed[i] | changed[j]
            changed[keep] = changed[drop] = False
            i, j, cost, toss = _renewed(table, owner, stale, i, j, cost, toss, noise)
    while (owner[owner] != owner).any():
        owner = owner[owner]
    roots = np.flatnonzero(owner == np.arange(count))
    number = np.zeros(count, np.int64)
    number[roots] = np.arange(len(roots))
    return number[owner], Moments(table[:, roots])


def _renewed(table, owner, stale, i, j, cost, toss, noise):
    """The borders between regions after a round: one between any two, costs anew where a side changed."""
    a, b = owner[i[stale]], owner[j[stale]]
    between = a != b
    a, b, fresh = np.minimum(a, b)[between], np.maximum(a, b)[between], toss[stale][between]
    key = a * np.int64(len(owner)) + b
    order = np.argsort(key)
    order = order[np.flatnonzero(np.diff(key[order], prepend=-1))]
    a, b, fresh = a[order], b[order], fresh[order]
    keep = ~stale
    return (
        np.concatenate([i[keep], a]),
        np.concatenate([j[keep], b]),
        np.concatenate([cost[keep], _cost(table, a, b, noise) + fresh]),
        np.concatenate([toss[keep], fresh]),
    )


def _cost(table, i, j, noise):
    """What merging adds to the squared plane error, over what noise alone adds; infinite where one plane is wrong.

    Both sides must lie within the noise of the common plane, so that a large region cannot swallow a small one.
    """
    if len(i) <= BLOCK:
        return _block_cost(table, i, j, noise)
    blocks = [slice(start, start + BLOCK) for start in range(0, len(i), BLOCK)]
    with ThreadPoolExecutor(min(len(blocks), os.cpu_count() or 1)) as pool:
        return np.concatenate(list(pool.map(lambda block: _block_cost(table, i[block], j[block], noise), blocks)))


def _block_cost(table, i, j, noise):
    one, two = table[:, i], table[:, j]
    centre, normal = plane_of(one + two)
    square_one, square_two = mean_square(one, centre, normal), mean_square(two, centre, normal)
    added = one[0] * square_one + two[0] * square_two - one[2] - two[2]
    variance = noise * noise
    fits = square_one <= variance * (MANY + (SINGLE - MANY) / np.sqrt(one[1]))
    fits &= square_two <= variance * (MANY + (SINGLE - MANY) / np.sqrt(two[1]))
    facing = np.einsum("ir,ir->r", one[12:], two[12:])
    length = np.einsum("ir,ir->r", one[12:], one[12:]) * np.einsum("ir,ir->r", two[12:], two[12:])
    fits &= facing >= FACING * np.sqrt(length)
    return np.where(fits, np.maximum(added, 0) / (variance * (one[0] / one[1] + two[0] / two[1])), np.inf)


def _match(i, j, cost, best):
    """Places of borders whose two regions have each other as the best of those still free; three passes.

    ``best`` is infinite for every region, before and after.
    """
    place = np.arange(len(i))
    chosen = []
    for _ in range(3):
        np.minimum.at(best, i, cost)
        np.minimum.at(best, j, cost)
        mutual = (best[i] == cost) & (best[j] == cost)
        chosen.append(place[mutual])
        best[i] = best[j] = np.inf
        best[i[mutual]] = best[j[mutual]] = -np.inf
        free = (best[i] == np.inf) & (best[j] == np.inf)
        best[i[mutual]] = best[j[mutual]] = np.inf
        i, j, cost, place = i[free], j[free], cost[free], place[free]
    return np.concatenate(chosen)
