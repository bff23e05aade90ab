"""Segments that meet without a crease, as a plane and the rounding of its edge do: together one face of a CAD model."""

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.mesh.adjacency import Adjacency, face_components
from jaxmodel.mesh.primitives import Surface, offset

SMOOTH_DEG = 10.0
"""Largest mean angle between two surfaces along their common border that is no crease."""


def smooth_joins(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    shared: Adjacency,
    normals: Float[np.ndarray, "m 3"],
    label: Int[np.ndarray, " m"],
    surfaces: list[Surface],
) -> Int[np.ndarray, " s"]:
    """The smooth face each segment belongs to; ``normals`` (smoothed) stand for surfaces that are free-form."""
    first, second = label[shared.pairs].T
    border = np.flatnonzero(first != second)
    sides = np.where((first > second)[border, None], shared.pairs[border][:, ::-1], shared.pairs[border])
    ends = vertices[shared.edges[shared.pair_edge[border]]]
    middle, length = ends.mean(axis=1), np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    n, other = (_normals(middle, normals[face], label[face], surfaces) for face in sides.T)
    across = vertices[faces[sides[:, 1]]].mean(axis=1) - vertices[faces[sides[:, 0]]].mean(axis=1)
    along = np.cross(n + other, across)
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    # with its sign, ridge or valley, noise averages out along the border
    angle = np.arctan2(np.einsum("ij,ij->i", np.cross(n, other), along), np.einsum("ij,ij->i", n, other))
    names = label[sides]
    key, join = np.unique(names[:, 0] * np.int64(len(surfaces)) + names[:, 1], return_inverse=True)
    join = join.reshape(-1)
    mean = np.bincount(join, angle * length, len(key)) / np.maximum(np.bincount(join, length, len(key)), 1e-300)
    tight = key[np.abs(mean) < np.deg2rad(SMOOTH_DEG)]
    return face_components(len(surfaces), np.stack([tight // len(surfaces), tight % len(surfaces)], axis=1))[1]


def _normals(points, normals, label, surfaces):
    """The normals of the surfaces at points on them, on the same side as those given; these where it is free-form."""
    result = normals.copy()
    for k in np.unique(label):
        if surfaces[k].kind != "free-form":
            at = label == k
            exact = offset(surfaces[k], points[at])[1]
            result[at] = exact * np.where(np.einsum("ij,ij->i", exact, normals[at]) < 0, -1.0, 1.0)[:, None]
    return result
