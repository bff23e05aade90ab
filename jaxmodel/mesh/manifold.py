"""Triangles that can be one surface: those dropped that fold over, crowd an edge, or touch the rest in a point only."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxmodel.mesh.adjacency import adjacency, face_components, face_normals, face_vectors


def clean(
    vertices: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    fixed: Bool[np.ndarray, " n"] | None = None,
) -> Int[np.ndarray, "k 3"]:
    """The largest part of ``faces``, worst dropped first, that is a consistently oriented 2-manifold with border.

    Every kept triangle faces the side its corners' ``normals`` point to; every edge has one or two triangles; the
    triangles at a vertex form one fan. Merit of a triangle is its agreement with those normals. Vertices that are
    ``fixed`` have triangles beyond ``faces``: their fans are not judged.
    """
    faces = distinct(faces)
    agree = facing(vertices, normals, faces)
    faces = np.where((agree < 0)[:, None], faces[:, [0, 2, 1]], faces)
    merit = np.abs(agree)
    keep = merit > 0
    faces, merit = faces[keep], merit[keep]
    while len(faces):
        bad = _on_bad_edges(faces, merit)
        if not bad.any():
            bad = _in_lesser_fans(faces, fixed)
            if not bad.any():
                break
        faces, merit = faces[~bad], merit[~bad]
    return faces


def distinct(faces: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "k 3"]:
    """``faces`` with three different corners, each set of corners once (the first)."""
    corners = np.sort(faces, axis=1)
    proper = np.flatnonzero((corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]))
    _, first = np.unique(corners[proper], axis=0, return_index=True)
    return faces[proper[np.sort(first)]]


def facing(
    vertices: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]
) -> Float[np.ndarray, " m"]:
    """Cosine between a triangle's normal and the mean of its corners' ``normals``; 0 where one of them is missing."""
    mean = normals[faces].sum(axis=1)
    length = np.linalg.norm(mean, axis=1)
    return np.einsum("ma,ma->m", face_normals(vertices, faces), mean) / np.where(length > 0, length, 1.0)


def without_small_parts(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], share: float
) -> Int[np.ndarray, "k 3"]:
    """``faces`` without the components that hold less than ``share`` of the whole area."""
    area = np.linalg.norm(face_vectors(vertices, faces), axis=1)
    count, part = face_components(len(faces), adjacency(faces).pairs)
    large = np.bincount(part, area, count) >= share * area.sum()
    return faces[large[part]]


class Used(NamedTuple):
    """``faces`` numbering only the vertices they use: ``rows`` of those among all."""

    rows: Int[np.ndarray, " k"]
    faces: Int[np.ndarray, "m 3"]


def used_vertices(faces: Int[np.ndarray, "m 3"], count: int) -> Used:
    """The vertices of ``count`` that ``faces`` use, and the same triangles over these alone."""
    used = np.zeros(count, bool)
    used[faces] = True
    return Used(np.flatnonzero(used), (np.cumsum(used) - 1)[faces])


def _on_bad_edges(faces: Int[np.ndarray, "m 3"], merit: Float[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """The worst triangle of each edge that has more than two or two that run along it the same way."""
    shared = adjacency(faces)
    bad_edge = shared.faces > 2
    bad_edge[shared.pair_edge[shared.turned]] = True
    bad = np.zeros(len(faces), bool)
    if bad_edge.any():
        face, side = np.nonzero(bad_edge[shared.edge_of])
        edge = shared.edge_of[face, side]
        order = np.lexsort((merit[face], edge))
        first = np.concatenate([[True], np.diff(edge[order]) != 0])
        bad[face[order[first]]] = True
    return bad


def _in_lesser_fans(faces: Int[np.ndarray, "m 3"], fixed: Bool[np.ndarray, " n"] | None) -> Bool[np.ndarray, " m"]:
    """Triangles of all but the largest fan around each vertex."""
    fan = fans(faces)
    size = np.bincount(fan)
    vertex_of = np.zeros(len(size), np.int64)
    vertex_of[fan] = faces.reshape(-1)
    order = np.lexsort((-size, vertex_of))
    lesser = np.concatenate([[False], np.diff(vertex_of[order]) == 0])
    small = np.zeros(len(size), bool)
    small[order[lesser]] = True
    if fixed is not None:
        small &= ~fixed[vertex_of]
    return np.asarray(small[fan].reshape(-1, 3).any(axis=1))


def fans(faces: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, " c"]:
    """The fan each of the ``3 m`` corners belongs to: corners at one vertex joined through shared edges."""
    shared = adjacency(faces)
    first, second = shared.pairs.T
    links = []
    for end in (0, 1):
        vertex = shared.edges[shared.pair_edge, end]
        links.append(
            np.stack([3 * f + np.argmax(faces[f] == vertex[:, None], axis=1) for f in (first, second)], axis=1)
        )
    joined = np.concatenate(links) if links else np.zeros((0, 2), np.int64)
    count = 3 * len(faces)
    graph = coo_matrix((np.ones(len(joined), bool), (joined[:, 0], joined[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]
