"""Normals and borders guessed from neighbourhoods, on surfaces where the right answer is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.scan.estimate import estimate_borders, estimate_normals


def sphere(count: int = 800) -> np.ndarray:
    """A Fibonacci sphere of radius 1."""
    s = np.arange(count) + 0.5
    z, angle = 1 - 2 * s / count, np.pi * (1 + 5**0.5) * s
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def sheet(edge: int = 24, seed: int = 0) -> np.ndarray:
    """A square grid in the plane z = 0 with a little jitter in the plane, spacing 1."""
    grid = np.stack(np.meshgrid(np.arange(edge), np.arange(edge), indexing="ij"), -1).reshape(-1, 2)
    jitter = np.random.default_rng(seed).uniform(-0.2, 0.2, size=grid.shape)
    return np.concatenate([grid + jitter, np.zeros((len(grid), 1))], axis=1)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e3])
def test_normals_of_a_sphere_point_outwards(scale: float) -> None:
    points = sphere()
    normals = estimate_normals(scale * points + 5 * scale)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    assert np.degrees(np.arccos(np.sum(normals * points, axis=1))).max() < 3.0


def test_normals_turn_with_the_points() -> None:
    points = sphere(300) * [1.0, 0.8, 0.5]
    R = Rotation.from_rotvec([0.3, -1.0, 0.8]).as_matrix()
    turned = estimate_normals(points @ R.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(turned, estimate_normals(points) @ R.T, atol=1e-7)


def test_normals_of_a_plane_are_exact() -> None:
    np.testing.assert_allclose(np.abs(estimate_normals(sheet())[:, 2]), 1.0, atol=1e-12)


def test_a_closed_surface_has_no_border() -> None:
    assert estimate_borders(sphere()).sum() == 0


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_the_border_of_a_sheet_is_its_rim(scale: float) -> None:
    edge = 24
    R = Rotation.from_rotvec([0.7, 0.2, -0.4]).as_matrix()
    border = estimate_borders(scale * sheet(edge) @ R.T).reshape(edge, edge)
    inner = np.zeros((edge, edge), bool)
    inner[3:-3, 3:-3] = True
    rim = np.ones((edge, edge), bool)
    rim[1:-1, 1:-1] = False
    assert border[rim].mean() > 0.95
    assert border[inner].mean() < 0.02


def test_a_hole_has_a_border() -> None:
    points = sheet()
    distance = np.linalg.norm(points[:, :2] - 11.5, axis=1)
    points, distance = points[distance > 4.0], distance[distance > 4.0]
    border = estimate_borders(points)
    assert border[distance < 4.6].mean() > 0.8
    away = (distance > 6.5) & (np.abs(points[:, :2] - 11.5).max(axis=1) < 8.5)
    assert border[away].mean() < 0.05


@pytest.mark.parametrize("count", [3, 5, 12])
def test_clouds_smaller_than_a_neighbourhood(count: int) -> None:
    points = np.random.default_rng(count).normal(size=(count, 3))
    assert np.isfinite(estimate_normals(points)).all()
    assert estimate_borders(points).shape == (count,)
