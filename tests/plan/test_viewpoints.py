"""View spaces: poses that look where they should, smooth and unbounded parameters, even covers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.plan.viewpoints import Circle, FixedPoint, ObservationSphere, Restricted, ViewSpace

CENTRE = np.array([10.0, -20.0, 30.0])
SPHERE = ObservationSphere(CENTRE, 2.0, -30.0)
SPACES = [
    SPHERE,
    Circle(CENTRE, 2.0, np.array([0.3, 0.2, 1.0]), 70.0),
    FixedPoint(CENTRE),
]
named = pytest.mark.parametrize("space", SPACES, ids=lambda space: type(space).__name__)


@named
def test_poses_are_rigid_and_level(space: ViewSpace) -> None:
    parameters = np.random.default_rng(0).normal(0, 5, (200, space.dimension))
    poses = space.poses(parameters)
    R = poses[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=1e-12)
    if not isinstance(space, Circle):
        np.testing.assert_allclose(R[:, 2, 0], 0, atol=1e-6)
        assert (R[:, 2, 1] <= 1e-6).all(), "image rows run down"


@pytest.mark.parametrize("space", SPACES[:2], ids=lambda space: type(space).__name__)
def test_views_from_a_sphere_look_at_its_centre(space: ObservationSphere | Circle) -> None:
    poses = space.poses(np.random.default_rng(0).normal(0, 5, (200, space.dimension)))
    away = poses[:, :3, 3] - CENTRE
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 2, rtol=1e-5)
    np.testing.assert_allclose(poses[:, :3, 2], -away / 2, atol=1e-5)


def test_no_view_is_below_the_lowest_elevation() -> None:
    for parameters in (SPHERE.spread(500), np.random.default_rng(0).normal(0, 9, (500, 2))):
        height = (SPHERE.poses(parameters)[:, 2, 3] - CENTRE[2]) / 2
        assert height.min() >= np.sin(np.deg2rad(-30)) - 1e-6


def test_a_circle_keeps_its_angle() -> None:
    space = SPACES[1]
    assert isinstance(space, Circle)
    axis = space.axis / np.linalg.norm(space.axis)
    away = (space.poses(space.spread(50))[:, :3, 3] - CENTRE) / 2
    np.testing.assert_allclose(away @ axis, np.cos(np.deg2rad(70)), atol=1e-5)


@named
def test_the_cover_is_even(space: ViewSpace) -> None:
    """Oracle: of so many directions, none is without one of the cover nearby, and each is its own."""
    looks = space.poses(space.spread(400))[:, :3, 2]
    apart = np.arccos(np.clip(looks @ looks.T - 2 * np.eye(400), -1, 1)).min(axis=1)
    assert apart.max() <= 2.5 * apart.min() + 1e-3
    random = space.poses(np.random.default_rng(1).normal(0, 9, (300, space.dimension)))[:, :3, 2]
    gap = np.arccos(np.clip((random @ looks.T).max(axis=1), -1, 1))
    assert gap.max() <= 2 * float(space.spacing(400)[-1])


@named
def test_poses_are_smooth_in_their_parameters(space: ViewSpace) -> None:
    """Finite slopes everywhere, poles included, and equal to central differences."""
    for parameter in (*space.spiral(9), np.full(space.dimension, np.pi / 2), np.full(space.dimension, -np.pi / 2)):
        at = jnp.asarray(parameter, jnp.float32)
        slope = np.asarray(jax.jacfwd(space.pose)(at))
        assert np.isfinite(slope).all()
        for k in range(space.dimension):
            step = 1e-2 * np.eye(space.dimension, dtype=np.float32)[k]
            difference = np.asarray(space.pose(at + step) - space.pose(at - step)) / 2e-2
            np.testing.assert_allclose(slope[..., k], difference, atol=0.022 if abs(np.sin(at[-1])) > 0.999 else 2e-3)


def test_parameters_of_a_view_give_it_back() -> None:
    parameters = SPHERE.spread(60)
    poses = SPHERE.poses(parameters)
    again = np.stack([SPHERE.parameter_of(pose[:3, 3]) for pose in poses])
    np.testing.assert_allclose(SPHERE.poses(again), poses, atol=2e-3)
    fixed = FixedPoint(CENTRE)
    poses = fixed.poses(parameters)
    again = np.stack([fixed.parameter_of(pose[:3, 2]) for pose in poses])
    np.testing.assert_allclose(fixed.poses(again), poses, atol=2e-3)


def test_a_far_origin_loses_nothing() -> None:
    near, far = ObservationSphere(np.zeros(3), 2.0), ObservationSphere(np.full(3, 1e7), 2.0)
    moved = far.poses(far.spread(20))
    moved[:, :3, 3] -= 1e7
    np.testing.assert_allclose(moved, near.poses(near.spread(20)), atol=1e-8)


def test_a_restriction_only_takes_away() -> None:
    upper = Restricted(SPHERE, lambda poses: poses[:, 2, 3] > CENTRE[2])
    poses = upper.poses(upper.spread(100))
    np.testing.assert_array_equal(upper.allowed(poses), poses[:, 2, 3] > CENTRE[2])
    assert upper.dimension == 2 and upper.allowed(poses).sum() < 100


def test_impossible_spheres_are_refused() -> None:
    with pytest.raises(InputError, match="radius of an observation sphere must be a positive length"):
        ObservationSphere(CENTRE, 0.0)
    with pytest.raises(InputError, match="lowest elevation"):
        ObservationSphere(CENTRE, 1.0, 90.0)
