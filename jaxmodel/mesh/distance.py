"""Distances between two surfaces, both ways, from points spread evenly over each."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import face_vectors
from jaxmodel.scan.triangle_mesh import ObjectMesh

SAMPLES = 100_000


class OneWay(NamedTuple):
    """Distances of points of one surface from the other, in the meshes' unit."""

    mean: float
    rms: float
    percentile_95: float
    largest: float


class SurfaceDistance(NamedTuple):
    """``there``: from the mesh to the reference; ``back``: from the reference to the mesh."""

    there: OneWay
    back: OneWay

    @property
    def mean(self) -> float:
        """The larger of both means."""
        return max(self.there.mean, self.back.mean)

    @property
    def hausdorff(self) -> float:
        """The largest distance either way, of the sampled points."""
        return max(self.there.largest, self.back.largest)


def surface_distance(mesh: ObjectMesh, reference: ObjectMesh, samples: int = SAMPLES, seed: int = 0) -> SurfaceDistance:
    """Distances from ``samples`` points of each surface, spread evenly by area, to the other surface."""
    for name, given in (("mesh", mesh), ("reference", reference)):
        if len(given.faces) == 0:
            raise InputError(f"The {name} has no triangles: there is no distance to it.")
    there = _summary(to_surface(sample_surface(mesh, samples, seed), reference))
    return SurfaceDistance(there, _summary(to_surface(sample_surface(reference, samples, seed + 1), mesh)))


def sample_surface(mesh: ObjectMesh, samples: int, seed: int = 0) -> Float[np.ndarray, "s 3"]:
    """Points spread over a mesh by area: evenly spaced along the running area, at random within each triangle."""
    area = np.cumsum(np.linalg.norm(face_vectors(mesh.vertices, mesh.faces), axis=1))
    random = np.random.default_rng(seed)
    place = (np.arange(samples) + random.random(samples)) * (area[-1] / samples)
    face = np.minimum(np.searchsorted(area, place, side="right"), len(area) - 1)
    u, v = random.random((2, samples))
    outside = u + v > 1
    u, v = np.where(outside, 1 - u, u)[:, None], np.where(outside, 1 - v, v)[:, None]
    a, b, c = (mesh.vertices[mesh.faces[face, k]] for k in range(3))
    return a + u * (b - a) + v * (c - a)


def to_surface(points: Float[np.ndarray, "s 3"], mesh: ObjectMesh) -> Float[np.ndarray, " s"]:
    """Distance of each point from the nearest triangle (Open3D, float32 about the mesh's centre)."""
    import open3d as o3d

    centre = mesh.vertices.mean(axis=0)
    scene = o3d.t.geometry.RaycastingScene()
    corners = o3d.core.Tensor(np.ascontiguousarray(mesh.vertices - centre, np.float32))
    scene.add_triangles(corners, o3d.core.Tensor(np.ascontiguousarray(mesh.faces, np.uint32)))
    found = scene.compute_distance(o3d.core.Tensor(np.ascontiguousarray(points - centre, np.float32)))
    return found.numpy().astype(np.float64)


def _summary(distance: Float[np.ndarray, " s"]) -> OneWay:
    return OneWay(
        float(distance.mean()),
        float(np.sqrt(np.mean(distance**2))),
        float(np.quantile(distance, 0.95)),
        float(distance.max()),
    )


def distance_to_points(queries: Float[np.ndarray, "s 3"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " s"]:
    """Distance of each query from the nearest point."""
    return np.asarray(KDTree(points).query(queries, workers=-1)[0])
