"""2D laser profiles: points, normals, and the algebra of poses in the plane."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.scan.profile import between, compose, motion, profile, wrapped

POSE = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)


def test_a_wall_has_its_normal_and_its_distance():
    angle = np.deg2rad(-90 + np.arange(180))
    with np.errstate(divide="ignore"):
        ranges = np.where(np.cos(angle) > 0.2, 3 / np.cos(angle), 90.0)
    found = profile(ranges, 80.0)
    assert np.array_equal(found.held, ranges < 80) and (found.lined <= found.held).all()
    assert np.allclose(found.points[found.held, 0], 3)
    assert np.allclose(found.normals[found.lined], [-1, 0], atol=1e-9)


def test_readings_across_a_jump_do_not_share_a_line():
    ranges = np.concatenate([np.full(90, 2.0), np.full(90, 6.0)])
    found = profile(ranges, 80.0, first_deg=-45.0, step_deg=0.5)
    facing = np.sum(found.normals * found.points, axis=1) / np.linalg.norm(found.points, axis=1)
    assert (facing[found.lined] < -0.98).all() and found.lined.sum() > 170


def test_nothing_that_came_back_is_no_point():
    found = profile(np.array([np.nan, np.inf, 0.0, -1.0, 81.0, 5.0]), 80.0)
    assert found.held.tolist() == [False] * 5 + [True] and not found.lined.any()


@given(POSE, POSE, POSE)
def test_poses_in_the_plane_are_a_group(a, b, c):
    assert np.allclose(motion(compose(a, b)), motion(a) @ motion(b), atol=1e-9)
    assert np.allclose(motion(compose(compose(a, b), c)), motion(compose(a, compose(b, c))), atol=1e-9)
    assert np.allclose(motion(compose(a, between(a, b))), motion(b), atol=1e-9)
    assert np.allclose(motion(between(a, a)), np.eye(3), atol=1e-9)


def test_angles_are_wrapped():
    assert np.allclose(wrapped(np.array([3 * np.pi / 2, -3 * np.pi / 2, 7.0])), [-np.pi / 2, np.pi / 2, 7 - 2 * np.pi])
