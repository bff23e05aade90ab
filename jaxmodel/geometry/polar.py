"""The rotation nearest to a 3 x 3 matrix, without LAPACK."""

import jax
import jax.numpy as jnp
from jaxtyping import Float


def nearest_rotation(matrix: Float[jax.Array, "3 3"]) -> Float[jax.Array, "3 3"]:
    """The rotation nearest in the Frobenius norm to a matrix of positive determinant (its orthogonal polar factor).

    Newton's iteration of Higham 1986, scaled by the determinant. The identity where the determinant is not positive.
    """
    size = jnp.sqrt(jnp.sum(matrix * matrix))
    unit = matrix / jnp.where(size > 0, size, 1.0)
    determinant = jnp.dot(unit[0], jnp.cross(unit[1], unit[2]))
    sound = determinant > 1e-12
    X = jnp.where(sound, unit, jnp.eye(3, dtype=matrix.dtype))
    for _ in range(12):
        cofactors = jnp.stack([jnp.cross(X[1], X[2]), jnp.cross(X[2], X[0]), jnp.cross(X[0], X[1])])
        volume = jnp.dot(X[0], cofactors[0])
        scale = jnp.cbrt(volume)
        X = 0.5 * (X / scale + cofactors * (scale / volume))  # cofactors / volume is the inverse transpose
    return X


def skew(vector: Float[jax.Array, "*batch 3"]) -> Float[jax.Array, "*batch 3 3"]:
    """The matrix of the cross product: ``skew(v) @ u = v x u`` (As of RR-3507)."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = jnp.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
