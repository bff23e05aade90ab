"""The independent check of joints against the solvers' forward kinematics, and against errors put in."""

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3
from jaxmodel.plan.arm import Arm, arm_from_dh, forward
from jaxmodel.plan.arm_check import check_reached
from jaxmodel.plan.arm_models import gt6a_like

FOOT = se3.compose(Rotation.from_rotvec([0.1, 0.2, -0.7]).as_matrix(), np.array([5.0, -3.0, 0.4]))
SLIDING = arm_from_dh(
    np.array([[0.2, 0.4, 0.1, 0.3], [0.0, -1.1, 0.5, 0.2], [0.3, 0.0, 0.0, 0.0]]),
    np.array([[-1.0, 1.0], [0.0, 0.5], [-2.0, 2.0]]),
    ("revolute", "prismatic", "revolute"),
    T_world_base=FOOT,
)


def places(arm: Arm, count: int) -> tuple[np.ndarray, np.ndarray]:
    joints = np.random.default_rng(3).uniform(arm.limits[:, 0], arm.limits[:, 1], (count, arm.count))
    with jax.enable_x64(True):
        return joints, np.array(forward(arm, jax.numpy.asarray(joints)))


def test_it_agrees_with_the_solvers_kinematics() -> None:
    for arm in (gt6a_like(1.0, FOOT, FOOT), gt6a_like(1000.0), SLIDING):
        joints, T = places(arm, 40)
        check = check_reached(arm, joints, T)
        assert check.position_error.max() < 1e-12 * (arm.size + 10) and check.rotation_error.max() < 1e-11
        assert check.within_limits.all()


def test_it_measures_what_is_off() -> None:
    arm = gt6a_like(1.0)
    joints, T = places(arm, 40)
    off = T.copy()
    off[:, :3, 3] += 0.01 * np.array([2 / 3, -2 / 3, 1 / 3])
    angles = np.geomspace(1e-7, 3.1, 40)
    off[:, :3, :3] = T[:, :3, :3] @ Rotation.from_rotvec(angles[:, None] * [0.6, 0.0, 0.8]).as_matrix()
    check = check_reached(arm, joints, off)
    np.testing.assert_allclose(check.position_error, 0.01, rtol=1e-9)
    np.testing.assert_allclose(check.rotation_error, angles, rtol=1e-6)


def test_beyond_a_limit_and_no_joints_at_all() -> None:
    arm = gt6a_like(1.0)
    joints, T = places(arm, 3)
    joints[0, 2] = arm.limits[2, 1] + 1e-6
    joints[1] = np.nan
    check = check_reached(arm, joints, T)
    assert check.within_limits.tolist() == [False, False, True]
    assert np.isnan(check.position_error[1]) and check.position_error[2] < 1e-12
