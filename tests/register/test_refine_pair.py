"""The exact fit of two scans: recovery, equivariance, what is open stays."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.io.datasets import ObjectViews
from jaxmodel.register.refine_pair import Surface, refine, surface_of
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.sensor import Sensor


@pytest.fixture(scope="module")
def pair() -> tuple[Cloud, Cloud, np.ndarray]:
    views = ObjectViews("gourd", (0, 40), Sensor(width=120, height=120))
    target, source = (as_cloud(views.scan(name)) for name in views.names)
    return target, source, views.T_target_source(*views.names)


def _off(T: np.ndarray, centre: np.ndarray, turn_deg: float, shift: float, seed: int) -> np.ndarray:
    draw = np.random.default_rng(seed)
    out, axis, way = T.copy(), draw.normal(size=3), draw.normal(size=3)
    turn = Rotation.from_rotvec(np.deg2rad(turn_deg) * axis / np.linalg.norm(axis)).as_matrix()
    out[:3, :3] = turn @ T[:3, :3]
    out[:3, 3] = T[:3, :3] @ centre + T[:3, 3] + shift * way / np.linalg.norm(way) - out[:3, :3] @ centre
    return out


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_rough_pose_becomes_the_true_one(pair, seed):
    target, source, T = pair
    centre = source.points.mean(axis=0)
    found = refine(surface_of(target), surface_of(source), _off(T, centre, 4, 0.015, seed), 1.0)
    assert found.settled and found.pairs > 500
    assert rotation_angle_deg(found.T_target_source[:3, :3].T @ T[:3, :3]) < 0.2
    assert np.linalg.norm((found.T_target_source - T)[:3] @ np.append(centre, 1)) < 5e-4
    assert np.linalg.eigvalsh(found.information)[0] > 0


def test_frames_and_units_move_with_the_scans(pair):
    target, source, T = pair
    start = _off(T, source.points.mean(axis=0), 3, 0.01, 7)
    plain = refine(surface_of(target), surface_of(source), start, 1.0).T_target_source
    A = np.eye(4)
    A[:3, :3], A[:3, 3] = Rotation.from_euler("xyz", [40, 10, -70], degrees=True).as_matrix(), [3.0, -2.0, 5.0]
    moved = refine(_with(target, A), surface_of(source), A @ start, 1.0).T_target_source
    assert np.allclose(inverse(A) @ moved, plain, atol=2e-4)
    large = start.copy()
    large[:3, 3] *= 1000
    scaled = [surface_of(Cloud(1000 * c.points, c.normals)) for c in (target, source)]
    found = refine(scaled[0], scaled[1], large, 1000.0).T_target_source
    assert np.allclose(found[:3, 3] / 1000, plain[:3, 3], atol=2e-4)


def _with(cloud: Cloud, T: np.ndarray) -> Surface:
    """The very surface, moved: the same points are asked for, in any frame."""
    plain, moved = surface_of(cloud), surface_of(cloud.moved(T))
    return Surface(moved.points, moved.normals, moved.tree, plain.asked)


def test_a_plane_keeps_the_slide_it_came_with():
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60)), axis=-1).reshape(-1, 2)
    plane = Cloud(np.column_stack([grid, np.zeros(len(grid))]), np.tile([0.0, 0.0, 1.0], (len(grid), 1)))
    start = np.eye(4)
    start[:3, 3] = [0.02, 0.01, 0.01]
    found = refine(surface_of(plane), surface_of(plane), start, 1.0).T_target_source
    assert np.allclose(found[:3, 3], [0.02, 0.01, 0.0], atol=1e-6)


def test_scans_far_apart_stay_where_they_are(pair):
    target, source, T = pair
    away = T.copy()
    away[:3, 3] += 9
    found = refine(surface_of(target), surface_of(source), away, 1.0)
    assert found.pairs == 0 and not found.settled and np.array_equal(found.T_target_source, away)
