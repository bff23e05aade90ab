"""Control points from a decimated mesh (thesis §2.4.2, decimation; MISSION control points B).

The range image's grid is triangulated and simplified by edge collapse until a given number of vertices is left. The
points gather where the surface bends: prefer them to plain subsampling on objects with large flat parts. Quadric
decimation (Garland and Heckbert 1997) moves vertices; snapped, they are measured points again, as the thesis requires.
"""

from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.range_image import RangeImage, grid_triangles

_TOLERANCE = 0.01  # share of the count within which the search stops
_ATTEMPTS = 8


class Mesh(NamedTuple):
    """Vertices in the sensor frame and the triangles between them (indices into ``vertices``)."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "f 3"]


def mesh_control_points(
    image: RangeImage, count: int, at: Literal["vertices", "centres"] = "vertices", snap: bool = True
) -> Cloud:
    """Control points of a range image from its decimated grid triangulation.

    Args:
        image: the range image, sensor frame.
        count: how many points are wanted, at least 3; reached within 2 %. More than the full mesh has gives them all.
        at: the mesh's vertices, or the centres of its triangles.
        snap: move each point to the nearest measured point and keep each measured point once.

    Returns:
        Cloud in the sensor frame; normals and border flags are those of the nearest measured point.

    Raises:
        InputError: ``count`` is below 3, the image is not a valid cloud, or it has no triangle (isolated readings).
    """
    if count < 3:
        raise InputError(f"count is {count}, expected at least 3 control points")
    measured = as_cloud(image, "the range image")
    triangles = grid_triangles(image)
    if len(triangles) == 0:
        raise InputError("the range image has no triangle, expected neighbouring readings to make control points from")
    mesh = _without_unused(measured.points, triangles)
    tree = KDTree(measured.points)

    def points_of(reduced: Mesh) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        points = reduced.vertices if at == "vertices" else reduced.vertices[reduced.triangles].mean(axis=1)
        nearest = np.asarray(tree.query(points)[1], dtype=np.int64)
        if snap:
            nearest = np.unique(nearest)
            points = measured.points[nearest]
        return points, nearest

    points, nearest = points_of(mesh)
    if len(points) > count:
        decimation = _Decimation(mesh)
        wanted = count if at == "centres" else 2 * count  # triangles; Euler's formula on a disc
        best = points, nearest
        for _ in range(_ATTEMPTS):
            points, nearest = points_of(decimation(wanted))
            if abs(len(points) - count) < abs(len(best[0]) - count):
                best = points, nearest
            if abs(len(points) - count) <= _TOLERANCE * count:
                break
            wanted = max(1, round(wanted * count / max(len(points), 1)))
        points, nearest = best
    carried = measured.take(nearest)
    return Cloud(points=points, normals=carried.normals, border=carried.border)


class _Decimation:
    """Quadric decimation of one mesh to any number of triangles.

    Open3D compares a determinant with an absolute number, so it is given the mesh centred and with a median edge of
    1: the result is the same in every unit and far from the origin.
    """

    def __init__(self, mesh: Mesh) -> None:
        import open3d

        corners = mesh.vertices[mesh.triangles].astype(np.float64)
        self.centre = mesh.vertices.mean(axis=0, dtype=np.float64)
        self.edge = float(np.median(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1))) or 1.0
        self.source: Any = open3d.geometry.TriangleMesh(
            open3d.utility.Vector3dVector((mesh.vertices - self.centre) / self.edge),
            open3d.utility.Vector3iVector(mesh.triangles.astype(np.int32)),
        )

    def __call__(self, triangles: int) -> Mesh:
        reduced = self.source.simplify_quadric_decimation(triangles)
        vertices = np.asarray(reduced.vertices) * self.edge + self.centre
        return _without_unused(vertices, np.asarray(reduced.triangles))


def _without_unused(vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "f 3"]) -> Mesh:
    """The same triangles without the vertices that none of them uses, order kept."""
    used, renumbered = np.unique(triangles, return_inverse=True)
    return Mesh(vertices[used], renumbered.reshape(-1, 3))
