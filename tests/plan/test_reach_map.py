"""Which views of a sphere an arm takes: every one checked, none lost, and the search kept to them."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.plan.arm_check import check_reached
from jaxmodel.plan.arm_models import gt6a_like
from jaxmodel.plan.inverse_kinematics import InverseKinematics, reachable
from jaxmodel.plan.next_view import Search, ViewOutcome, next_view
from jaxmodel.plan.reach_map import ArmReach, reach_map, rolled
from jaxmodel.plan.reach_outcome import ReachOutcome
from jaxmodel.plan.viewpoints import ObservationSphere, Restricted

X = se3.compose(Rotation.from_rotvec([0.1, -0.2, 0.4]).as_matrix(), np.array([0.03, 0.0, 0.08]))
ARM = gt6a_like(1.0, X)
SPHERE = ObservationSphere(np.array([0.65, 0.0, 0.35]), 0.3)
EIGHT = InverseKinematics(rolls=8)


@pytest.fixture(scope="module")
def found() -> Any:
    return reach_map(ARM, SPHERE, 600, EIGHT)


def test_every_view_said_to_be_reached_is(found: Any) -> None:
    reached = np.asarray(found.reached)
    assert 0.2 < found.share < 0.95 and found.share == reached.mean()
    check = check_reached(ARM, found.placements.joints[reached], found.T_world_sensor[reached])
    assert check.position_error.max() < 1e-6 and check.rotation_error.max() < 1e-6 and check.within_limits.all()
    assert np.isnan(found.placements.joints[~reached]).all()
    assert sum(found.counts.values()) == 600
    assert sum(n for outcome, n in found.counts.items() if outcome.reached) == reached.sum()


def test_a_view_keeps_its_place_and_its_line_of_sight_in_any_roll(found: Any) -> None:
    asked = SPHERE.poses(found.parameters)
    np.testing.assert_allclose(found.T_world_sensor[:, :, 2:], asked[:, :, 2:], atol=1e-12)
    turned = rolled(asked, np.full(600, 0.3))
    roll = Rotation.from_rotvec([0, 0, 0.3]).as_matrix()
    np.testing.assert_allclose(turned[:, :3, :3], asked[:, :3, :3] @ roll, atol=1e-12)
    np.testing.assert_array_equal(rolled(asked, np.full(600, np.nan)), asked)


def test_rolls_only_add_views(found: Any) -> None:
    poses = SPHERE.poses(found.parameters)
    upright = reachable(ARM, poses)
    any_roll = ArmReach(ARM, EIGHT)(poses)
    assert (any_roll >= upright).all() and any_roll.sum() > upright.sum()
    np.testing.assert_array_equal(any_roll, found.reached)


def test_the_sensor_stands_at_the_hand_eye_transform(found: Any) -> None:
    """Moving the mount and the sphere together changes nothing: the flange goes to the same places."""
    poses = SPHERE.poses(found.parameters)
    bare = gt6a_like(1.0)
    np.testing.assert_array_equal(reachable(ARM, poses), reachable(bare, poses @ np.linalg.inv(X)))


def test_too_far_is_an_outcome() -> None:
    far = reach_map(ARM, ObservationSphere(np.array([5.0, 0.0, 0.0]), 0.3), 50, EIGHT)
    assert far.share == 0 and far.counts[ReachOutcome.OUT_OF_REACH] == 50
    assert len(ArmReach(ARM)(np.zeros((0, 4, 4)))) == 0
    with pytest.raises(InputError, match="at least one view, not 0"):
        reach_map(ARM, SPHERE, 0)


def test_the_next_view_is_one_the_arm_takes(valve: Any) -> None:
    """The valve before an arm scaled to it."""
    scale = float(valve.size) / 0.35
    middle = valve.sphere.origin
    foot = se3.compose(np.eye(3), middle - scale * np.array([0.65, 0.0, 0.35]))
    arm = gt6a_like(scale, T_world_base=foot)
    search = Search(views=400, spiral=8, rays=256, best=4, rounds=2, minimum_overlap=0.1)
    near = ObservationSphere(middle, 0.8 * valve.size)
    reach = ArmReach(arm, EIGHT)
    free = next_view(valve.maps[1], valve.sensor, near, search)
    view = next_view(valve.maps[1], valve.sensor, Restricted(near, reach), search)
    assert view.outcome is ViewOutcome.FOUND and view.utility <= free.utility * 1.02
    placed = reach.place(view.T_world_sensor[None])
    assert placed.reached.all()
    check = check_reached(arm, placed.placements.joints, placed.T_world_sensor)
    assert check.position_error[0] < 1e-6 * arm.size and check.within_limits.all()
    elsewhere = gt6a_like(scale, T_world_base=se3.compose(np.eye(3), middle + 9 * scale))
    nowhere = next_view(valve.maps[1], valve.sensor, Restricted(near, ArmReach(elsewhere)), search)
    assert nowhere.outcome is ViewOutcome.NO_REACHABLE_VIEW and np.isnan(nowhere.T_world_sensor).all()
