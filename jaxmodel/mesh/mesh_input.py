"""A mesh made ready for measures that need a frame: checked, centred, of size 1, its sides found, its normals alike."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import Adjacency, adjacency
from jaxmodel.scan.triangle_mesh import ObjectMesh

STRAIGHT = np.cos(np.deg2rad(30.0))
"""Cosine of the largest bend of a surface that goes on through an edge where others meet it."""
LOOSE = 0.5
"""Part of the edges without a neighbour from which corners of equal coordinates are taken as one."""


class Frame(NamedTuple):
    """``given = scale * inner + centre``."""

    centre: Float[np.ndarray, "3"]
    scale: float


def checked(mesh: ObjectMesh) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"], Frame]:
    """Vertices about the middle of their box, its longest side 1, the triangles, and the frame.

    Vertices that no triangle uses are left where they are and do not count. Raises ``InputError`` for a mesh that has
    no triangles, corners outside its vertices, coordinates that are no numbers, or no area.
    """
    given, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    if given.ndim != 2 or given.shape[1] != 3 or faces.ndim != 2 or (len(faces) and faces.shape[1] != 3):
        raise InputError(f"A mesh has vertices (n, 3) and triangles (m, 3), not {given.shape} and {faces.shape}.")
    if len(faces) == 0:
        raise InputError("The mesh has no triangles: there is nothing to segment.")
    faces = faces.astype(np.int64)
    wrong = np.flatnonzero(((faces < 0) | (faces >= len(given))).any(axis=1))
    if len(wrong):
        raise InputError(f"Triangle {wrong[0]} has corners {faces[wrong[0]]}, but there are {len(given)} vertices.")
    used = np.zeros(len(given), bool)
    used[faces] = True
    bad = np.flatnonzero(used & ~np.isfinite(given).all(axis=1))
    if len(bad):
        raise InputError(f"Vertex {bad[0]} of the mesh is {given[bad[0]]}: its coordinates must be finite numbers.")
    low, high = given[used].min(axis=0), given[used].max(axis=0)
    scale = float((high - low).max())
    frame = Frame((low + high) / 2, scale if scale > 0 else 1.0)
    inner = np.where(used[:, None], (given - frame.centre) / frame.scale, 0.0)
    a, b, c = (inner[faces[:, k]] for k in range(3))
    if not (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0).any():
        raise InputError("Every triangle of the mesh is degenerate (its corners coincide or lie on a line).")
    return inner, faces, frame


def connected(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Adjacency:
    """Who shares an edge; corners at the same place are one where the triangles come loose, as in an STL file.

    Where more than two triangles meet in an edge, those that go straight on through it are neighbours.
    """
    shared = adjacency(faces)
    if (shared.faces == 1).mean() > LOOSE:
        faces = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)[faces]
        shared = adjacency(faces)
    if not (shared.faces > 2).any():
        return shared
    pairs, edge, turned = _straight_on(vertices, faces, shared)
    order = np.argsort(np.concatenate([shared.pair_edge, edge]), kind="stable")
    return shared._replace(
        pairs=np.concatenate([shared.pairs, pairs])[order],
        pair_edge=np.concatenate([shared.pair_edge, edge])[order],
        turned=np.concatenate([shared.turned, turned])[order],
    )


def _straight_on(vertices, faces, shared: Adjacency):
    """Pairs of triangles on crowded edges that have each other as the straightest continuation, both once."""
    side = np.flatnonzero(shared.faces[shared.edge_of.reshape(-1)] > 2)
    side = side[np.argsort(shared.edge_of.reshape(-1)[side], kind="stable")]
    edge, face, corner = shared.edge_of.reshape(-1)[side], side // 3, side % 3
    start, end, far = (faces[face, (corner + k) % 3] for k in range(3))
    along = vertices[end] - vertices[start]
    away = vertices[far] - vertices[start]
    away = away - (np.einsum("ij,ij->i", away, along) / np.maximum((along**2).sum(axis=1), 1e-300))[:, None] * along
    away = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    a, b = [], []
    for step in range(1, int(shared.faces.max())):
        same = np.flatnonzero(edge[:-step] == edge[step:])
        a, b = [*a, same], [*b, same + step]
    a, b = np.concatenate(a), np.concatenate(b)
    cosine = np.einsum("ij,ij->i", away[a], away[b])
    best = np.full(len(side), -STRAIGHT)
    np.minimum.at(best, a, cosine)
    np.minimum.at(best, b, cosine)
    mutual = (cosine == best[a]) & (cosine == best[b])
    a, b = a[mutual], b[mutual]
    return np.stack([face[a], face[b]], axis=1), edge[a], start[a] == start[b]


def turned_alike(vectors: Float[np.ndarray, "m 3"], shared: Adjacency) -> Float[np.ndarray, "m 3"]:
    """Normals with those of triangles turned over that face against most of their connected part.

    A surface with one side only, such as a Moebius strip, keeps the normals it has.
    """
    if not shared.turned.any():
        return vectors
    count = len(vectors)
    i, j = shared.pairs.T
    other = shared.turned * count
    # every triangle twice, as it is and turned: two sides of one part never meet unless it has one side only
    start, end = np.concatenate([i, i + count]), np.concatenate([j + other, j + count - other])
    graph = coo_matrix((np.ones(len(start), bool), (start, end)), shape=(2 * count, 2 * count))
    number, part = connected_components(graph, directed=False)
    size = np.bincount(part[:count], minlength=number)
    turn = size[part[count:]] > size[part[:count]]
    tie = size[part[count:]] == size[part[:count]]
    turn |= tie & (part[count:] < part[:count])
    return np.where(turn[:, None], -vectors, vectors)
