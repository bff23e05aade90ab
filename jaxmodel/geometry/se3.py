"""Rigid motions as 4 x 4 matrices: the only place where jaxlie is imported.

``T_a_b`` maps coordinates in frame b to frame a: ``p_a = T_a_b @ p_b``. The tangent of SE(3) is ordered
``(translation, rotation)``, in the unit of the data and radians (jaxlie's order). Quaternions are ``(w, x, y, z)``
unless a name says otherwise. Host functions work in float64 with NumPy; ``exp`` and ``log`` are for kernels and keep
the precision of their argument.
"""

import jax
import jax.numpy as jnp
import jaxlie
import numpy as np
from jaxtyping import Bool, Float


def exp(tangent: Float[jax.Array, "*batch 6"]) -> Float[jax.Array, "*batch 4 4"]:
    """Exponential map of SE(3); the tangent is (translation, rotation vector)."""
    shift, turn = tangent[..., :3], tangent[..., 3:]
    # jaxlie's own translation is off by half the angle below 1e-5 rad (float32: 3e-3), and so is its derivative at 0
    s = jnp.sum(turn * turn, axis=-1, keepdims=True)
    small = s < 0.1
    angle = jnp.sqrt(jnp.where(small, 1.0, s))
    once = jnp.cross(turn, shift)
    a = jnp.where(small, 1 / 2 - s / 24 + s**2 / 720 - s**3 / 40320 + s**4 / 3628800, (1 - jnp.cos(angle)) / angle**2)
    b = jnp.where(
        small, 1 / 6 - s / 120 + s**2 / 5040 - s**3 / 362880 + s**4 / 39916800, (angle - jnp.sin(angle)) / angle**3
    )
    translation = shift + a * once + b * jnp.cross(turn, once)
    pose = jaxlie.SE3.from_rotation_and_translation(jaxlie.SO3.exp(turn), translation)
    return _keep_precision(pose.as_matrix(), tangent)


def log(T: Float[jax.Array, "*batch 4 4"]) -> Float[jax.Array, "*batch 6"]:
    """Logarithm of SE(3), inverse of ``exp`` for rotations below pi."""
    return _keep_precision(jaxlie.SE3.from_matrix(T).log(), T)


def rotation_exp(rotation_vector: Float[jax.Array, "*batch 3"]) -> Float[jax.Array, "*batch 3 3"]:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    return _keep_precision(jaxlie.SO3.exp(rotation_vector).as_matrix(), rotation_vector)


def rotation_log(R: Float[jax.Array, "*batch 3 3"]) -> Float[jax.Array, "*batch 3"]:
    """Rotation vector of a rotation matrix."""
    return _keep_precision(jaxlie.SO3.from_matrix(R).log(), R)


def _keep_precision(value: jax.Array, like: jax.Array) -> jax.Array:
    # jaxlie promotes float32 poses where 64-bit types are enabled; a pose keeps the precision it came with
    return value.astype(like.dtype)


def compose(R: Float[np.ndarray, "*batch 3 3"], t: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 4 4"]:
    """The 4 x 4 float64 matrix of a rotation and a translation."""
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], t.shape[:-1]), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = t
    T[..., 3, 3] = 1.0
    return T


def inverse(T_a_b: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """T_b_a, by transposing the rotation."""
    R = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return compose(R, -np.einsum("...ij,...j->...i", R, T_a_b[..., :3, 3]))


def apply(T_a_b: Float[np.ndarray, "4 4"], points_b: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Points in frame b expressed in frame a."""
    return points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def rotation_angle_deg(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch"]:
    """Angle of a rotation in degrees, accurate near 0 and near 180."""
    axis = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    sine = 0.5 * np.linalg.norm(axis, axis=-1)
    cosine = 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def quaternion_to_rotation(quaternion: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotation matrix of a quaternion (w, x, y, z) of any length but zero, in float64."""
    q = np.asarray(quaternion, np.float64)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, -1) for row in rows], -2)


def rotation_to_quaternion(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix; sound at every angle (largest component first)."""
    R = np.asarray(R, np.float64)
    m = [[R[..., i, j] for j in range(3)] for i in range(3)]
    trace = m[0][0] + m[1][1] + m[2][2]
    # 4 q qT, whose largest row is the best conditioned one
    outer = np.stack(
        [
            np.stack([1 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]], -1),
            np.stack([m[2][1] - m[1][2], 1 + 2 * m[0][0] - trace, m[0][1] + m[1][0], m[0][2] + m[2][0]], -1),
            np.stack([m[0][2] - m[2][0], m[0][1] + m[1][0], 1 + 2 * m[1][1] - trace, m[1][2] + m[2][1]], -1),
            np.stack([m[1][0] - m[0][1], m[0][2] + m[2][0], m[1][2] + m[2][1], 1 + 2 * m[2][2] - trace], -1),
        ],
        -2,
    )
    best = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(outer, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def quaternion_distance(
    a: Float[np.ndarray, "*batch 4"], b: Float[np.ndarray, "*batch 4"]
) -> Float[np.ndarray, "*batch"]:
    """min(|a - b|, |a + b|): both signs of a quaternion are the same rotation."""
    return np.asarray(np.minimum(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)))


def is_rigid(T: Float[np.ndarray, "4 4"], tolerance: float = 1e-4) -> bool:
    """Whether a matrix is a proper rigid motion to within ``tolerance`` (rounded text files pass)."""
    return bool(are_rigid(T, tolerance))


def are_rigid(T: Float[np.ndarray, "*batch 4 4"], tolerance: float = 1e-4) -> Bool[np.ndarray, "*batch"]:
    """As ``is_rigid``, for each of many."""
    finite = np.asarray(np.isfinite(T).all(axis=(-2, -1)))
    T = np.where(finite[..., None, None], T, 0.0)
    R, last = T[..., :3, :3], np.array([0.0, 0.0, 0.0, 1.0])
    orthonormal = np.isclose(R @ np.swapaxes(R, -1, -2), np.eye(3), atol=tolerance).all(axis=(-2, -1))
    whole = np.isclose(T[..., 3, :], last, atol=tolerance).all(axis=-1)
    return np.asarray(finite & whole & orthonormal & (np.linalg.det(R) > 0))
