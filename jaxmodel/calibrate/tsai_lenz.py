"""Tsai and Lenz 1989, "axis / angle" (RR-3507 §2.2.1): the rotation from the motions' axes, then the translation.

A reference method: simple and fast, but it needs rotations large enough to have axes, and its own unknown is infinite
where X turns by pi. There the B stream is first turned by the linear method's rotation.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import linear_rotation, linear_translation
from jaxmodel.calibrate.pairs import Pairs, align_signs, pair_sums, quaternions
from jaxmodel.geometry.elimination import solve_semidefinite
from jaxmodel.geometry.polar import skew
from jaxmodel.geometry.rigid_fit import rotation_from_quaternion

TURN_ABOVE = 2.6  # rad, about 150 degrees: from here on the tangent of half the angle magnifies noise 4 times and more
TINY = 1e-100


def solve_tsai_lenz(pairs: Pairs, unknown_scale: bool = False, unit_axes: bool = False) -> Estimate:
    """Rotation from ``As(n_A + n_B) n = n_B - n_A`` (eq. 2.1 for X, ERRATA), translation by least squares.

    ``n_A``, ``n_B`` are ``2 sin(angle / 2)`` times the axes, signs by the linear solution. ``unit_axes`` takes the axes
    alone, as RR-3507 prints it: the axis of the smallest motion, mostly noise, then counts as much as any.
    """
    sums = pair_sums(pairs)
    R_linear = linear_rotation(sums)
    turned = jnp.trace(R_linear) < 1 + 2 * jnp.cos(TURN_ABOVE)
    R_first = jnp.where(turned, R_linear, jnp.eye(3, dtype=R_linear.dtype))
    q_A = quaternions(pairs.R_A)
    q_B = align_signs(q_A, quaternions(pairs.R_B), R_linear)
    n_A, n_B = 2 * q_A[:, 1:], 2 * q_B[:, 1:]
    if unit_axes:
        n_A, n_B = (n / jnp.maximum(jnp.linalg.norm(n, axis=1, keepdims=True), TINY) for n in (n_A, n_B))
    R = _rotation_between(n_A, n_B @ R_first.T, pairs.weight) @ R_first
    return linear_translation(sums, R, unknown_scale)


def _rotation_between(
    n_A: Float[jax.Array, "n 3"], n_B: Float[jax.Array, "n 3"], weight: Float[jax.Array, " n"]
) -> Float[jax.Array, "3 3"]:
    S, difference = skew(n_A + n_B), n_B - n_A
    n = jnp.zeros(3, weight.dtype)
    matrix = jnp.einsum("n,nji,njk->ik", weight, S, S)
    for _ in range(2):  # the second pass wins back the digits that the normal matrix loses
        n = n + solve_semidefinite(matrix, jnp.einsum("n,nji,nj->i", weight, S, difference - S @ n))
    quaternion = jnp.concatenate([jnp.ones(1, n.dtype), n])  # n = tan(angle / 2) axis, eq. 2.2
    return rotation_from_quaternion(quaternion * jax.lax.rsqrt(jnp.sum(quaternion * quaternion)))
