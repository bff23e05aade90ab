"""Screened Poisson reconstruction (Kazhdan and Hoppe 2013) by Open3D: today's comparator."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.mesh.distance import distance_to_points
from jaxmodel.mesh.manifold import used_vertices
from jaxmodel.mesh.prepare import prepare
from jaxmodel.mesh.radii import cloud_scale
from jaxmodel.scan.triangle_mesh import ObjectMesh

DEEPEST = 12


def poisson(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"] | None,
    depth: int | None = None,
    trim_spacings: float | None = 6.0,
) -> ObjectMesh:
    """A smooth mesh that spans gaps, opened where it is further than ``trim_spacings`` from any point.

    Args:
        points, normals: the cloud; normals point outwards, and are estimated where none are given.
        depth: of the octree; by default such that its finest cell is about the cloud's spacing.
        trim_spacings: in spacings of the cloud; None keeps all of it (open only where it leaves the cloud's box).

    Raises:
        InputError: an unusable cloud (see ``orient``) or a depth outside 2 to 12.
    """
    cloud = prepare(points, normals)
    points = cloud.points
    spacing = cloud_scale(points, cloud.tree).spacing
    size = float(np.ptp(points, axis=0).max())
    if depth is None:
        depth = int(np.clip(np.ceil(np.log2(1.1 * size / spacing)), 4, 10))
    if not 2 <= depth <= DEEPEST:
        raise InputError(f"depth is {depth}, expected 2 to {DEEPEST}.")
    import open3d as o3d

    centre = points.mean(axis=0)
    oriented = o3d.geometry.PointCloud(o3d.utility.Vector3dVector((points - centre) / size))
    oriented.normals = o3d.utility.Vector3dVector(cloud.normals)
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error), _without_stderr():
        made, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(oriented, depth=depth, n_threads=1)
    vertices, faces = np.asarray(made.vertices) * size + centre, np.asarray(made.triangles, np.int64)
    if trim_spacings is not None:
        near = distance_to_points(vertices, points) <= trim_spacings * spacing
        faces = faces[near[faces].all(axis=1)]
        used, faces = used_vertices(faces, len(vertices))
        vertices = vertices[used]
    return ObjectMesh(vertices, faces)


@contextmanager
def _without_stderr() -> Iterator[None]:
    """The solver within Open3D writes "getValue assumes leaf node" there, whatever the verbosity; failures raise."""
    try:
        kept = os.dup(2)
    except OSError:  # a process without one
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
