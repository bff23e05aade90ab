"""Extreme eigenvectors of small symmetric matrices without LAPACK.

Batched LAPACK calls are slow per lane and, two at a time, can hang on CPU; repeated squaring needs none.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.geometry.elimination import inverse_positive


def largest_eigenvector(
    matrix: Float[jax.Array, "m m"],
) -> tuple[Float[jax.Array, " m"], Float[jax.Array, ""]]:
    """Unit eigenvector of the largest eigenvalue, and how alone it is (1: one eigenvector, 1/2: two tie, ...).

    The shifted matrix ``N + |N| I`` is positive semi-definite with the same order of eigenvalues; squaring it s times
    raises their ratio to the power 2^s and leaves the projector on the eigenvector wanted.
    """
    rounds = 7 if matrix.dtype == jnp.float64 else 4
    shifted = matrix + jnp.sqrt(jnp.sum(matrix * matrix)) * jnp.eye(matrix.shape[0], dtype=matrix.dtype)
    tiny = jnp.finfo(matrix.dtype).tiny
    for _ in range(rounds):
        # with a trace of 1 the largest eigenvalue is at least 1/m: four squarings leave it above m^-16
        shifted = shifted / jnp.maximum(jnp.trace(shifted), tiny)
        for _ in range(4):
            shifted = jnp.matmul(shifted, shifted, precision=jax.lax.Precision.HIGHEST)
    trace = jnp.maximum(jnp.trace(shifted), tiny)
    purity = jnp.sum(shifted * shifted) / jnp.maximum(trace * trace, tiny)  # 0 for the zero matrix
    row = shifted[jnp.argmax(jnp.diagonal(shifted))]
    # projector = v vT: any row is a multiple of v, the one with the largest diagonal is the best conditioned
    return row / jnp.maximum(jnp.sqrt(jnp.sum(row * row)), tiny), purity


def smallest_eigenvector(matrix: Float[jax.Array, "m m"]) -> Float[jax.Array, " m"]:
    """Unit eigenvector of the smallest eigenvalue of a positive semi-definite float64 matrix.

    Squaring the slightly shifted inverse: it separates eigenvalues by their ratio, however small both are.
    """
    size = matrix.shape[0]
    trace = jnp.trace(matrix)
    scaled = matrix / jnp.where(trace > 0, trace, 1.0)
    power = inverse_positive(scaled + 1e-14 * jnp.eye(size, dtype=matrix.dtype))
    for _ in range(10):
        power = power / jnp.trace(power)
        power = jnp.matmul(power, power, precision=jax.lax.Precision.HIGHEST)
    row = power[jnp.argmax(jnp.diagonal(power))]
    return row / jnp.maximum(jnp.sqrt(jnp.sum(row * row)), jnp.finfo(matrix.dtype).tiny)
