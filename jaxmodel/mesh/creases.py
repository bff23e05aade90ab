"""Normals of noisy triangles, smoothed without rounding edges off, and the creases between them."""

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.mesh.adjacency import face_components

CREASE_DEG = 25.0
"""Angle between neighbouring triangles from which an edge is a crease of the object, not of its triangulation."""
SHARPEST = 0.5
"""Cosine below which neighbours do not smooth each other."""
SMOOTH = 0.03
"""Scatter of normals, in radians, not worth smoothing; above it, one round for each."""
MOST_ROUNDS = 15


def smooth_normals(
    vectors: Float[np.ndarray, "m 3"], pairs: Int[np.ndarray, "p 2"], scatter: float
) -> Float[np.ndarray, "m 3"]:
    """Unit normals averaged with those of neighbours that face alike (Sun et al. 2007), the more the more they scatter.

    ``vectors`` are normals times any measure of area, ``scatter`` the ratio of noise to edge length.
    """
    count = len(vectors)
    area = np.maximum(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)), 1e-300)
    normals = vectors / area[:, None]
    i, j = pairs.T
    for _ in range(min(int(np.ceil(scatter / SMOOTH)) if scatter > SMOOTH / 3 else 0, MOST_ROUNDS)):
        weight = np.maximum(np.einsum("ij,ij->i", normals[i], normals[j]) - SHARPEST, 0) ** 2
        total = normals * (area * (1 - SHARPEST) ** 2)[:, None]
        for axis in range(3):
            total[:, axis] += np.bincount(i, weight * area[j] * normals[j, axis], count)
            total[:, axis] += np.bincount(j, weight * area[i] * normals[i, axis], count)
        normals = total / np.maximum(np.sqrt(np.einsum("ij,ij->i", total, total)), 1e-300)[:, None]
    return normals


def angles_deg(normals: Float[np.ndarray, "m 3"], pairs: Int[np.ndarray, "p 2"]) -> Float[np.ndarray, " p"]:
    """Angle between the normals of neighbours; exact near zero."""
    first, second = normals[pairs[:, 0]], normals[pairs[:, 1]]
    chord = first - second
    half = np.sqrt(np.einsum("ij,ij->i", chord, chord)) / 2
    return np.rad2deg(2 * np.arcsin(np.minimum(half, 1)))


def links_within(within: Bool[np.ndarray, " m"], pairs: Int[np.ndarray, "p 2"]) -> Int[np.ndarray, "l 2"]:
    """The ``pairs`` with both triangles in ``within``, these numbered by their place among those within."""
    number = np.cumsum(within) - 1
    return number[pairs[within[pairs[:, 0]] & within[pairs[:, 1]]]]


def smooth_parts(
    within: Bool[np.ndarray, " m"],
    pairs: Int[np.ndarray, "p 2"],
    crease: Bool[np.ndarray, " p"],
    areas: Float[np.ndarray, " m"],
    smallest: float = 0.0,
) -> list[Int[np.ndarray, " f"]]:
    """The triangles of ``within`` in parts that hang together across edges that are no crease, the largest first.

    Parts of less area than ``smallest`` are left out.
    """
    inside = np.flatnonzero(within)
    links = links_within(within, pairs[~crease])
    count, part = face_components(len(inside), links)
    area = np.bincount(part, areas[inside], count)
    order = np.argsort(part, kind="stable")
    ends = np.concatenate([[0], np.cumsum(np.bincount(part, minlength=count))])
    ranked = np.argsort(-area, kind="stable")
    return [inside[order[ends[k] : ends[k + 1]]] for k in ranked[area[ranked] >= smallest]]
