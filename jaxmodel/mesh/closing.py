"""From what the ball left to one surface: folds and crowded edges dropped, and the holes that were seen closed."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import adjacency
from jaxmodel.mesh.holes import MOST_EDGES, Accept, close_holes
from jaxmodel.mesh.manifold import clean

ROUNDS = 4


def near_points(tree: KDTree, reach: float, vertices: Float[np.ndarray, "n 3"]) -> Accept:
    """Takes a patch if the middles of all its triangles and sides are within ``reach`` of a measured point."""

    def accept(patch: Int[np.ndarray, "k 3"]) -> bool:
        corners = vertices[patch]
        middles = (corners + corners[:, [1, 2, 0]]).reshape(-1, 3) / 2
        gap, _ = tree.query(np.concatenate([corners.mean(axis=1), middles]), distance_upper_bound=reach)
        return bool(np.isfinite(gap).all())

    return accept


def close(
    vertices: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    most_edges: int = MOST_EDGES,
    accept: Accept = lambda patch: True,
) -> Int[np.ndarray, "k 3"]:
    """``faces`` as a manifold (see :func:`jaxmodel.mesh.manifold.clean`) with its holes closed where ``accept`` lets.

    Where no patch fits, the triangles around the hole are in the way: they are taken out and the larger hole is
    tried, up to four times. The round with the shortest border is returned.
    """
    best, shortest = faces, np.inf
    faces = clean(vertices, normals, faces)
    for _ in range(ROUNDS):
        patches, stuck = close_holes(vertices, normals, faces, most_edges, accept)
        faces = clean(vertices, normals, np.concatenate([faces, patches]))
        length = border_length(vertices, faces)
        if length < shortest:
            best, shortest = faces, length
        if not stuck:
            break
        ring = np.zeros(len(vertices), bool)
        ring[np.concatenate(stuck)] = True
        faces = clean(vertices, normals, faces[~ring[faces].any(axis=1)])
    return best


def border_length(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> float:
    """Total length of the edges with one triangle."""
    shared = adjacency(faces)
    ends = vertices[shared.edges[shared.faces == 1]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())
