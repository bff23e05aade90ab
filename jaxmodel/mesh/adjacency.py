"""Which triangles share an edge, and what follows from it alone: borders, components, orientation, Euler number."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxmodel.scan.triangle_mesh import ObjectMesh


class Adjacency(NamedTuple):
    """The edges of ``m`` triangles over ``n`` vertices.

    ``edges`` end vertices, smaller number first; ``edge_of`` edge of each triangle's sides (v0 v1, v1 v2, v2 v0);
    ``faces`` how many triangles an edge has. ``pairs`` are the triangles on both sides of the edges that have exactly
    two, ``pair_edge`` that edge, ``turned`` whether both run along it the same way (then one of them is inside out).
    """

    edges: Int[np.ndarray, "e 2"]
    edge_of: Int[np.ndarray, "m 3"]
    faces: Int[np.ndarray, " e"]
    pairs: Int[np.ndarray, "p 2"]
    pair_edge: Int[np.ndarray, " p"]
    turned: Bool[np.ndarray, " p"]


def adjacency(faces: Int[np.ndarray, "m 3"]) -> Adjacency:
    """The edges of a set of triangles and who shares them; linear in memory, a sort in time."""
    start, end = faces.reshape(-1), faces[:, [1, 2, 0]].reshape(-1)
    count = int(faces.max()) + 1 if len(faces) else 1
    key = np.minimum(start, end).astype(np.int64) * count + np.maximum(start, end)
    order = np.argsort(key)
    ranked = key[order]
    new = np.ones(len(key), bool)
    new[1:] = ranked[1:] != ranked[:-1]
    first = np.flatnonzero(new)
    unique, per_edge = ranked[first], np.diff(first, append=len(key))
    edge_of = np.empty(len(key), np.int64)
    edge_of[order] = np.cumsum(new) - 1
    double = np.flatnonzero(per_edge == 2)
    one, other = order[first[double]], order[first[double] + 1]
    sides = np.stack([np.minimum(one, other), np.maximum(one, other)], axis=1)
    return Adjacency(
        edges=np.stack(np.divmod(unique, count), axis=1),
        edge_of=edge_of.reshape(-1, 3),
        faces=per_edge,
        pairs=sides // 3,
        pair_edge=double,
        turned=start[sides[:, 0]] == start[sides[:, 1]],
    )


def face_components(count: int, links: Int[np.ndarray, "p 2"]) -> tuple[int, Int[np.ndarray, " m"]]:
    """How many parts ``count`` triangles fall into when those in ``links`` hang together, and the part of each."""
    graph = coo_matrix((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)


def boundary_loops(shared: Adjacency) -> tuple[Int[np.ndarray, " b"], Int[np.ndarray, " b"], int]:
    """The edges with one triangle, the loop each belongs to, and the number of loops.

    Loops that touch in a vertex count as one.
    """
    edges = np.flatnonzero(shared.faces == 1)
    ends, inverse = np.unique(shared.edges[edges], return_inverse=True)
    inverse = inverse.reshape(-1, 2)
    graph = coo_matrix((np.ones(len(edges), bool), (inverse[:, 0], inverse[:, 1])), shape=(len(ends), len(ends)))
    loops, label = connected_components(graph, directed=False)
    return edges, label[inverse[:, 0]], loops if len(edges) else 0


def face_vectors(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Twice the area of each triangle along its normal."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def border_length(vertices: Float[np.ndarray, "n 3"], shared: Adjacency) -> float:
    """Total length of the edges with one triangle."""
    ends = vertices[shared.edges[shared.faces == 1]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())


def face_normals(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Unit normals, counter-clockwise seen from outside; zero for a triangle without area."""
    vectors = face_vectors(vertices, faces)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def vertex_normals(mesh: ObjectMesh) -> Float[np.ndarray, "n 3"]:
    """Unit normals at the vertices, the mean of their triangles' by area; zero without a triangle."""
    total = np.zeros(mesh.vertices.shape)
    vectors = face_vectors(mesh.vertices, mesh.faces)
    for axis in range(3):
        total[:, axis] = np.bincount(mesh.faces.reshape(-1), np.repeat(vectors[:, axis], 3), len(mesh.vertices))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0, length, 1.0)
