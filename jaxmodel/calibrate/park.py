"""Park and Martin 1994: the rotation that best maps the B stream's rotation vectors on the A stream's.

A modern reference: least squares on the logarithms, in closed form. Two motions are enough (the published matrix form
needs three), since the fit is Horn's quaternion one. It needs rotations with a logarithm, so the signs near pi are
those of the linear solution.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import linear_rotation, linear_translation
from jaxmodel.calibrate.pairs import Pairs, pair_sums, quaternions, rotation_vectors
from jaxmodel.geometry.rigid_fit import Moments, quaternion_from_moments, rotation_from_quaternion


def solve_park(pairs: Pairs, unknown_scale: bool = False) -> Estimate:
    """Rotation by ``min sum w |log R_A - R_X log R_B|^2``, translation by least squares (eq. 3.14)."""
    sums = pair_sums(pairs)
    R_linear = linear_rotation(sums)
    a = rotation_vectors(quaternions(pairs.R_A))
    b = rotation_vectors(quaternions(pairs.R_B))
    # beyond pi the same rotation has the vector b - 2 pi b / |b|: the nearer of both is meant
    length = jnp.sqrt(jnp.sum(b * b, axis=1, keepdims=True))
    other = b - 2 * jnp.pi * b / jnp.where(length > 0, length, 1.0)
    nearer = jnp.sum((a - other @ R_linear.T) ** 2, axis=1) < jnp.sum((a - b @ R_linear.T) ** 2, axis=1)
    b = jnp.where(nearer[:, None] & (length > 1e-3), other, b)
    return linear_translation(sums, rotation_between(a, b, pairs.weight), unknown_scale)


def rotation_between(
    a: Float[jax.Array, "n 3"], b: Float[jax.Array, "n 3"], weight: Float[jax.Array, " n"]
) -> Float[jax.Array, "3 3"]:
    """The R of least ``sum w |a - R b|^2`` (Horn 1987)."""
    covariance = jnp.einsum("n,ni,nj->ij", weight, b, a)
    size = jnp.sqrt(jnp.sum(covariance * covariance))
    zero = jnp.zeros(3, size.dtype)
    moments = Moments(jnp.sum(weight), zero, zero, covariance / jnp.where(size > 0, size, 1.0))
    quaternion, _ = quaternion_from_moments(moments)
    return rotation_from_quaternion(quaternion)
