"""Scans registered one onto those before it: near the truth from starts that are off, and the errors are those."""

import numpy as np

from jaxmodel.io.datasets import MeshViews
from jaxmodel.run.meshing.registered_scans import pose_error, register_in_turn
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.sensor import Sensor

VIEWS = MeshViews("boulder", object_mesh("boulder"), [0.0, 30.0, 60.0], Sensor(width=90, height=90))


def test_three_views_come_nearer_than_they_started() -> None:
    scans = [VIEWS.scan(name) for name in VIEWS.names]
    poses = [np.asarray(VIEWS.T_world_scan(name), np.float64) for name in VIEWS.names]
    placed = register_in_turn(scans, poses, 8.0, 0.03, np.random.default_rng(0))
    np.testing.assert_array_equal(placed[0].T_world_scan, poses[0])
    for of, truth in zip(placed[1:], poses[1:], strict=True):
        assert of.error_deg < 0.3 * of.start_deg and of.error_shift < 0.3 * of.start_shift
        turn = of.T_world_scan[:3, :3] @ truth[:3, :3].T
        assert np.isclose(np.rad2deg(np.arccos((np.trace(turn) - 1) / 2)), of.error_deg, atol=1e-3)


def test_a_pose_error_turns_about_the_centre() -> None:
    centre = np.array([1.0, -2.0, 3.0])
    T = pose_error(centre, 4.0, 0.0, np.random.default_rng(1))
    np.testing.assert_allclose(T[:3, :3] @ centre + T[:3, 3], centre, atol=1e-12)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert not np.allclose(T, np.eye(4))
