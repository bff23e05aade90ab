"""Simulated hand-eye problems with the report's own draws and noise (RR-3507 §3.5); A is the camera's motion.

Everything is made from standard normals given by the caller, so that draw i is the same in any batch. Rotations are
``Rz(yaw) Ry(pitch) Rx(roll)``.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3


def normals(seed: int, stream: int, first: int, count: int, size: int) -> Float[np.ndarray, "count size"]:
    """Standard normals of draws ``first`` to ``first + count``: draw i comes from ``fold_in(key, i)``."""
    key = jax.random.fold_in(jax.random.key(seed), stream)
    with jax.enable_x64(True):
        one = jax.vmap(lambda i: jax.random.normal(jax.random.fold_in(key, i), (size,), jnp.float64))
        return np.asarray(one(jnp.arange(first, first + count, dtype=jnp.uint32)))


def rigid(drawn: Float[np.ndarray, "*b 6"], angle: float, length: float) -> Float[np.ndarray, "*b 4 4"]:
    """Transforms with roll, pitch, yaw of standard deviation ``angle`` (rad) and translations of ``length``."""
    R = Rotation.from_euler("xyz", angle * drawn[..., :3].reshape(-1, 3)).as_matrix()
    return se3.compose(R.reshape(*drawn.shape[:-1], 3, 3), length * drawn[..., 3:])


def conjugate(X: Float[np.ndarray, "*b 4 4"], B: Float[np.ndarray, "*b n 4 4"]) -> Float[np.ndarray, "*b n 4 4"]:
    """``A = X B X^-1`` of each motion."""
    return X[..., None, :, :] @ B @ se3.inverse(X)[..., None, :, :]


def with_report_noise(
    A: Float[np.ndarray, "*b 4 4"], noise: float, drawn: Float[np.ndarray, "*b 6"]
) -> Float[np.ndarray, "*b 4 4"]:
    """§3.5.1: ``t + noise |t| n``, and each of the roll, pitch and yaw angles times ``1 + noise r``."""
    angles = Rotation.from_matrix(A[..., :3, :3].reshape(-1, 3, 3)).as_euler("xyz")
    angles = angles * (1 + noise * drawn[..., :3].reshape(-1, 3))
    R = Rotation.from_euler("xyz", angles).as_matrix().reshape(A[..., :3, :3].shape)
    t = A[..., :3, 3]
    return se3.compose(R, t + noise * np.linalg.norm(t, axis=-1, keepdims=True) * drawn[..., 3:])


def errors(X: Float[np.ndarray, "*b 4 4"], true: Float[np.ndarray, "*b 4 4"]) -> tuple[np.ndarray, np.ndarray]:
    """Angle (degrees) and ``|t - t*| / |t*|`` of each X; NaN where X is not finite."""
    finite = np.asarray(np.isfinite(X).all(axis=(-2, -1)))
    clean = np.where(finite[..., None, None], X, np.eye(4))
    angle = se3.rotation_angle_deg(clean[..., :3, :3] @ np.swapaxes(true[..., :3, :3], -1, -2))
    shift = np.linalg.norm(clean[..., :3, 3] - true[..., :3, 3], axis=-1) / np.linalg.norm(true[..., :3, 3], axis=-1)
    return np.where(finite, angle, np.nan), np.where(finite, shift, np.nan)
