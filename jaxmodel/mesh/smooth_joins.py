"""Segments that meet without a crease, as a plane and the rounding of its edge do: together one face of a CAD model."""

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.mesh.adjacency import Adjacency, face_components
from jaxmodel.mesh.creases import CREASE_DEG, links_within, smooth_normals
from jaxmodel.mesh.primitives import Surface, offset

SMOOTH_DEG = 10.0
"""Largest mean angle between two surfaces along some of their common border that is no crease there."""
ALONG = 4
"""How often angles are averaged with the next ones along the border."""
SHARE = 0.15
"""Least part of the border of one of the two segments along which they meet smoothly: a crease may fade out."""


def smooth_joins(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    shared: Adjacency,
    vectors: Float[np.ndarray, "m 3"],
    label: Int[np.ndarray, " m"],
    surfaces: list[Surface],
    scatter: float,
) -> Int[np.ndarray, " s"]:
    """The smooth face each segment belongs to.

    ``vectors`` are the triangles' normals times any measure of area, which stand, smoothed within the segment, for
    surfaces that are free-form; ``scatter`` is the ratio of noise to edge length.
    """
    first, second = label[shared.pairs].T
    normals = _free_normals(vectors, shared.pairs[first == second], label, surfaces, scatter)
    border = np.flatnonzero(first != second)
    sides = np.where((first > second)[border, None], shared.pairs[border][:, ::-1], shared.pairs[border])
    edges = shared.edges[shared.pair_edge[border]]
    ends = vertices[edges]
    middle, length = ends.mean(axis=1), np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    n, other = (_normals(middle, normals[face], label[face], surfaces) for face in sides.T)
    across = vertices[faces[sides[:, 1]]].mean(axis=1) - vertices[faces[sides[:, 0]]].mean(axis=1)
    along = np.cross(n + other, across)
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    names = label[sides]
    key, join = np.unique(names[:, 0] * np.int64(len(surfaces)) + names[:, 1], return_inverse=True)
    join = join.reshape(-1)
    cosine = np.einsum("ij,ij->i", n, other)
    # with its sign, ridge or valley, noise averages out along the border; without it, no teeth of a sharp edge cancel
    signed = _averaged(np.arctan2(np.einsum("ij,ij->i", np.cross(n, other), along), cosine), join, edges, length)
    size = _averaged(np.arccos(np.clip(cosine, -1, 1)), join, edges, length)
    smooth = (np.abs(signed) < np.deg2rad(SMOOTH_DEG)) & (size < np.deg2rad(CREASE_DEG))
    whole = np.bincount(names.reshape(-1), np.repeat(length, 2), len(surfaces))
    least = np.minimum(whole[key // len(surfaces)], whole[key % len(surfaces)])
    tight = key[np.bincount(join, length * smooth, len(key)) >= SHARE * least]
    return face_components(len(surfaces), np.stack([tight // len(surfaces), tight % len(surfaces)], axis=1))[1]


def _averaged(angle, join, edges, length):
    """The angle of each border edge averaged with those next to it between the same two segments, by length."""
    corner = np.unique(join[:, None] * np.int64(edges.max(initial=0) + 1) + edges, return_inverse=True)[1].reshape(
        -1, 2
    )
    weight = np.bincount(corner.reshape(-1), np.repeat(length, 2))
    for _ in range(ALONG):
        total = np.bincount(corner.reshape(-1), np.repeat(angle * length, 2))
        angle = (total / np.maximum(weight, 1e-300))[corner].mean(axis=1)
    return angle


def _free_normals(vectors, pairs, label, surfaces, scatter):
    """Unit normals, smoothed among the free-form triangles of each segment."""
    normals = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    free = np.array([surface.kind == "free-form" for surface in surfaces])[label]
    normals[free] = smooth_normals(vectors[free], links_within(free, pairs), scatter)
    return normals


def _normals(points, normals, label, surfaces):
    """The normals of the surfaces at points on them, on the same side as those given; these where it is free-form."""
    result = normals.copy()
    for k in np.unique(label):
        if surfaces[k].kind != "free-form":
            at = label == k
            exact = offset(surfaces[k], points[at])[1]
            result[at] = exact * np.where(np.einsum("ij,ij->i", exact, normals[at]) < 0, -1.0, 1.0)[:, None]
    return result
