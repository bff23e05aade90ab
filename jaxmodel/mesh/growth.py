"""One pass of ball pivoting where a mesh is open, welded to what is there already (thesis §3.3.7)."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import adjacency

ZONE = 2.1  # in radii: a ball on an open vertex touches nothing further than two
HAIR = 1e-4


def grow(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    radius: float,
    fixed: Bool[np.ndarray, " n"] | None = None,
    sheet: Int[np.ndarray, " n"] | None = None,
) -> Int[np.ndarray, "k 3"]:
    """``faces`` and the triangles a ball of ``radius`` finds among the points within its diameter of an open vertex.

    Open are the vertices of border edges and the points without triangle, but for those that are ``fixed``.
    A ball for each number of ``sheet`` rolls over the points that have it alone. What the ball finds is kept where it
    fits (see :func:`weld`).
    """
    loose = open_vertices(faces, len(points))
    if fixed is not None:
        loose &= ~fixed
    if not loose.any():
        return faces
    if loose.all():
        near = np.arange(len(points))
    else:
        gap, _ = KDTree(points[loose]).query(points, distance_upper_bound=ZONE * radius, workers=-1)
        near = np.flatnonzero(np.isfinite(gap))
    number = np.zeros(len(points), np.int64) if sheet is None else sheet
    for k in np.unique(number[near]):
        mine = near[number[near] == k]
        faces = weld(faces, mine[pivot(points[mine], normals[mine], radius)], loose)
    return faces


def pivot(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], radius: float) -> Int[np.ndarray, "m 3"]:
    """Triangles a ball of ``radius`` finds by rolling over oriented points (Open3D; Bernardini et al., 1999).

    Computed about the cloud's centre in units of the radius, so neither origin nor unit matters. The ball meets each
    point a hair (1e-4 radii) beside its place: four points on one circle, as in every regular grid, would otherwise be
    meshed both ways at once.
    """
    if len(points) < 3:
        return np.zeros((0, 3), np.int64)
    import open3d as o3d

    hair = HAIR * np.random.default_rng(0).uniform(-1.0, 1.0, points.shape)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector((points - points.mean(axis=0)) / radius + hair))
    cloud.normals = o3d.utility.Vector3dVector(normals)
    found = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(cloud, o3d.utility.DoubleVector([1.0]))
    return np.asarray(found.triangles).astype(np.int64).reshape(-1, 3)


def open_vertices(faces: Int[np.ndarray, "m 3"], count: int) -> Bool[np.ndarray, " n"]:
    """Which of ``count`` points lie on a border edge or on no triangle."""
    shared = adjacency(faces)
    loose = np.ones(count, bool)
    loose[faces] = False
    loose[shared.edges[shared.faces == 1]] = True
    return loose


def weld(
    faces: Int[np.ndarray, "m 3"], found: Int[np.ndarray, "k 3"], loose: Bool[np.ndarray, " n"]
) -> Int[np.ndarray, "j 3"]:
    """``faces`` and those of ``found`` that join them: all corners ``loose``, no side along one of theirs the same way.

    Triangles of empty balls never cross: what fits at its sides fits.
    """
    found = found[loose[found].all(axis=1)]
    near = np.zeros(len(loose), bool)
    near[found] = True
    taken = np.sort(_directed(faces[near[faces].any(axis=1)], len(loose)))
    wanted = _directed(found, len(loose))
    place = np.searchsorted(taken, wanted)
    free = np.append(taken, -1)[place] != wanted
    return np.concatenate([faces, found[free.reshape(-1, 3).all(axis=1)]])


def _directed(faces: Int[np.ndarray, "m 3"], count: int) -> Int[np.ndarray, " c"]:
    return (faces * count + faces[:, [1, 2, 0]]).reshape(-1)


def rests(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], radius: float
) -> Bool[np.ndarray, " m"]:
    """Whether a ball of ``radius`` lies on each triangle, on the side of the ``normals``, with no point inside.

    Such triangles never cross one another, whatever they were made by.
    """
    a, b, c = (points[faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    cross = np.cross(u, v)
    square = np.einsum("ma,ma->m", cross, cross)
    flat = square <= 0
    square = np.where(flat, 1.0, square)
    uu, vv = np.einsum("ma,ma->m", u, u), np.einsum("ma,ma->m", v, v)
    offset = (uu[:, None] * np.cross(v, cross) + vv[:, None] * np.cross(cross, u)) / (2 * square)[:, None]
    height = radius**2 - np.einsum("ma,ma->m", offset, offset)
    side = np.sign(np.einsum("ma,ma->m", cross, normals[faces].sum(axis=1)))
    up = cross / np.sqrt(square)[:, None] * side[:, None]
    centre = a + offset + np.sqrt(np.maximum(height, 0.0))[:, None] * up
    gap, _ = KDTree(points).query(centre, workers=-1)
    return ~flat & (height > 0) & (gap > (1 - HAIR) * radius)
