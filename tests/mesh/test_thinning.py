"""Thinning and projection: distances kept, cover complete, no shrinking, better points preferred."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.mesh.projection import project
from jaxmodel.mesh.radii import ball_radii, cloud_scale, thinning_distance, widest_gap
from jaxmodel.mesh.thinning import thin
from jaxmodel.scan.triangle_mesh import icosphere

UP = np.array([0.0, 0.0, 1.0])


def plane(count: int, seed: int = 0) -> np.ndarray:
    return np.concatenate([np.random.default_rng(seed).random((count, 2)), np.zeros((count, 1))], axis=1)


def test_kept_points_are_apart_and_every_point_is_near_one() -> None:
    points = plane(5000)
    sheet = thin(points, np.tile(UP, (5000, 1)), 0.03)
    assert KDTree(sheet.points).query(sheet.points, k=2)[0][:, 1].min() >= 0.03
    assert KDTree(sheet.points).query(points)[0].max() < 0.03
    np.testing.assert_allclose(sheet.points, points[sheet.source], atol=1e-12)


def test_layers_within_the_distance_become_one() -> None:
    points = np.concatenate([plane(3000, k) + 0.01 * k * UP for k in range(3)])
    sheet = thin(points, np.tile(UP, (9000, 1)), 0.04)
    assert (
        np.hypot(*(sheet.points[:, None, :2] - sheet.points[None, :, :2]).transpose(2, 0, 1))[
            ~np.eye(len(sheet.points), dtype=bool)
        ].min()
        > 0.03
    )
    assert np.ptp(sheet.points[:, 2]) < 0.01  # the layers span 0.02
    assert sheet.points[:, 2].mean() == pytest.approx(0.01, abs=1e-3)


def test_the_point_that_faces_its_sensor_is_taken() -> None:
    points = np.repeat(plane(300), 2, axis=0) + np.tile([[0, 0, 0], [1e-4, 0, 0]], (300, 1))
    oblique = np.array([np.sqrt(1 - 0.3**2), 0.0, 0.3])
    sheet = thin(points, np.tile(UP, (600, 1)), 1e-3, toward=np.tile([UP, oblique], (300, 1)))
    assert (sheet.source % 2 == 0).all()


@pytest.mark.parametrize("radius", [1.0, 100.0])
def test_projection_onto_a_sphere_does_not_shrink_it(radius: float) -> None:
    normals = icosphere(4).vertices
    sites = normals[:200] * (1.02 * radius)
    onto = project(sites, normals[:200], radius * normals, normals, 0.3 * radius)
    np.testing.assert_allclose(
        np.linalg.norm(onto.points, axis=1), radius, rtol=1e-4
    )  # a plane would shrink it by 1e-2
    assert (onto.weight > 0).all()


def test_a_site_without_points_in_reach_stays() -> None:
    onto = project(5 * UP[None], UP[None], plane(50), np.tile(UP, (50, 1)), 0.1)
    np.testing.assert_array_equal(onto.points[0], 5 * UP)
    assert onto.weight[0] == 0


def test_scales_follow_their_definitions() -> None:
    scale = cloud_scale(plane(20_000) + 1e-4 * np.random.default_rng(2).normal(size=(20_000, 3)) * UP)
    assert scale.spacing == pytest.approx(1 / np.sqrt(20_000), rel=0.1)
    assert scale.thickness == pytest.approx(1e-4, rel=0.15)
    assert list(ball_radii(2.0)) == sorted(ball_radii(2.0)) and ball_radii(2.0)[0] == 2.0
    points = plane(20_000)
    inner = [0.1, 0.1, 0.0] + 0.8 * plane(100_000, 5)
    gap = KDTree(points).query(inner)[0].max()
    assert 0.8 * gap < widest_gap(1 / np.sqrt(20_000), 20_000) < 1.3 * gap


def test_only_stacked_layers_ask_for_thinning() -> None:
    points, up = plane(4000), np.tile(UP, (4000, 1))
    assert thinning_distance(points, up) == 0.0
    layered = np.concatenate([points, points + np.array([2e-3, 0, 4e-3])])
    assert thinning_distance(layered, np.concatenate([up, up])) >= 6 * 2e-3
