"""Triangles that lie over others of the same mesh: what is left of layers that should have become one sheet."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import face_vectors

HEIGHT = 0.5
"""How high over a triangle another one still lies over it, in edges of the mesh."""
ALIKE = 0.5
"""Least cosine between the normals of triangles of one sheet."""
BLOCK = 4096


def lying_over(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Bool[np.ndarray, " m"]:
    """Triangles whose middle has another triangle over or under it, closer than half the mesh's median edge.

    The other one faces the same way to 60 degrees and shares no corner. Triangles without area are none of them.
    """
    result = np.zeros(len(faces), bool)
    if len(faces) < 2:
        return result
    corners = np.asarray(vertices, np.float64)[faces]
    vectors = face_vectors(np.asarray(vertices, np.float64), faces)
    doubled = np.linalg.norm(vectors, axis=1)
    solid = np.flatnonzero(doubled > 0)
    sides = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    if len(solid) < 2:
        return result
    height = HEIGHT * float(np.median(sides[solid]))
    unit = np.zeros_like(vectors)
    unit[solid] = vectors[solid] / doubled[solid, None]
    middle = corners.mean(axis=1)
    tree, reach = KDTree(middle[solid]), np.hypot(sides[solid].max(axis=1), height)
    # from the larger of two triangles the middle of the smaller is always within reach
    for start in range(0, len(solid), BLOCK):
        own = solid[start : start + BLOCK]
        near = tree.query_ball_point(middle[own], reach[start : start + BLOCK], workers=-1)
        under = np.repeat(own, [len(rows) for rows in near])
        over = solid[np.concatenate([np.asarray(rows, np.int64) for rows in near])]
        apart = (faces[under][:, :, None] != faces[over][:, None, :]).all(axis=(1, 2))
        alike = np.einsum("pa,pa->p", unit[under], unit[over]) > ALIKE
        under, over = under[apart & alike], over[apart & alike]
        inside = _within(corners[under], unit[under], vectors[under], middle[over], height)
        result[over[inside]] = True
    return result


def _within(corners: np.ndarray, unit: np.ndarray, vectors: np.ndarray, place: np.ndarray, height: float) -> np.ndarray:
    """Whether each place lies over its triangle, at most ``height`` above or below."""
    above = np.einsum("pa,pa->p", place - corners[:, 0], unit)
    inside = np.abs(above) < height
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        inside &= np.einsum("pa,pa->p", np.cross(b - a, place - a), vectors) > 0
    return inside
