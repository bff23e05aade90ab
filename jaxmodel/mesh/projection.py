"""Points moved onto the mean surface of oriented points: moving least squares without shrinking."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

STEPS = 2
NEIGHBOURS = 64
BLOCK = 1 << 15


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
    for start in range(0, len(sites), BLOCK):
        rows = slice(start, start + BLOCK)
        _, index = tree.query(sites[rows], k=min(neighbours, len(points)), distance_upper_bound=reach, workers=-1)
        index = np.asarray(index).reshape(len(sites[rows]), -1)
        absent = index == len(points)
        index = np.where(absent, 0, index)
        q, n = points[index], normals[index]
        for _ in range(STEPS):
            chord = q - moved[rows, None]
            agree = np.clip(np.einsum("kma,ka->km", n, mean[rows]), 0.0, 1.0)
            weight = np.exp(-4 / reach**2 * np.einsum("kma,kma->km", chord, chord)) * agree**2
            weight[absent] = 0.0
            total = np.einsum("km,kma->ka", weight, n)
            length = np.linalg.norm(total, axis=1, keepdims=True)
            middle = np.where(length > 0, total / np.where(length > 0, length, 1.0), mean[rows])
            both = n + middle[:, None]
            height = np.einsum("km,kma,kma->k", weight, both, chord)
            scale = np.einsum("km,kma,ka->k", weight, both, middle)
            moved[rows] += (height / np.where(scale > 0, scale, 1.0))[:, None] * middle
            mean[rows] = middle
            support[rows] = weight.sum(axis=1)
    return Projected(moved, mean, support)
