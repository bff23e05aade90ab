"""Vertices between primitives moved to where these meet: the line of two surfaces, the point of three."""

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.mesh.adjacency import face_vectors
from jaxmodel.mesh.primitives import Surface, offset

STEPS = 6
TANGENT = np.sin(np.deg2rad(8.0)) ** 2
"""Squared sine of the angle between two surfaces below which they have no line to snap to."""
LEAST_AREA = 0.05
"""Part of its area that a triangle beside a moved vertex must keep."""


def snap(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    label: Int[np.ndarray, " m"],
    surfaces: list[Surface],
    bound: float,
) -> Float[np.ndarray, "n 3"]:
    """The vertices with those of exactly two or three primitives moved to all of them, the shortest way.

    None moves by more than ``bound``, none between surfaces that are nearly tangent, and none where a triangle would
    turn over or lose nearly all its area. Vertices that touch a free-form segment stay.
    """
    vertex, names = _meetings(faces, label, len(vertices))
    solid = np.array([surface.kind != "free-form" for surface in surfaces] + [True])
    keep = solid[names].all(axis=1)
    vertex, names = vertex[keep], names[keep]
    if len(vertex) == 0:
        return vertices
    target, sharp = _meet(vertices[vertex], names, surfaces)
    moved = np.linalg.norm(target - vertices[vertex], axis=1)
    good = sharp & (moved <= bound)
    return _without_folds(vertices, faces, vertex[good], target[good])


def _meetings(faces, label, count):
    """Vertices of two or three labels, with these labels (the third -1 where there are two)."""
    lowest, highest = np.full(count, label.max() + 1), np.full(count, -1)
    for k in range(3):
        np.minimum.at(lowest, faces[:, k], label)
        np.maximum.at(highest, faces[:, k], label)
    beside = (highest > lowest)[faces]
    keys = np.unique(faces[beside] * np.int64(label.max() + 1) + np.repeat(label, beside.sum(axis=1)))
    vertex, name = keys // (label.max() + 1), keys % (label.max() + 1)
    number = np.bincount(vertex, minlength=count)
    first = np.cumsum(number) - number
    some = np.flatnonzero((number == 2) | (number == 3))
    names = np.full((len(some), 3), -1)
    for k in range(3):
        has = number[some] > k
        names[has, k] = name[first[some[has]] + k]
    return some, names


def _meet(points, names, surfaces):
    """The nearest points on all the surfaces named, by Newton's steps of least length, and where these meet sharply."""
    target = points.copy()
    sharp = np.zeros(len(points), bool)
    for _ in range(STEPS):
        value, gradient = np.zeros(names.shape), np.zeros((*names.shape, 3))
        for k in np.unique(names[names >= 0]):
            for slot in range(3):
                at = names[:, slot] == k
                value[at, slot], gradient[at, slot] = offset(surfaces[k], target[at])
        gram = np.einsum("vai,vbi->vab", gradient, gradient)
        two = names[:, 2] < 0
        gram[two, 2, 2] = 1.0
        sharp = np.linalg.det(gram) > TANGENT * np.where(two, 1.0, TANGENT)
        gram[~sharp] = np.eye(3)
        value[~sharp] = 0
        target -= np.einsum("vai,va->vi", gradient, np.linalg.solve(gram, value[:, :, None])[:, :, 0])
    return target, sharp


def _without_folds(vertices, faces, vertex, target):
    """The vertices with the moves that turn no triangle over: a triangle that would turn gives its moves back."""
    place = np.full(len(vertices), -1)
    place[vertex] = np.arange(len(vertex))
    near = faces[(place[faces] >= 0).any(axis=1)]
    before = face_vectors(vertices, near)
    square = np.einsum("ij,ij->i", before, before)
    allowed = np.ones(len(vertex), bool)
    moved = vertices.copy()
    moved[vertex] = target
    while True:
        after = face_vectors(moved, near)
        folded = np.einsum("ij,ij->i", before, after) < LEAST_AREA * square
        at = place[near[folded]]
        at = np.unique(at[at >= 0])
        at = at[allowed[at]]
        if len(at) == 0:
            return moved
        allowed[at] = False
        moved[vertex[at]] = vertices[vertex[at]]
