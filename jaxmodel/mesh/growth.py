"""One pass of ball pivoting where a mesh is open, welded to what is there already (thesis §3.3.7)."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import adjacency

ZONE = 4.0


def grow(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    radius: float,
    zone: Bool[np.ndarray, " n"] | None = None,
) -> Int[np.ndarray, "k 3"]:
    """``faces`` and the triangles a ball of ``radius`` finds among the points within four radii of an open vertex.

    Open are the vertices of border edges and the points without triangle, only those in ``zone`` if that is given.
    What the ball finds is kept where it fits (see :func:`weld`).
    """
    loose = open_vertices(faces, len(points))
    if zone is not None:
        loose &= zone
    if not loose.any():
        return faces
    if loose.all():
        near = np.arange(len(points))
    else:
        gap, _ = KDTree(points[loose]).query(points, distance_upper_bound=ZONE * radius, workers=-1)
        near = np.flatnonzero(np.isfinite(gap))
    found = near[pivot(points[near], normals[near], radius)]
    return weld(faces, found, len(points))


def pivot(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], radius: float) -> Int[np.ndarray, "m 3"]:
    """Triangles a ball of ``radius`` finds by rolling over oriented points (Open3D; Bernardini et al., 1999).

    Computed about the cloud's centre in units of the radius, so neither origin nor unit matters.
    """
    if len(points) < 3:
        return np.zeros((0, 3), np.int64)
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector((points - points.mean(axis=0)) / radius))
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


def weld(faces: Int[np.ndarray, "m 3"], found: Int[np.ndarray, "k 3"], count: int) -> Int[np.ndarray, "j 3"]:
    """``faces`` and those of ``found`` that join them: corners open, no side along one of theirs the same way."""
    if len(faces) == 0:
        return found
    loose = open_vertices(faces, count)
    found = found[loose[found].all(axis=1)]
    taken = np.unique(_directed(faces, count))
    free = ~np.isin(_directed(found, count), taken).reshape(-1, 3).any(axis=1)
    return np.concatenate([faces, found[free]])


def _directed(faces: Int[np.ndarray, "m 3"], count: int) -> Int[np.ndarray, " c"]:
    return (faces * count + faces[:, [1, 2, 0]]).reshape(-1)
