"""Inverse kinematics without a closed form: arms whose wrist axes do not meet, and arms with other than six joints."""

from typing import Any

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3
from jaxmodel.plan.arm import Arm, arm_from_dh, forward
from jaxmodel.plan.arm_check import check_reached
from jaxmodel.plan.inverse_kinematics import InverseKinematics, all_postures, inverse_kinematics
from jaxmodel.plan.inverse_kinematics_search import joint_starts
from jaxmodel.plan.inverse_kinematics_wrist import wrist_arm
from jaxmodel.plan.reach_outcome import ReachOutcome

pytestmark = pytest.mark.slow  # each arm compiles a solver of its own

H = np.pi / 2
X = se3.compose(Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix(), np.array([50.0, -20.0, 120.0]))
# Universal Robots' table of the UR5 in millimetres: its last three axes do not meet
UR5 = arm_from_dh(
    np.array(
        [
            [0, H, 89.2, 0],
            [-425.0, 0, 0, 0],
            [-392.3, 0, 0, 0],
            [0, H, 109.2, 0],
            [0, -H, 94.7, 0],
            [0, 0, 82.3, 0],
        ]
    ),
    np.tile([-2.8, 2.8], (6, 1)),
    T_flange_sensor=X,
)
MANY = 192


def placed(arm: Arm, joints: np.ndarray) -> np.ndarray:
    with jax.enable_x64(True):
        return np.array(forward(arm, jax.numpy.asarray(joints)))


def joints_of(arm: Arm, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1], (count, arm.count))


def sound(arm: Arm, joints: np.ndarray, wanted: np.ndarray) -> None:
    check = check_reached(arm, joints, wanted)
    assert check.position_error.max() <= 1e-6 * arm.size
    assert check.rotation_error.max() <= 1e-6
    assert check.within_limits.all()


def test_an_arm_without_a_spherical_wrist_is_searched() -> None:
    assert wrist_arm(UR5) is None
    joints = joints_of(UR5, MANY)
    wanted = placed(UR5, joints)
    found = inverse_kinematics(UR5, wanted)
    assert found.reached.mean() >= 0.99
    assert set(found.outcome[~found.reached]) <= {ReachOutcome.NOT_CONVERGED, ReachOutcome.JOINT_LIMITS}
    sound(UR5, found.joints[found.reached], wanted[found.reached])
    assert np.isnan(found.joints[~found.reached]).all()


def test_a_search_stays_where_it_starts_if_that_is_right() -> None:
    for q in joints_of(UR5, 6, 1):
        found = inverse_kinematics(UR5, placed(UR5, q)[None], current=q)
        np.testing.assert_allclose(found.joints[0], q, atol=1e-6)


def test_what_no_search_can_find_is_an_outcome() -> None:
    wanted = placed(UR5, joints_of(UR5, 8, 2))
    wanted[:2, :3, 3] *= 20
    wanted[2] = np.nan
    # within the length of the arm, but not at this pose: at the shoulder's own place the links cannot fold that far
    wanted[3] = se3.compose(np.eye(3), UR5.shoulder_world + 0.97 * np.array([0, 0, UR5.size]))
    found = inverse_kinematics(UR5, wanted)
    outcomes = [ReachOutcome(int(outcome)) for outcome in found.outcome]
    assert outcomes[:4] == [
        ReachOutcome.OUT_OF_REACH,
        ReachOutcome.OUT_OF_REACH,
        ReachOutcome.NOT_FINITE,
        ReachOutcome.NOT_CONVERGED,
    ]
    assert found.reached[4:].all()


def test_limits_hold_and_a_pose_beyond_them_is_named() -> None:
    stiff = Arm(UR5.T_parent_joint, UR5.axes, 0.3 * UR5.limits, UR5.kinds, UR5.T_last_flange, UR5.T_flange_sensor)
    inside, outside = joints_of(stiff, 32, 3), joints_of(UR5, 32, 4)
    wanted = np.concatenate([placed(UR5, inside), placed(UR5, outside)])
    found = inverse_kinematics(stiff, wanted)
    assert found.reached[:32].mean() >= 0.9
    sound(stiff, found.joints[found.reached], wanted[found.reached])
    assert (found.outcome[32:] == ReachOutcome.JOINT_LIMITS).mean() >= 0.75


def test_the_closed_form_and_the_search_agree_where_both_apply() -> None:
    """The search, forced upon a spherical wrist by moving axis 6 aside by a hair, finds one of the eight branches."""
    rows = np.array([[0, H, 0, 0], [0.4, 0, 0, 0], [0.02, -H, 0.15, 0], [0, H, 0.4, 0], [0, -H, 0, 0], [0, 0, 0, 0.0]])
    limits = np.tile([-2.8, 2.8], (6, 1))
    closed = arm_from_dh(rows, limits)
    rows[4, 0] = 1e-7
    searched = arm_from_dh(rows, limits)
    assert wrist_arm(closed) is not None and wrist_arm(searched) is None
    wanted = placed(closed, joints_of(closed, 64, 5))
    branches, ends = all_postures(closed, wanted), all_postures(searched, wanted)
    checked = 0
    for index in range(64):
        for q in ends.joints[index][ends.reached[index]]:
            apart = np.abs((branches.joints[index] - q + np.pi) % (2 * np.pi) - np.pi).max(axis=1)
            # 1e-7 of the arm aside turns joints by that over the sine of the wrist
            assert apart[branches.exact[index]].min() < 1e-3
            checked += 1
    assert checked > 64


def test_seven_joints_or_five_or_a_slide() -> None:
    rng = np.random.default_rng(6)
    seven = np.array([[0.0, (-1) ** i * H, 0.3 * (i % 2 == 0), 0] for i in range(7)])
    five = np.array([[0.1, H, 0.3, 0], [0.4, 0, 0, 0], [0.3, 0, 0, 0], [0.1, H, 0, 0], [0, 0, 0.1, 0]])
    slide = np.array(
        [[0.1, H, 0.3, 0], [0.1, H, 0, 0], [0, H, 0.2, 0], [0.1, H, 0.1, 0], [0.1, -H, 0.1, 0], [0, 0, 0.1, 0]]
    )
    cases: tuple[tuple[np.ndarray, Any], ...] = (
        (seven, None),
        (five, None),
        (slide, ("revolute", "prismatic", "revolute", "revolute", "revolute", "revolute")),
    )
    for rows, kinds in cases:
        arm = arm_from_dh(rows, np.tile([-2.5, 2.5], (len(rows), 1)), kinds)
        wanted = placed(arm, rng.uniform(-2.5, 2.5, (64, arm.count)))
        found = inverse_kinematics(arm, wanted)
        assert found.reached.mean() >= 0.9
        sound(arm, found.joints[found.reached], wanted[found.reached])


def test_starts_lie_within_the_limits_the_middle_first() -> None:
    starts = joint_starts(UR5, 16)
    assert starts.shape == (16, 6)
    np.testing.assert_allclose(starts[0], UR5.middle)
    assert ((starts >= UR5.limits[:, 0]) & (starts <= UR5.limits[:, 1])).all()
    endless = Arm(UR5.T_parent_joint, UR5.axes, np.tile([-np.inf, np.inf], (6, 1)), UR5.kinds, UR5.T_last_flange)
    assert (np.abs(joint_starts(endless, 16)) <= np.pi).all()


def test_more_starts_never_reach_less() -> None:
    wanted = placed(UR5, joints_of(UR5, 64, 7))
    few, many = (inverse_kinematics(UR5, wanted, None, InverseKinematics(starts=count)).reached for count in (2, 16))
    assert few.sum() < many.sum()
    assert (many >= few).mean() >= 0.98
