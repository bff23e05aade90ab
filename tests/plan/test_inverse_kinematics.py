"""Inverse kinematics in closed form: round trips, all eight branches, limits, singular and impossible poses."""

from typing import Any

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.plan.arm import Arm, arm_from_dh, forward
from jaxmodel.plan.arm_check import check_reached
from jaxmodel.plan.arm_models import gt6a_like
from jaxmodel.plan.inverse_kinematics import InverseKinematics, all_postures, inverse_kinematics, reachable
from jaxmodel.plan.inverse_kinematics_wrist import wrist_arm
from jaxmodel.plan.reach_outcome import ReachOutcome

X = se3.compose(Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix(), np.array([0.05, -0.02, 0.12]))
FOOT = se3.compose(Rotation.from_rotvec([0.1, 0.2, -0.7]).as_matrix(), np.array([5.0, -3.0, 0.4]))
ALL_ROUND = np.tile([-np.pi, np.pi], (6, 1))
H = np.pi / 2
PUMA = arm_from_dh(  # shoulder aside of axis 1, elbow offset; P. Corke's table of the Puma 560, in metres
    np.array(
        [[0, H, 0, 0], [0.4318, 0, 0, 0], [0.0203, -H, 0.15005, 0], [0, H, 0.4318, 0], [0, -H, 0, 0], [0, 0, 0, 0.0]]
    ),
    ALL_ROUND,
    T_flange_sensor=X,
)
OBLIQUE = arm_from_dh(  # wrist axes at 70 degrees to each other, axis 3 against axis 2
    np.array(
        [[0.1, H, 0.3, 0], [0.4, np.pi, 0, 0], [0.05, H, 0, 0], [0, 1.2, 0.4, 0], [0, -1.2, 0, 0], [0, 0, 0.1, 0.0]]
    ),
    ALL_ROUND,
)
MANY = 4096
ARMS = {
    "GT6A": gt6a_like(1.0, X, FOOT),
    "GT6A in millimetres": gt6a_like(1000.0, se3.compose(X[:3, :3], 1000 * X[:3, 3])),
    "Puma": PUMA,
    "oblique wrist": OBLIQUE,
}
named = pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS.keys())


def placed(arm: Arm, joints: np.ndarray) -> np.ndarray:
    with jax.enable_x64(True):
        return np.array(forward(arm, jax.numpy.asarray(joints)))


def joints_of(arm: Arm, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1], (count, arm.count))


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference over the joints, whole turns aside."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


def sound(arm: Arm, joints: np.ndarray, wanted: np.ndarray) -> None:
    check = check_reached(arm, joints, wanted)
    assert check.position_error.max() <= 1e-6 * arm.size
    assert check.rotation_error.max() <= 1e-6
    assert check.within_limits.all()


@named
def test_joints_come_back_from_their_pose(arm: Arm) -> None:
    assert wrist_arm(arm) is not None
    joints = joints_of(arm, MANY)
    wanted = placed(arm, joints)
    found = inverse_kinematics(arm, wanted)
    assert found.reached.all()
    sound(arm, found.joints, wanted)
    np.testing.assert_array_equal(found.roll, 0)
    every = all_postures(arm, wanted)
    same = np.where(every.reached, angle_between(every.joints, joints[:, None]), np.inf)
    assert same.min(axis=1).max() < 1e-6, "one branch is the posture that the pose was made from"


@named
def test_every_reached_branch_is_exact_and_no_two_are_one(arm: Arm) -> None:
    wanted = placed(arm, joints_of(arm, MANY, 1))
    found = all_postures(arm, wanted)
    sound(arm, found.joints[found.reached], np.repeat(wanted[:, None], 8, axis=1)[found.reached])
    apart = angle_between(found.joints[:, :, None], found.joints[:, None])
    both = found.exact[:, :, None] & found.exact[:, None] & ~np.eye(8, dtype=bool)
    # branches meet at singular postures, which random joints do not hit
    assert apart[both].min() > 1e-5


def test_well_inside_its_reach_an_arm_without_limits_has_all_eight_branches() -> None:
    rng = np.random.default_rng(2)
    R = Rotation.random(500, np.random.default_rng(3)).as_matrix()
    towards = rng.normal(size=(500, 3))
    wrist = 0.5 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
    wrist[:, :2] += 0.3 * np.sign(wrist[:, :2])
    wrist *= 0.55 / np.linalg.norm(wrist, axis=1, keepdims=True)
    found = all_postures(PUMA.carrying(np.eye(4)), se3.compose(R, wrist))
    assert (found.exact.sum(axis=1) == 8).all()
    assert found.reached.all()


def test_a_pose_beyond_the_limits_is_told_from_one_out_of_reach() -> None:
    arm = gt6a_like()
    stiff = Arm(arm.T_parent_joint, arm.axes, 0.2 * arm.limits, arm.kinds, arm.T_last_flange)
    wanted = placed(arm, joints_of(arm, MANY))
    found, free = inverse_kinematics(stiff, wanted), inverse_kinematics(arm, wanted)
    assert set(np.unique(found.outcome)) <= {ReachOutcome.REACHED, ReachOutcome.SINGULAR, ReachOutcome.JOINT_LIMITS}
    assert 0 < found.reached.sum() < MANY / 2
    assert np.isnan(found.joints[~found.reached]).all() and np.isnan(found.roll[~found.reached]).all()
    sound(stiff, found.joints[found.reached], wanted[found.reached])
    every = all_postures(arm, wanted)
    inside = (every.joints >= stiff.limits[:, 0]) & (every.joints <= stiff.limits[:, 1])
    np.testing.assert_array_equal(found.reached, (every.exact & inside.all(axis=2)).any(axis=1))
    assert free.reached.all()
    far = wanted.copy()
    far[:, :3, 3] += 3 * arm.size
    assert (inverse_kinematics(arm, far).outcome == ReachOutcome.OUT_OF_REACH).all()


def test_a_joint_at_its_limit_is_reached() -> None:
    arm = gt6a_like(1.0, X)
    ends = np.where(np.random.default_rng(4).random((MANY, 6)) < 0.5, *arm.limits.T)
    # a wrist on its limit, the rest anywhere
    joints = np.where(np.arange(6) == np.arange(MANY)[:, None] % 6, ends, joints_of(arm, MANY, 5))
    wanted = placed(arm, joints)
    found = inverse_kinematics(arm, wanted)
    assert found.reached.all()
    sound(arm, found.joints, wanted)


def test_the_nearest_posture_is_chosen_where_the_arm_stands_already() -> None:
    arm = gt6a_like(1.0, X, FOOT)
    joints = joints_of(arm, 64, 6)
    for q in joints[:8]:
        found = inverse_kinematics(arm, placed(arm, q)[None], current=q)
        np.testing.assert_allclose(found.joints[0], q, atol=1e-7)


def test_singular_postures_are_reached_and_named() -> None:
    arm = gt6a_like()
    straight_wrist = np.array([0.4, 0.3, -1.0, 0.7, 0.0, 0.2])
    stretched = np.array([0.4, 0.3, -H, 0.7, 0.9, 0.2])
    overhead = np.array([0.9, 0.2, 0.0, 0.0, 1.0, 0.3])
    # the elbow that puts the wrist's centre on axis 1: 0.07 + 0.36 sin(q2) + 0.38 cos(q2 + q3) = 0
    overhead[2] = np.arccos(-(0.07 + 0.36 * np.sin(0.2)) / 0.38) - 0.2 - 2 * np.pi + np.pi * 0
    overhead[2] = -np.arccos(-(0.07 + 0.36 * np.sin(0.2)) / 0.38) - 0.2
    joints = np.stack([straight_wrist, stretched, overhead])
    wanted = placed(arm, joints)
    np.testing.assert_allclose(wanted[2, :2, 3] - 0.065 * wanted[2, :2, 2], 0.0, atol=1e-12)
    found = inverse_kinematics(arm, wanted)
    assert (found.outcome == ReachOutcome.SINGULAR).all()
    assert (found.dexterity < 1e-3).all()
    sound(arm, found.joints, wanted)
    for q, T in zip(joints, wanted, strict=True):
        np.testing.assert_allclose(inverse_kinematics(arm, T[None], current=q).joints[0], q, atol=1e-5)


def test_close_to_singular_postures_no_digit_is_lost() -> None:
    arm = gt6a_like(1.0, X)
    joints = joints_of(arm, MANY, 7)
    joints[:, 4] = np.geomspace(1e-14, 1e-2, MANY)
    wanted = placed(arm, joints)
    found = inverse_kinematics(arm, wanted)
    assert found.reached.all()
    sound(arm, found.joints, wanted)


def test_bad_poses_are_outcomes_and_leave_the_others_alone() -> None:
    arm = gt6a_like(1.0, X, FOOT)
    wanted = placed(arm, joints_of(arm, 40))
    alone = inverse_kinematics(arm, wanted)
    spoilt = wanted.copy()
    spoilt[3] = np.nan
    spoilt[7, 0, 3] = np.inf
    spoilt[11, :3, :3] *= 2
    spoilt[13, :3, :3] = np.diag([1.0, 1.0, -1.0])
    found = inverse_kinematics(arm, spoilt)
    bad = np.isin(np.arange(40), [3, 7, 11, 13])
    np.testing.assert_array_equal(found.outcome == ReachOutcome.NOT_FINITE, bad)
    np.testing.assert_array_equal(found.joints[~bad], alone.joints[~bad])
    assert np.isnan(found.joints[bad]).all()
    np.testing.assert_array_equal(reachable(arm, spoilt), ~bad)
    assert not all_postures(arm, spoilt).reached[bad].any()
    assert found.outcome_of(3).sentence == "the pose is not a finite rigid motion"


def test_poses_at_once_are_poses_one_by_one() -> None:
    arm = gt6a_like(1.0, X)
    wanted = placed(arm, joints_of(arm, 3000, 8))
    wanted[::3, :3, 3] *= 1.5
    together = inverse_kinematics(arm, wanted)
    for index in (0, 63, 64, 2047, 2048, 2999):
        alone = inverse_kinematics(arm, wanted[index : index + 1])
        assert alone.outcome[0] == together.outcome[index]
        np.testing.assert_allclose(alone.joints[0], together.joints[index], atol=1e-9)
    np.testing.assert_array_equal(reachable(arm, wanted), together.reached)


def test_bad_arguments_are_one_sentence() -> None:
    arm, wanted = gt6a_like(), np.eye(4)[None]
    for arguments, words in (((wanted, np.zeros(5)), "6 finite current"), ((wanted, np.full(6, np.nan)), "6 finite")):
        with pytest.raises(InputError, match=words):
            inverse_kinematics(arm, *arguments)
    with pytest.raises(InputError, match="at least one pose"):
        inverse_kinematics(arm, wanted[:0])
    bad: list[dict[str, Any]] = [{"rolls": 0}, {"starts": 0}, {"tolerance": 0.0}, {"dexterity": np.nan}]
    for options in bad:
        with pytest.raises(InputError, match=next(iter(options))):
            InverseKinematics(**options)
