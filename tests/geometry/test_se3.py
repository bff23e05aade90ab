"""Rigid motions obey the algebra of SE(3), near the identity, at 180 degrees and in both precisions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3

ANGLES = (0.0, 1e-12, 1e-7, 1e-4, 0.3, 2.0, np.pi - 1e-3, np.pi - 1e-6)


def random_axes(count: int, seed: int = 0) -> np.ndarray:
    axes = np.random.default_rng(seed).normal(size=(count, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def rotation_vectors() -> np.ndarray:
    """Seven axes times every angle, the identity and nearly a half turn among them."""
    return np.concatenate([angle * random_axes(7, number) for number, angle in enumerate(ANGLES)])


def random_poses(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return se3.compose(Rotation.random(count, rng).as_matrix(), rng.normal(scale=10.0, size=(count, 3)))


def half_turns() -> np.ndarray:
    """Exact rotations by 180 degrees: about the three coordinate axes and about oblique ones."""
    axes = np.concatenate([np.eye(3), random_axes(20, 5), [[0.6, 0.8, 0.0], [0.0, -0.6, 0.8], [-0.8, 0.0, 0.6]]])
    return 2.0 * axes[:, :, None] * axes[:, None, :] - np.eye(3)


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 2e-9), (np.float32, 2e-3)])
def test_log_inverts_exp(dtype: type, tolerance: float) -> None:
    # a unit of rounding in the matrix is worth eps / (pi - angle) in the vector: the next test is sharp away from pi
    vectors = rotation_vectors()
    shifts = np.random.default_rng(1).normal(size=vectors.shape)
    if dtype is np.float32:  # pi - 1e-6 is beyond pi in float32
        vectors, shifts = vectors[:-7], shifts[:-7]
    with jax.enable_x64(dtype is np.float64):
        tangent = jnp.asarray(np.concatenate([shifts, vectors], axis=1), dtype)
        back = np.asarray(se3.log(se3.exp(tangent)))
    assert back.dtype == dtype
    np.testing.assert_allclose(back, np.asarray(tangent), atol=tolerance)


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 4e-15), (np.float32, 2e-6)])
def test_log_inverts_exp_closely_below_two_radians(dtype: type, tolerance: float) -> None:
    vectors = np.concatenate([angle * random_axes(7, 11) for angle in (0.0, 1e-7, 1e-5, 1e-3, 3e-3, 0.1, 0.4, 2.0)])
    shifts = np.random.default_rng(2).uniform(-1, 1, size=vectors.shape)
    with jax.enable_x64(dtype is np.float64):
        tangent = jnp.asarray(np.concatenate([shifts, vectors], axis=1), dtype)
        back = np.asarray(se3.log(se3.exp(tangent)))
        turns = np.asarray(se3.rotation_log(se3.rotation_exp(tangent[:, 3:])))
    np.testing.assert_allclose(back, np.asarray(tangent), rtol=0, atol=tolerance)
    np.testing.assert_allclose(turns, np.asarray(tangent[:, 3:]), rtol=0, atol=tolerance)


def test_exp_is_the_matrix_exponential() -> None:  # oracle: scipy.linalg.expm
    vectors = rotation_vectors()
    tangents = np.concatenate([np.random.default_rng(3).normal(size=vectors.shape), vectors], axis=1)
    with jax.enable_x64(True):
        ours = np.asarray(se3.exp(jnp.asarray(tangents)))
    for pose, (a, b, c, x, y, z) in zip(ours, tangents, strict=True):
        generator = np.array([[0, -z, y, a], [z, 0, -x, b], [-y, x, 0, c], [0, 0, 0, 0]])
        np.testing.assert_allclose(pose, expm(generator), rtol=0, atol=1e-14)


def test_exp_agrees_with_scipy() -> None:  # oracle
    vectors = rotation_vectors()
    with jax.enable_x64(True):
        ours = np.asarray(se3.rotation_exp(jnp.asarray(vectors)))
        poses = np.asarray(se3.exp(jnp.asarray(np.concatenate([np.zeros_like(vectors), vectors], axis=1))))
    oracle = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(ours, oracle, atol=1e-14)
    np.testing.assert_allclose(poses[:, :3, :3], oracle, atol=1e-14)
    np.testing.assert_array_equal(poses[:, :3, 3], 0.0)


def test_exp_of_a_screw_is_one_parameter_subgroup() -> None:
    """exp(a x) exp(b x) = exp((a + b) x): translation and rotation parts both."""
    rng = np.random.default_rng(4)
    tangent = rng.normal(size=(12, 6))
    with jax.enable_x64(True):
        parts = [np.asarray(se3.exp(jnp.asarray(share * tangent))) for share in (0.3, 0.5, 0.8)]
    np.testing.assert_allclose(parts[0] @ parts[1], parts[2], atol=1e-13)


@pytest.mark.parametrize("enabled", [False, True])
@pytest.mark.parametrize("function", [se3.exp, se3.log, se3.rotation_exp, se3.rotation_log])
def test_float32_stays_float32(function, enabled: bool) -> None:
    argument = {
        se3.exp: np.full(6, 0.1),
        se3.log: np.eye(4),
        se3.rotation_exp: np.full(3, 0.1),
        se3.rotation_log: np.eye(3),
    }[function]
    with jax.enable_x64(enabled):
        assert function(jnp.asarray(argument, jnp.float32)).dtype == jnp.float32
        if enabled:
            assert function(jnp.asarray(argument, jnp.float64)).dtype == jnp.float64


def test_gradients_are_finite_at_the_identity() -> None:
    forward = jax.jacfwd(se3.exp)(jnp.zeros(6))
    assert np.all(np.isfinite(forward))
    reverse = jax.jacrev(se3.exp)(jnp.zeros(6))
    np.testing.assert_allclose(reverse, forward, atol=1e-6)
    # the derivative at zero is the basis of the Lie algebra: d/dv of the translation column is the identity
    np.testing.assert_allclose(forward[:3, 3, :3], np.eye(3), atol=1e-6)
    shifted = jax.jacrev(se3.exp)(jnp.asarray([2.0, 0, 0, 0, 0, 0]))[:3, 3, 3:]  # half the cross product
    np.testing.assert_allclose(shifted, [[0, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-6)
    round_trip = jax.jacrev(lambda v: se3.log(se3.exp(v)))(jnp.zeros(6))
    np.testing.assert_allclose(round_trip, np.eye(6), atol=1e-5)


def test_group_laws() -> None:
    a, b, c = (random_poses(20, seed) for seed in range(3))
    np.testing.assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-13)
    np.testing.assert_allclose(se3.inverse(a) @ a, np.broadcast_to(np.eye(4), a.shape), atol=1e-13)
    np.testing.assert_allclose(a @ se3.inverse(a), np.broadcast_to(np.eye(4), a.shape), atol=1e-13)
    np.testing.assert_allclose(se3.inverse(a @ b), se3.inverse(b) @ se3.inverse(a), atol=1e-13)
    np.testing.assert_allclose(se3.inverse(se3.inverse(a)), a, atol=1e-13)
    assert all(se3.is_rigid(pose) for pose in (*(a @ b), *se3.inverse(c)))


def test_apply_composes() -> None:
    T_a_b, T_b_c = random_poses(2, 6)
    points_c = np.random.default_rng(7).normal(size=(4, 5, 3))
    np.testing.assert_allclose(
        se3.apply(T_a_b, se3.apply(T_b_c, points_c)), se3.apply(T_a_b @ T_b_c, points_c), atol=1e-13
    )
    np.testing.assert_allclose(se3.apply(se3.inverse(T_a_b), se3.apply(T_a_b, points_c)), points_c, atol=1e-13)


def test_rotation_angle_is_accurate_at_both_ends() -> None:
    angles = np.array([0.0, 1e-12, 1e-7, 1e-3, 1.0, np.pi / 2, 3.0, np.pi - 1e-7, np.pi - 1e-12, np.pi])
    for axis in random_axes(5, 9):
        R = Rotation.from_rotvec(angles[:, None] * axis).as_matrix()
        np.testing.assert_allclose(se3.rotation_angle_deg(R), np.degrees(angles), rtol=1e-7, atol=2e-14)
    np.testing.assert_allclose(se3.rotation_angle_deg(half_turns()), 180.0, atol=1e-12)


def test_quaternion_conversions_are_inverse() -> None:
    rotations = np.concatenate([Rotation.from_rotvec(rotation_vectors()).as_matrix(), half_turns()])
    quaternions = se3.rotation_to_quaternion(rotations)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-15)
    assert np.all(quaternions[:, 0] >= 0)
    np.testing.assert_allclose(se3.quaternion_to_rotation(quaternions), rotations, atol=1e-14)
    # both signs and any length are the same rotation
    np.testing.assert_allclose(se3.quaternion_to_rotation(-3.7 * quaternions), rotations, atol=1e-14)
    oracle = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    np.testing.assert_allclose(se3.quaternion_distance(quaternions, oracle), 0.0, atol=1e-14)


def test_quaternion_keeps_tiny_angles() -> None:
    vectors = 1e-9 * random_axes(6, 3)
    R = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(se3.rotation_to_quaternion(R)[:, 1:], vectors / 2, rtol=1e-6)


def test_quaternion_distance_ignores_the_sign() -> None:
    a, b = (Rotation.random(30, np.random.default_rng(seed)).as_quat(scalar_first=True) for seed in (1, 2))
    distance = se3.quaternion_distance(a, b)
    np.testing.assert_array_equal(se3.quaternion_distance(-a, b), distance)
    # the chord of the angle between the rotations: 2 sin(angle / 4)
    relative = Rotation.from_quat(a, scalar_first=True).inv() * Rotation.from_quat(b, scalar_first=True)
    np.testing.assert_allclose(distance, 2 * np.sin(relative.magnitude() / 4), atol=1e-14)


@pytest.mark.parametrize("fault", ["mirror", "scale", "shear", "nan", "infinite", "bottom_row", "rounded_far"])
def test_is_rigid_refuses(fault: str) -> None:
    T = random_poses(1, 8)[0]
    assert se3.is_rigid(T)
    broken = T.copy()
    if fault == "mirror":
        broken[:3, 0] *= -1
    elif fault == "scale":
        broken[:3, :3] *= 1.01
    elif fault == "shear":
        broken[:3, 0] += 0.01 * broken[:3, 1]
    elif fault == "nan":
        broken[0, 3] = np.nan
    elif fault == "infinite":
        broken[1, 3] = np.inf
    elif fault == "bottom_row":
        broken[3, 0] = 0.5
    else:
        broken[:3, :3] = np.round(broken[:3, :3], 2)
    assert not se3.is_rigid(broken)


def test_is_rigid_accepts_text_rounding() -> None:
    assert all(se3.is_rigid(np.round(T, 6)) for T in random_poses(20, 10))
