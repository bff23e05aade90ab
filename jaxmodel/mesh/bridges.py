"""Triangles that bridge a crease: where no vertex lies on the edge itself, a strip of them belongs to neither side."""

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.mesh.adjacency import face_components
from jaxmodel.mesh.boundaries import offers
from jaxmodel.mesh.creases import links_within
from jaxmodel.mesh.primitives import Surface, offset

EXPLAINED = 0.9
"""Part of a group's area whose corners all must lie on or beside primitives for the group to be a bridge."""


def bridging(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    pairs: Int[np.ndarray, "p 2"],
    surfaces: list[Surface],
    label: Int[np.ndarray, " m"],
    areas: Float[np.ndarray, " m"],
    close: float,
) -> Bool[np.ndarray, " m"]:
    """Which unnamed triangles (-1) only lead from one primitive to another.

    A triangle whose corners all belong to primitives, and not all to the same; and a group no more than a row or two
    wide on each side of the crease: nearly all of its corners belong to a primitive, or lie beside one and within
    ``close`` of it. A rounding of several rows has vertices of its own in between, and stays.
    """
    free = label < 0
    if not free.any():
        return free
    lowest, highest = _held(faces, label, len(vertices), len(surfaces))
    on = highest >= 0
    some = np.flatnonzero(free)
    low, high = lowest[faces[some]].min(axis=1), highest[faces[some]].max(axis=1)
    across = free.copy()
    across[some] = on[faces[some]].all(axis=1) & (low != high)
    rest = np.flatnonzero(free & ~across)
    low, high = low[~across[some]], high[~across[some]]
    if len(rest) == 0:
        return across
    count, group = face_components(len(rest), links_within(free & ~across, pairs))
    near = on | _beside(vertices, faces[rest], surfaces, lowest, highest, close)
    explained = near[faces[rest]].all(axis=1)
    area = np.bincount(group, areas[rest], count)
    narrow = np.bincount(group, areas[rest] * explained, count) >= EXPLAINED * area
    least, most = np.full(count, len(surfaces)), np.full(count, -1)
    np.minimum.at(least, group, low)
    np.maximum.at(most, group, high)
    across[rest] = (narrow & (least < most))[group]
    return across


def take_in_bridges(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    pairs: Int[np.ndarray, "p 2"],
    surfaces: list[Surface],
    label: Int[np.ndarray, " m"],
    bridge: Bool[np.ndarray, " m"],
    reach: float,
) -> Int[np.ndarray, " m"]:
    """``label`` with the triangles of ``bridge`` given, from their borders inwards, each to the nearest of the
    primitives beside it; those farther than ``reach`` (root mean square) from all of them stay unnamed.
    """
    label = label.copy()
    while True:
        face, name, cost = offers(vertices, faces, pairs, surfaces, label, bridge & (label < 0))
        within = cost <= 3 * reach * reach
        face, name, cost = face[within], name[within], cost[within]
        if len(face) == 0:
            return label
        order = np.lexsort((name, cost, face))
        first = order[np.flatnonzero(np.diff(face[order], prepend=-1))]
        label[face[first]] = name[first]


def _held(faces, label, count, surfaces):
    """The lowest and the highest name among the triangles at each vertex; the number of surfaces and -1 where none."""
    lowest, highest = np.full(count, surfaces), np.full(count, -1)
    named = label >= 0
    for k in range(3):
        np.minimum.at(lowest, faces[named, k], label[named])
        np.maximum.at(highest, faces[named, k], label[named])
    return lowest, highest


def _beside(vertices, faces, surfaces, lowest, highest, close):
    """Which vertices share an edge of ``faces`` with one of a primitive and lie within ``close`` of that primitive."""
    start, end = faces.reshape(-1), faces[:, [1, 2, 0]].reshape(-1)
    both = np.concatenate([np.stack([start, end]), np.stack([end, start])], axis=1)
    both = both[:, (highest[both[0]] < 0) & (highest[both[1]] >= 0)]
    result = np.zeros(len(vertices), bool)
    for held in (lowest, highest):
        key = np.unique(held[both[1]] * np.int64(len(vertices)) + both[0])
        name, vertex = key // len(vertices), key % len(vertices)
        for k in np.unique(name):
            of_surface = vertex[name == k]
            result[of_surface[np.abs(offset(surfaces[k], vertices[of_surface])[0]) <= close]] = True
    return result
