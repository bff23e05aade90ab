"""Points moved onto the mean surface of oriented points: moving least squares without shrinking."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from jaxmodel.mesh.blocks import in_blocks

STEPS = 2
NEIGHBOURS = 64
BLOCK = 1 << 11  # sites moved at once: few enough that their neighbours stay in the processor's cache
QUERY = 1 << 15  # sites asked for neighbours at once: bounds the memory


class Projected(NamedTuple):
    """``points`` on the surface, its mean unit ``normals`` there, and the total ``weight`` of the points it is of."""

    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    weight: Float[np.ndarray, " k"]


def project(
    sites: Float[np.ndarray, "k 3"],
    site_normals: Float[np.ndarray, "k 3"],
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    reach: float,
    tree: KDTree | None = None,
    neighbours: int = NEIGHBOURS,
) -> Projected:
    """``sites`` moved along their normals onto the weighted mean surface of the nearest ``points`` within ``reach``.

    Each point votes the height at which the chord to it is perpendicular to the sum of both normals, which is
    exact on planes and on spheres: repeated projection does not shrink the surface. A site without a point in reach
    stays, with weight 0.
    """
    tree = tree or KDTree(points)
    moved, mean, support = sites.copy(), site_normals.copy(), np.zeros(len(sites))
    for start in range(0, len(sites), QUERY):
        found = sites[start : start + QUERY]
        _, index = tree.query(found, k=min(neighbours, len(points)), distance_upper_bound=reach, workers=-1)
        index = np.asarray(index).reshape(len(found), -1)

        def move(part: slice, start: int = start, index: np.ndarray = index) -> None:
            rows = slice(start + part.start, start + part.stop)
            near = index[part]
            absent = near == len(points)
            near = np.where(absent, 0, near)
            moved[rows], mean[rows], support[rows] = _moved(
                moved[rows], mean[rows], points[near], normals[near], absent, reach
            )

        in_blocks(len(found), BLOCK, move)
    return Projected(moved, mean, support)


def _moved(
    site: Float[np.ndarray, "b 3"],
    mean: Float[np.ndarray, "b 3"],
    points: Float[np.ndarray, "b m 3"],
    normals: Float[np.ndarray, "b m 3"],
    absent: Bool[np.ndarray, "b m"],
    reach: float,
) -> Projected:
    support = np.zeros(len(site))
    for _ in range(STEPS):
        chord = points - site[:, None]
        agree = np.clip(np.einsum("kma,ka->km", normals, mean), 0.0, 1.0)
        weight = np.exp(-4 / reach**2 * np.einsum("kma,kma->km", chord, chord)) * agree**2
        weight[absent] = 0.0
        total = np.einsum("km,kma->ka", weight, normals)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        middle = np.where(length > 0, total / np.where(length > 0, length, 1.0), mean)
        # sum of weight (n + middle) . chord and of weight (n + middle) . middle
        toward = np.einsum("km,kma->ka", weight, chord)
        height = np.einsum("km,kma,kma->k", weight, normals, chord) + np.einsum("ka,ka->k", toward, middle)
        support = weight.sum(axis=1)
        scale = np.einsum("ka,ka->k", total, middle) + support
        site = site + (height / np.where(scale > 0, scale, 1.0))[:, None] * middle
        mean = middle
    return Projected(site, mean, support)
