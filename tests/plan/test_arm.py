"""Serial arms: forward kinematics against products of matrices, Jacobians against differences, units and bad input."""

from typing import Any

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.plan.arm import Arm, arm_from_dh, forward, jacobian, link_frames
from jaxmodel.plan.arm_models import IRB_140_ROWS, gt6a_like

X = se3.compose(Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix(), np.array([0.05, -0.02, 0.12]))
FOOT = se3.compose(Rotation.from_rotvec([0.1, 0.2, -0.7]).as_matrix(), np.array([5.0, -3.0, 0.4]))
WIDE = np.tile([-2.0, 2.0], (4, 1))


def placed(arm: Arm, joints: np.ndarray) -> np.ndarray:
    with jax.enable_x64(True):
        return np.array(forward(arm, jax.numpy.asarray(joints)))


def joints_of(arm: Arm, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1], (count, arm.count))


def elementary(a: float, alpha: float, d: float, theta: float) -> np.ndarray:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha) as four factors, by SciPy."""
    turn_z = se3.compose(Rotation.from_euler("z", theta).as_matrix(), np.zeros(3))
    turn_x = se3.compose(Rotation.from_euler("x", alpha).as_matrix(), np.zeros(3))
    return turn_z @ se3.compose(np.eye(3), np.array([0, 0, d])) @ se3.compose(np.eye(3), np.array([a, 0, 0])) @ turn_x


def test_forward_kinematics_is_the_product_of_denavit_hartenberg_matrices() -> None:
    arm = gt6a_like(1.0, X, FOOT)
    joints = joints_of(arm, 50)
    for q, T in zip(joints, placed(arm, joints), strict=True):
        product = FOOT
        for (a, alpha, d, theta), value in zip(IRB_140_ROWS, q, strict=True):
            product = product @ elementary(a, alpha, d, theta + value)
        np.testing.assert_allclose(T, product @ X, atol=1e-13)


def test_a_prismatic_joint_adds_to_its_offset() -> None:
    rows = np.random.default_rng(1).normal(size=(4, 4))
    kinds = ("revolute", "prismatic", "revolute", "prismatic")
    arm = arm_from_dh(rows, WIDE, kinds)
    for q, T in zip(joints_of(arm, 20), placed(arm, joints_of(arm, 20)), strict=True):
        product = np.eye(4)
        for (a, alpha, d, theta), value, kind in zip(rows, q, kinds, strict=True):
            slide, turn = (value, 0.0) if kind == "prismatic" else (0.0, value)
            product = product @ elementary(a, alpha, d + slide, theta + turn)
        np.testing.assert_allclose(T, product, atol=1e-13)


@pytest.mark.parametrize("sliding", [False, True])
def test_the_jacobian_is_the_derivative_of_the_pose(sliding: bool) -> None:
    rows = np.random.default_rng(2).normal(size=(4, 4))
    kinds = ("revolute", "prismatic" if sliding else "revolute", "revolute", "revolute")
    arm = arm_from_dh(rows, WIDE, kinds, X, FOOT)
    step = 1e-5
    for q in joints_of(arm, 5):
        with jax.enable_x64(True):
            J = np.asarray(jacobian(arm, jax.numpy.asarray(q)))
        here = placed(arm, q)
        for joint in range(4):
            ahead, behind = (placed(arm, q + sign * step * np.eye(4)[joint]) for sign in (1, -1))
            velocity = (ahead[:3, 3] - behind[:3, 3]) / (2 * step)
            spin = (ahead[:3, :3] - behind[:3, :3]) / (2 * step) @ here[:3, :3].T
            np.testing.assert_allclose(J[:3, joint], velocity, atol=1e-8)
            np.testing.assert_allclose(J[3:, joint], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)


def test_the_sensor_stands_at_the_hand_eye_transform_on_the_flange_and_the_base_at_its_place() -> None:
    bare = gt6a_like()
    joints = joints_of(bare, 20)
    np.testing.assert_allclose(placed(bare.carrying(X).at(FOOT), joints), FOOT @ placed(bare, joints) @ X, atol=1e-13)
    with jax.enable_x64(True):
        frames = link_frames(bare.carrying(X).at(FOOT), jax.numpy.asarray(joints))
    np.testing.assert_allclose(np.asarray(frames.T_world_flange) @ X, np.asarray(frames.T_world_sensor), atol=1e-13)


def test_lengths_have_any_unit() -> None:
    metres, millimetres = gt6a_like(), gt6a_like(1000.0)
    joints = joints_of(metres, 20)
    in_metres, in_millimetres = placed(metres, joints), placed(millimetres, joints)
    np.testing.assert_allclose(in_millimetres[:, :3, :3], in_metres[:, :3, :3], atol=1e-13)
    np.testing.assert_allclose(in_millimetres[:, :3, 3], 1000 * in_metres[:, :3, 3], atol=1e-10)
    np.testing.assert_allclose(millimetres.size, 1000 * metres.size)


def test_nothing_is_farther_from_the_shoulder_than_the_size() -> None:
    rows = np.random.default_rng(3).normal(size=(4, 4))
    for arm in (gt6a_like(1.0, X, FOOT), arm_from_dh(rows, WIDE, ("revolute", "prismatic", "revolute", "revolute"))):
        away = placed(arm, joints_of(arm, 2000))[:, :3, 3] - arm.shoulder_world
        assert np.linalg.norm(away, axis=1).max() <= arm.size * (1 + 1e-12)


def test_the_built_in_arm_has_the_reach_of_its_data_sheet() -> None:
    """0.81 m from axis 1 to the wrist: the arm stretched out level, its wrist 65 mm behind the flange."""
    arm = gt6a_like()
    stretched = np.array([0.0, np.pi / 2, -np.pi / 2, 0.0, 0.0, 0.0])
    T = placed(arm, stretched)
    wrist = T[:3, 3] - 0.065 * T[:3, 2]
    np.testing.assert_allclose(wrist, [0.070 + 0.360 + 0.380, 0.0, 0.352], atol=1e-12)


def test_what_makes_no_arm_is_one_sentence() -> None:
    good = gt6a_like()
    parts = (good.T_parent_joint, good.axes, good.limits)
    bent = np.array(good.T_parent_joint)
    bent[2, 0, 0] = np.nan
    turned, still = np.array(good.limits), np.array(good.axes)
    turned[3] = turned[3, ::-1]
    still[1] = 0.0
    cases: tuple[tuple[Any, dict[str, Any], str], ...] = (
        ((bent, *parts[1:]), {}, "before joint 3 is not a rigid motion"),
        ((parts[0], still, parts[2]), {}, "axis of positive length"),
        ((*parts[:2], turned), {}, "joint 4 has the limits"),
        ((*parts[:2], good.limits * np.nan), {}, "joint 1 has the limits"),
        (parts, {"kinds": ("revolute",)}, "6 joints have 1 kinds"),
        (parts, {"T_flange_sensor": 2 * np.eye(4)}, "T_flange_sensor is not a rigid motion"),
        (parts, {"T_world_base": np.full((4, 4), np.nan)}, "T_world_base is not a rigid motion"),
        (parts, {"speeds": np.zeros(6)}, "positive largest speeds"),
        ((np.tile(np.eye(4), (6, 1, 1)), *parts[1:]), {}, "length zero"),
        ((parts[0][:0], parts[1][:0], parts[2][:0]), {}, "at least one joint"),
    )
    for arguments, options, words in cases:
        with pytest.raises(InputError, match=words):
            Arm(*arguments, **options)
    for scale in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="positive scale"):
            gt6a_like(scale)
