"""Marching cubes and Poisson on surfaces with known topology, area and volume."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.mesh.distance import sample_surface, surface_distance
from jaxmodel.mesh.marching_cubes import marching_cubes
from jaxmodel.mesh.poisson import poisson
from jaxmodel.mesh.quality import quality
from jaxmodel.scan.triangle_mesh import ObjectMesh, icosphere, ring

TORUS = ring(1, 0.4, 160, 60)
SPHERE = icosphere(5)
METHODS = [marching_cubes, poisson]


def volume(mesh: ObjectMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("surface", "euler"), [(SPHERE, 2), (TORUS, 0)])
def test_closed_surfaces_from_points_alone(method, surface: ObjectMesh, euler: int) -> None:
    found = method(sample_surface(surface, 8000), None)
    measured = quality(found)
    assert measured.closed and measured.euler == euler and measured.components == 1
    assert measured.area == pytest.approx(quality(surface).area, rel=0.01)
    assert abs(volume(found)) == pytest.approx(volume(surface), rel=0.01)


@pytest.mark.parametrize("method", METHODS)
def test_normals_decide_which_side_is_outside(method) -> None:
    points = sample_surface(SPHERE, 4000)
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    assert volume(method(points, normals)) > 4
    assert volume(method(points, -normals)) < -4


@pytest.mark.parametrize("method", METHODS)
def test_what_was_not_measured_stays_open(method) -> None:
    points = sample_surface(SPHERE, 8000)
    points = points[points[:, 2] < 0.5]
    found = method(points, points / np.linalg.norm(points, axis=1, keepdims=True))
    measured = quality(found)
    assert measured.border_loops == 1
    assert measured.border_length == pytest.approx(2 * np.pi * np.sqrt(0.75), rel=0.25)
    assert surface_distance(found, SPHERE, 3000).there.percentile_95 < 0.02
    assert quality(poisson(points, points, trim_spacings=None)).area > 1.05 * quality(poisson(points, points)).area


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("method", METHODS)
def test_the_unit_does_not_matter(method, scale: float) -> None:
    points = sample_surface(SPHERE, 3000)
    plain, scaled = method(points, points), method(scale * points, points)
    assert quality(scaled).area / scale**2 == pytest.approx(quality(plain).area, rel=0.002)


def test_smaller_cells_follow_the_surface_more_closely() -> None:
    points = sample_surface(TORUS, 8000)
    coarse, fine = (surface_distance(marching_cubes(points, None, cell), TORUS, 3000).mean for cell in (0.2, 0.08))
    assert fine < 0.5 * coarse


@pytest.mark.parametrize(
    ("cell", "message"), [(0.0, "positive"), (-1.0, "positive"), (float("nan"), "positive"), (1e-4, "would do")]
)
def test_bad_cells(cell: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        marching_cubes(sample_surface(SPHERE, 500), None, cell)


@pytest.mark.parametrize("depth", [1, 13])
def test_bad_depths(depth: int) -> None:
    with pytest.raises(InputError, match="depth"):
        poisson(sample_surface(SPHERE, 500), None, depth)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "points",
    [np.zeros((20, 3)), np.linspace(0, 1, 20)[:, None] * np.ones(3), np.full((20, 3), np.nan), np.zeros((0, 3))],
)
def test_bad_clouds(method, points: np.ndarray) -> None:
    with pytest.raises(InputError):
        method(points, None)


def test_poisson_writes_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    points = sample_surface(icosphere(5), 6000)  # the solver within Open3D warns of such a cloud
    poisson(points, points)
    assert capfd.readouterr() == ("", "")
