"""Several overlapping layers of points made one sheet, evenly sampled, before it is meshed (thesis §3.3.6)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.blocks import in_blocks
from jaxmodel.mesh.projection import project

LEVELS = 16
BLOCK = 1 << 14  # pairs weighed at once: few enough that they stay in the processor's cache
REACH = 2.5  # of the projection, in thinning distances


class Sheet(NamedTuple):
    """``k`` of ``n`` points, at least the thinning distance apart along the surface and moved onto the sheet's middle.

    ``source`` row of the input each was; ``normals`` unit, the sheet's mean there; ``weight`` of the points it is of.
    """

    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    weight: Float[np.ndarray, " k"]
    source: Int[np.ndarray, " k"]


def thin(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    distance: float,
    toward: Float[np.ndarray, "n 3"] | None = None,
    tree: KDTree | None = None,
    seed: int = 0,
) -> Sheet:
    """The best point of each group of radius ``distance``, projected on the mean surface of the points around it.

    Two points are of one group when less than ``distance`` apart along the surface, at most as much across it, and
    their unit ``normals`` differ by less than 90°: the two sides of a thin wall stay apart. Best is the one nearest to
    the group's mean surface, with the normal nearest to the mean normal and, given the unit directions ``toward``
    the sensor, the one that faces it most squarely. Linear in points, without a loop over them.
    """
    tree = tree or KDTree(points)
    pairs, offset = _groups(points, normals, distance, tree)
    order = _order(points, normals, pairs, offset, distance, toward, seed)
    source = _independent(len(points), pairs, order)
    onto = project(points[source], normals[source], points, normals, REACH * distance, tree)
    return Sheet(onto.points, onto.normals, onto.weight, source)


def _groups(
    points: np.ndarray, normals: np.ndarray, distance: float, tree: KDTree
) -> tuple[Int[np.ndarray, "p 2"], Float[np.ndarray, " p"]]:
    """Pairs of one group, and the second's height over the first along their mean normal."""
    pairs = tree.query_pairs(np.sqrt(2) * distance, output_type="ndarray")

    def together(rows: slice) -> tuple[np.ndarray, np.ndarray]:
        some = pairs[rows]
        first, second = some.T
        both = normals[first] + normals[second]
        chord = points[second] - points[first]
        square = np.einsum("pa,pa->p", both, both)
        height = np.einsum("pa,pa->p", chord, both) / np.sqrt(np.where(square > 0, square, 1.0))
        along = np.einsum("pa,pa->p", chord, chord) - height**2
        same = (square > 2.0) & (along < distance**2) & (np.abs(height) < distance)
        return some[same], height[same]

    parts = [(np.zeros((0, 2), pairs.dtype), np.zeros(0)), *in_blocks(len(pairs), BLOCK, together)]
    return np.concatenate([some for some, _ in parts]), np.concatenate([height for _, height in parts])


def _order(
    points: np.ndarray,
    normals: np.ndarray,
    pairs: np.ndarray,
    height: np.ndarray,
    distance: float,
    toward: np.ndarray | None,
    seed: int,
) -> Int[np.ndarray, " n"]:
    """Rank of each point, 0 for the best. Merits are rounded to 16 levels and ties drawn by lot.

    Without the lot, neighbours of nearly equal merit would make chains as long as the surface.
    """
    n = len(points)
    first, second = pairs.T
    count = np.bincount(first, minlength=n) + np.bincount(second, minlength=n)
    above = (np.bincount(second, height, n) - np.bincount(first, height, n)) / np.maximum(count, 1)
    mean = normals.copy()
    for axis in range(3):
        mean[:, axis] += np.bincount(first, normals[second, axis], n) + np.bincount(second, normals[first, axis], n)
    length = np.linalg.norm(mean, axis=1)
    agree = np.einsum("na,na->n", mean, normals) / np.where(length > 0, length, 1.0)
    facing = 1.0 if toward is None else np.clip(np.einsum("na,na->n", toward, normals), 0.0, 1.0)
    merit = agree * facing / (1.0 + np.abs(above) / distance)
    level = np.round(np.clip(merit, 0.0, 1.0) * LEVELS)
    rank = np.empty(n, np.int64)
    rank[np.lexsort((np.random.default_rng(seed).random(n), -level))] = np.arange(n)
    return rank


def _independent(n: int, pairs: np.ndarray, rank: np.ndarray) -> Int[np.ndarray, " s"]:
    """Points no two of which are a pair while every other has a kept one: best first, all local bests of a round."""
    free, kept = np.ones(n, bool), np.zeros(n, bool)
    first, second = pairs.T
    while len(first):
        beaten = np.zeros(n, bool)
        beaten[np.where(rank[first] < rank[second], second, first)] = True
        best = free & ~beaten
        kept |= best
        free &= beaten
        free[second[best[first]]] = False
        free[first[best[second]]] = False
        alive = free[first] & free[second]
        first, second = first[alive], second[alive]
    return np.flatnonzero(kept | free)
