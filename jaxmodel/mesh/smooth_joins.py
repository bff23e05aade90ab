"""Segments that meet without a crease, as a plane and the rounding of its edge do: together one face of a CAD model."""

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.mesh.adjacency import Adjacency, face_components
from jaxmodel.mesh.primitives import Surface, offset

SMOOTH_DEG = 12.0
"""Largest mean angle between two surfaces along their common border that is no crease."""


def smooth_joins(
    vertices: Float[np.ndarray, "n 3"],
    shared: Adjacency,
    normals: Float[np.ndarray, "m 3"],
    label: Int[np.ndarray, " m"],
    surfaces: list[Surface],
) -> Int[np.ndarray, " s"]:
    """The smooth face each segment belongs to; ``normals`` (smoothed) stand for surfaces that are free-form."""
    border = np.flatnonzero(label[shared.pairs[:, 0]] != label[shared.pairs[:, 1]])
    ends = vertices[shared.edges[shared.pair_edge[border]]]
    middle, length = ends.mean(axis=1), np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    sides = []
    for face in shared.pairs[border].T:
        normal = normals[face].copy()
        for k in np.unique(label[face]):
            if surfaces[k].kind != "free-form":
                at = label[face] == k
                exact = offset(surfaces[k], middle[at])[1]
                normal[at] = exact * np.sign(np.einsum("ij,ij->i", exact, normal[at]))[:, None]
        sides.append(normal)
    angle = np.rad2deg(np.arccos(np.clip(np.einsum("ij,ij->i", *sides), -1, 1)))
    names = np.sort(label[shared.pairs[border]], axis=1)
    key, join = np.unique(names[:, 0] * np.int64(len(surfaces)) + names[:, 1], return_inverse=True)
    join = join.reshape(-1)
    mean = np.bincount(join, angle * length, len(key)) / np.maximum(np.bincount(join, length, len(key)), 1e-300)
    tight = key[mean < SMOOTH_DEG]
    return face_components(len(surfaces), np.stack([tight // len(surfaces), tight % len(surfaces)], axis=1))[1]
