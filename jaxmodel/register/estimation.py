"""The motion that best superposes one iteration's kept pairs, without LAPACK (thesis §2.6; Chen & Medioni 1991)."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from jaxmodel.geometry.elimination import solve_positive
from jaxmodel.geometry.rigid_fit import METHODS, Method, Moments, quaternion_from_moments, rotation_from_quaternion
from jaxmodel.register.rejection import sum_over_points

# below this share of uniqueness two rotations fit equally well (see geometry/eigen.py)
ALONE = 0.999


class Estimate(eqx.Module):
    rotation: Float[jax.Array, "3 3"]
    translation: Float[jax.Array, "3"]
    determined: Bool[jax.Array, ""]


def fit_point_to_point(moments: Moments, method: Method) -> Estimate:
    """Closed-form fit of the whole motion from the pairs' moments."""
    quaternion, alone = quaternion_from_moments(moments)
    if method == "quaternion":
        R = rotation_from_quaternion(quaternion)
        return Estimate(R, moments.target_mean - R @ moments.source_mean, alone > ALONE)
    R, t = METHODS[method](moments)
    return Estimate(R, t, alone > ALONE)


def fit_point_to_plane(
    R: Float[jax.Array, "3 3"],
    t: Float[jax.Array, "3"],
    moved: Float[jax.Array, "3 n"],
    target: list[Float[jax.Array, " n"]],
    normal: list[Float[jax.Array, " n"]],
    weight: Float[jax.Array, " n"],
    sums_of: Callable[[list[jax.Array]], tuple[jax.Array, ...]] = sum_over_points,
) -> Estimate:
    """One Gauss-Newton step on ``sum w (n . (target - moved - omega x moved - v))^2`` applied to the pose (R, t).

    ``moved`` are the source's points at that pose. The 6 x 6 system is solved by a hand-written elimination.
    """
    x, y, z = moved
    residual = sum(n * (q - p) for n, q, p in zip(normal, target, moved, strict=True))
    row = [y * normal[2] - z * normal[1], z * normal[0] - x * normal[2], x * normal[1] - y * normal[0], *normal]
    upper = [weight * row[i] * row[j] for i in range(6) for j in range(i, 6)]
    right = [weight * row[i] * residual for i in range(6)]
    sums = sums_of([*upper, *right, weight * (x * x + y * y + z * z)])
    matrix = [[jnp.float32(0)] * 6 for _ in range(6)]
    pairs = [(i, j) for i in range(6) for j in range(i, 6)]
    for (i, j), value in zip(pairs, sums[:21], strict=True):
        matrix[i][j] = matrix[j][i] = value
    # a rotation that moves no point out of its plane by a share of 1e-4 of the lever arms is not seen at all
    least = 1e-8 * sums[27] * jnp.asarray([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    solution, determined = solve_positive(jnp.stack([jnp.stack(r) for r in matrix]), jnp.stack(sums[21:27]), least)
    turn = _rotation(solution[:3])
    rotation = turn @ R
    # one Newton step towards the nearest rotation keeps the product of many turns orthonormal
    rotation = rotation @ (1.5 * jnp.eye(3) - 0.5 * rotation.T @ rotation)
    return Estimate(rotation, turn @ t + solution[3:], determined)


def _rotation(vector: Float[jax.Array, "3"]) -> Float[jax.Array, "3 3"]:
    """Rotation of a small rotation vector, through the unit quaternion (1, v / 2)."""
    half = 0.5 * vector
    quaternion = jnp.concatenate([jnp.ones(1, vector.dtype), half])
    return rotation_from_quaternion(quaternion * jax.lax.rsqrt(1.0 + jnp.sum(half * half)))
