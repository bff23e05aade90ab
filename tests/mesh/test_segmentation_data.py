"""Segmentation of a CAD part, exact and with noise, against the smooth faces of the CAD mesh."""

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.io.meshes import load_mesh
from jaxmodel.mesh import Segmentation, segment
from jaxmodel.mesh.adjacency import adjacency, face_components, face_normals, face_vectors
from jaxmodel.mesh.agreement import Agreement, agreement
from jaxmodel.scan.polyhedron import subdivided
from jaxmodel.scan.triangle_mesh import ObjectMesh

CREASE_DEG = 12.0
"""Angle between triangles of the CAD mesh from which an edge parts two of its smooth faces: 20 faces."""


@pytest.fixture(scope="module")
def fandisk(data_dir: Path) -> ObjectMesh:
    return load_mesh(data_dir / "meshes" / "fandisk.obj")


def smooth_faces(mesh: ObjectMesh) -> np.ndarray:
    """The parts of a CAD mesh that hang together across edges that are no crease."""
    shared, normals = adjacency(mesh.faces), face_normals(mesh.vertices, mesh.faces)
    cosine = np.einsum("ij,ij->i", *(normals[side] for side in shared.pairs.T))
    return face_components(len(mesh.faces), shared.pairs[cosine > np.cos(np.deg2rad(CREASE_DEG))])[1]


def measured(mesh: ObjectMesh, times: int, noise: float) -> tuple[Segmentation, Agreement, Agreement]:
    """Segments of the mesh cut finer with noise, and how its segments and its smooth parts agree with the CAD faces."""
    fine = subdivided(mesh, times)
    truth = np.repeat(smooth_faces(mesh), 4**times)
    areas = np.linalg.norm(face_vectors(fine.vertices, fine.faces), axis=1) / 2
    scatter = noise * mesh.size() * np.random.default_rng(1).normal(size=fine.vertices.shape)
    found = segment(ObjectMesh(fine.vertices + scatter, fine.faces))
    return found, agreement(found.labels, truth, areas), agreement(found.parts, truth, areas)


CASES = [(0, 0.0), (0, 5e-4), (0, 1e-3), (1, 0.0), (1, 5e-4), (1, 1e-3)]


@pytest.mark.data
@pytest.mark.parametrize(("times", "noise"), CASES)
def test_segments_lie_within_the_faces_of_a_cad_part(fandisk: ObjectMesh, times: int, noise: float) -> None:
    found, segments, parts = measured(fandisk, times, noise)
    assert segments.purity >= 0.9 and parts.purity >= 0.9
    area = sum(primitive.area for primitive in found.primitives)
    assert found.primitives[0].kind == "plane" and found.primitives[0].area > 0.2 * area
    assert found.count("plane") >= 8
    if (times, noise) == (1, 0.0):
        return  # cut finer without noise, its cylinders have vertices on their chords: exactly polyhedra
    radii = np.array([p.radius for p in found.primitives if p.kind == "cylinder" and p.area > 0.02 * area])
    for radius in (2.125, 1.642):
        assert np.abs(radii / radius - 1).min() < (1e-3 if noise == 0 else 0.01)


SHORT = pytest.mark.xfail(
    strict=True, reason="0.884: two faces 22 degrees apart, two triangles wide, are smoothed into one"
)


@pytest.mark.data
@pytest.mark.parametrize(
    ("times", "noise"), [pytest.param(*case, marks=SHORT if case == (1, 5e-4) else ()) for case in CASES]
)
def test_smooth_parts_are_the_faces_of_a_cad_part(fandisk: ObjectMesh, times: int, noise: float) -> None:
    assert measured(fandisk, times, noise)[2].matched >= 0.9


@pytest.mark.data
def test_the_exact_part_has_its_sphere(fandisk: ObjectMesh) -> None:
    found = segment(fandisk)
    spheres = [primitive for primitive in found.primitives if primitive.kind == "sphere"]
    assert len(spheres) == 1 and spheres[0].radius == pytest.approx(13.61, rel=1e-3)
    assert all(p.largest < 1e-3 * fandisk.size() for p in found.primitives if p.kind != "free-form")


@pytest.mark.data
def test_an_animal_has_no_large_planes(data_dir: Path) -> None:
    found = segment(load_mesh(data_dir / "meshes" / "spot.obj"))
    area = sum(primitive.area for primitive in found.primitives)
    assert sum(p.area for p in found.primitives if p.kind == "free-form") > 0.95 * area
    assert all(p.area < 0.01 * area for p in found.primitives if p.kind == "plane")
