"""Holes of a mesh and the triangles that close them (minimum-weight triangulation; Barequet and Sharir, 1995)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.mesh.adjacency import adjacency

MOST_EDGES = 100
Accept = Callable[[Int[np.ndarray, "k 3"]], bool]


def border_loops(faces: Int[np.ndarray, "m 3"]) -> list[Int[np.ndarray, " b"]]:
    """Vertices around each hole, in the order in which triangles that close it run along the border.

    ``faces`` is consistently oriented with one fan a vertex, as :func:`jaxmodel.mesh.manifold.clean` leaves it.
    """
    shared = adjacency(faces)
    start, end = faces.reshape(-1), faces[:, [1, 2, 0]].reshape(-1)
    open_side = shared.faces[shared.edge_of.reshape(-1)] == 1
    after = dict(zip(end[open_side].tolist(), start[open_side].tolist(), strict=True))
    loops = []
    while after:
        first, vertex = after.popitem()
        loop = [first]
        while vertex != first:
            loop.append(vertex)
            vertex = after.pop(vertex)
        loops.append(np.array(loop))
    return loops


class Closing(NamedTuple):
    """``patches`` close holes; ``stuck`` are the loops that a patch was allowed for and none is possible."""

    patches: Int[np.ndarray, "k 3"]
    stuck: list[Int[np.ndarray, " b"]]


def close_holes(
    vertices: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    most_edges: int = MOST_EDGES,
    accept: Accept = lambda patch: True,
) -> Closing:
    """Triangles for every hole of at most ``most_edges`` edges whose patch ``accept`` takes, small holes first.

    A patch adds no vertex. One that would have to fold over, or to repeat an edge of the mesh, is not possible.
    """
    count = len(vertices)
    taken = set(_keys(adjacency(faces).edges, count).tolist())
    patches, stuck = [np.zeros((0, 3), np.int64)], []
    for loop in sorted(border_loops(faces), key=len):
        if len(loop) > most_edges:
            break
        cut = triangulate(vertices[loop], normals[loop], _blocked(loop, taken, count))
        if cut is None:
            stuck.append(loop)
        elif accept(loop[cut]):
            patches.append(loop[cut])
            sides = patches[-1][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
            taken.update(_keys(sides, count).tolist())
    return Closing(np.concatenate(patches), stuck)


def _keys(edges: Int[np.ndarray, "e 2"], count: int) -> Int[np.ndarray, " e"]:
    return edges.min(axis=1) * count + edges.max(axis=1)


def _blocked(loop: Int[np.ndarray, " b"], taken: set[int], count: int) -> Bool[np.ndarray, "b b"]:
    """Which pairs of the loop's vertices are an edge already, the loop's own edges apart."""
    size = len(loop)
    keys = np.minimum.outer(loop, loop) * count + np.maximum.outer(loop, loop)
    blocked = np.array([key in taken for key in keys.reshape(-1).tolist()]).reshape(size, size)
    here, after = np.arange(size), np.roll(np.arange(size), -1)
    blocked[here, after] = blocked[after, here] = False
    return blocked


def triangulate(
    corners: Float[np.ndarray, "b 3"], normals: Float[np.ndarray, "b 3"], blocked: Bool[np.ndarray, "b b"]
) -> Int[np.ndarray, "k 3"] | None:
    """The ``b - 2`` triangles over a closed polygon in space of least total weight, or None if all are impossible.

    Weight is squared perimeter, more where the triangle leans away from its corners' ``normals``: compact triangles
    along the surface. Impossible are a triangle facing the other way and a diagonal that is ``blocked``.
    """
    size = len(corners)
    best = np.full((size, size), np.inf)
    best[np.arange(size - 1), np.arange(1, size)] = 0.0
    middle = np.zeros((size, size), np.int64)
    for gap in range(2, size):
        i = np.arange(size - gap)
        k = i + gap
        m = i[:, None] + np.arange(1, gap)
        total = best[i[:, None], m] + best[m, k[:, None]] + _weight(corners, normals, i[:, None], m, k[:, None])
        choice = np.argmin(total, axis=1)
        value = total[i, choice]
        value[blocked[i, k]] = np.inf
        best[i, k], middle[i, k] = value, m[i, choice]
    if not np.isfinite(best[0, -1]):
        return None
    triangles, spans = [], [(0, size - 1)]
    while spans:
        i, k = spans.pop()
        if k - i > 1:
            m = int(middle[i, k])
            triangles.append((i, m, k))
            spans += [(i, m), (m, k)]
    return np.array(triangles)


def _weight(corners: np.ndarray, normals: np.ndarray, i: np.ndarray, m: np.ndarray, k: np.ndarray) -> np.ndarray:
    a, b, c = corners[i], corners[m], corners[k]
    face = np.cross(b - a, c - a)
    mean = normals[i] + normals[m] + normals[k]
    scale = np.linalg.norm(face, axis=-1) * np.linalg.norm(mean, axis=-1)
    lean = np.einsum("...a,...a->...", face, np.broadcast_to(mean, face.shape)) / np.where(scale > 0, scale, 1.0)
    perimeter = sum(np.linalg.norm(q - p, axis=-1) for p, q in ((a, b), (b, c), (c, a)))
    return np.where(lean > 0, perimeter**2 * (2.0 - lean), np.inf)
