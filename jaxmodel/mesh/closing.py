"""From what the ball left to one surface: folds and crowded edges dropped, and the holes that were seen closed."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.holes import MOST_EDGES, Accept, close_holes, patch_over, ring_outline
from jaxmodel.mesh.manifold import clean

RINGS = 3


def near_points(tree: KDTree, reach: float, vertices: Float[np.ndarray, "n 3"]) -> Accept:
    """Takes a patch if the middles of all its triangles and sides are within ``reach`` of a measured point."""
    return lambda patch: bool(along_points(tree, reach, vertices, patch).all())


def along_points(
    tree: KDTree, reach: float, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "k 3"]
) -> Bool[np.ndarray, " k"]:
    """Triangles whose middle and whose sides' middles are all within ``reach`` of a measured point."""
    corners = vertices[faces]
    middles = np.concatenate([corners.mean(axis=1, keepdims=True), (corners + corners[:, [1, 2, 0]]) / 2], axis=1)
    gap, _ = tree.query(middles, distance_upper_bound=reach)
    return np.asarray(np.isfinite(gap).all(axis=1))


def close(
    vertices: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    most_edges: int = MOST_EDGES,
    accept: Accept = lambda patch: True,
    fixed: Bool[np.ndarray, " n"] | None = None,
) -> Int[np.ndarray, "k 3"]:
    """``faces`` as a manifold (see :func:`jaxmodel.mesh.manifold.clean`) with its holes closed where ``accept`` lets.

    Where no patch fits, the triangles around the hole are in the way: up to three rings of them give way to one
    patch over the larger hole. Triangles beyond ``faces`` meet them in ``fixed`` vertices only, and still do after.
    """
    fixed = np.zeros(len(vertices), bool) if fixed is None else fixed
    faces = clean(vertices, normals, faces, fixed)
    patches, stuck = close_holes(vertices, normals, faces, most_edges, accept, fixed)
    faces = np.concatenate([faces, patches])
    for loop in stuck:
        faces = _wider_patch(vertices, normals, faces, loop, accept, fixed)
    return clean(vertices, normals, faces, fixed)


def _wider_patch(
    vertices: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    loop: Int[np.ndarray, " b"],
    accept: Accept,
    fixed: Bool[np.ndarray, " n"],
) -> Int[np.ndarray, "k 3"]:
    """``faces`` with the hole ``loop`` and the rings around it replaced by one patch, or as they are if none fits."""
    inside = np.zeros(len(vertices), bool)
    inside[loop] = True
    for _ in range(RINGS):
        ring = inside[faces].any(axis=1)
        outline = ring_outline(faces[ring], loop)
        rest = faces[~ring]
        if fixed[faces[ring]].any():
            break
        if outline is not None:
            patch = patch_over(vertices, normals, rest, outline)
            if patch is not None and accept(patch):
                return np.concatenate([rest, patch])
        inside[faces[ring]] = True
    return faces
