"""Paths of joints along curves of views: no jump, no limit passed, no stretch cut short, a reason for every break."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.plan.arm import Arm
from jaxmodel.plan.arm_check import check_reached
from jaxmodel.plan.arm_models import gt6a_like
from jaxmodel.plan.arm_path import ArmPath, Continuity, path_along, path_along_circle
from jaxmodel.plan.inverse_kinematics import InverseKinematics, all_postures
from jaxmodel.plan.viewpoints import Circle

X = se3.compose(Rotation.from_rotvec([0.1, -0.2, 0.4]).as_matrix(), np.array([0.03, 0.0, 0.08]))
ARM = gt6a_like(1.0, X)
CENTRE, UP = np.array([0.55, 0.0, 0.25]), np.array([0.0, 0.0, 1.0])
SMALL = Circle(np.array([0.45, 0.0, 0.1]), 0.4, UP, 25.0)
LOW = Circle(CENTRE, 0.35, UP, 90.0)


def sound(arm: Arm, path: ArmPath, step_deg: float) -> None:
    """Every joint reaches its pose within the limits, and no step within a stretch is too large."""
    on = path.stretch >= 0
    check = check_reached(arm, path.joints[on], path.T_world_sensor[on])
    assert check.position_error.max() < 1e-6 * arm.size and check.rotation_error.max() < 1e-6
    assert check.within_limits.all()
    assert np.isnan(path.joints[~on]).all() and np.isnan(path.roll[~on]).all()
    for one, two in pairwise(range(len(path.stretch))):
        if path.stretch[one] >= 0 and path.stretch[one] == path.stretch[two]:
            assert np.abs(path.joints[two] - path.joints[one]).max() <= np.deg2rad(step_deg) + 1e-9
            assert path.continuity[two] == Continuity.CONTINUES


def test_once_around_a_circle_in_reach() -> None:
    path = path_along_circle(ARM, SMALL, 120)
    sound(ARM, path, 10.0)
    assert path.complete and path.breaks == [] and path.continuity[0] == Continuity.STARTS
    assert len(path.joints) == 121
    np.testing.assert_allclose(path.T_world_sensor[0], path.T_world_sensor[-1], atol=1e-6)


def test_a_circle_that_leaves_the_reach_breaks_and_says_why() -> None:
    path = path_along_circle(ARM, LOW, 120)
    sound(ARM, path, 10.0)
    assert not path.complete and (path.stretch >= 0).any() and (path.stretch < 0).any()
    told = {of.reason for of in path.breaks}
    assert told & {Continuity.JOINT_LIMITS, Continuity.OUT_OF_REACH}
    lost = sum(of.last - of.first + 1 for of in path.breaks if path.stretch[of.first] < 0)
    assert lost == np.sum(path.stretch < 0)
    assert all(len(of.reason.sentence) > 10 for of in path.breaks)


def test_a_free_roll_reaches_more() -> None:
    fixed = path_along_circle(ARM, LOW, 60)
    free = path_along_circle(ARM, LOW, 60, method=InverseKinematics(rolls=8), largest_step_deg=60.0)
    sound(ARM, free, 60.0)
    assert np.sum(free.stretch >= 0) > np.sum(fixed.stretch >= 0)


def longest(arm: Arm, poses: np.ndarray, step: float) -> int:
    """How many views from the first any choice of postures follows, each joint in its own range: by brute force."""
    found = all_postures(arm, poses)
    turns = 2 * np.pi * np.array(np.meshgrid(*[(-1, 0, 1)] * 6)).reshape(6, -1).T
    alive = None
    for view in range(len(poses)):
        states = (found.joints[view][found.exact[view]][:, None] + turns).reshape(-1, 6)
        states = states[((states >= arm.limits[:, 0] - 1e-9) & (states <= arm.limits[:, 1] + 1e-9)).all(axis=1)]
        states = np.unique(np.round(states, 9), axis=0)
        if alive is not None and len(states):
            can = np.abs(states[None] - alive[:, None]).max(axis=2) <= step
            states = states[can.any(axis=0)]
        if len(states) == 0:
            return view
        alive = states
    return len(poses)


@pytest.mark.parametrize("start_deg", [0.0, 140.0, 250.0])
def test_the_first_stretch_is_as_long_as_any_choice_of_postures_allows(start_deg: float) -> None:
    arm = ARM
    angles = np.deg2rad(start_deg + np.linspace(0, 360, 61))[:, None]
    poses = LOW.poses(angles)
    path = path_along(arm, poses, 12.0)
    first = np.flatnonzero(path.stretch == 0)
    begin = int(first[0]) if len(first) else 0
    assert len(first) == longest(arm, poses[begin:], np.deg2rad(12.0))


def test_a_joint_without_limits_goes_on_turning() -> None:
    limits = ARM.limits.copy()
    limits[[0, 3, 5]] = (-np.inf, np.inf)
    arm = Arm(ARM.T_parent_joint, ARM.axes, limits, T_last_flange=ARM.T_last_flange, T_flange_sensor=X)
    around = Circle(np.array([0.0, 0.0, 0.9]), 0.45, UP, 120.0)
    poses = around.poses(np.linspace(0, 4 * np.pi, 181)[:, None])
    path = path_along(arm, poses, 10.0)
    sound(arm, path, 10.0)
    assert path.complete and np.ptp(path.joints, axis=0).max() > 3.5 * np.pi


def test_a_bad_view_is_a_gap() -> None:
    poses = SMALL.poses(np.linspace(0, 1, 21)[:, None])
    poses[10] = np.nan
    path = path_along(ARM, poses)
    assert path.stretch[10] == -1 and path.continuity[10] == Continuity.NOT_FINITE
    assert [of.reason for of in path.breaks if path.stretch[of.first] < 0] == [Continuity.NOT_FINITE]
    assert (path.stretch[:10] == 0).all() and (path.stretch[11:] == 1).all()


def test_bad_arguments() -> None:
    with pytest.raises(InputError, match="at least 3 views"):
        path_along_circle(ARM, SMALL, 2)
    with pytest.raises(InputError, match="positive largest step"):
        path_along(ARM, SMALL.poses(np.zeros((3, 1))), 0.0)
