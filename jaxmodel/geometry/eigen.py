"""Largest eigenvector of a symmetric 4 x 4 matrix without LAPACK.

Batched LAPACK calls are slow per lane and, two at a time, can hang on CPU; repeated squaring needs none.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Float


def largest_eigenvector(
    matrix: Float[jax.Array, "4 4"],
) -> tuple[Float[jax.Array, "4"], Float[jax.Array, ""]]:
    """Unit eigenvector of the largest eigenvalue, and how alone it is (1: one eigenvector, 1/2: two tie, ...).

    The shifted matrix ``N + |N| I`` is positive semi-definite with the same order of eigenvalues; squaring it s times
    raises their ratio to the power 2^s and leaves the projector on the eigenvector wanted.
    """
    rounds = 7 if matrix.dtype == jnp.float64 else 4
    shifted = matrix + jnp.sqrt(jnp.sum(matrix * matrix)) * jnp.eye(4, dtype=matrix.dtype)
    tiny = jnp.finfo(matrix.dtype).tiny
    for _ in range(rounds):
        # with a trace of 1 the largest eigenvalue is at least 1/4: four squarings leave it above 2^-32
        shifted = shifted / jnp.maximum(jnp.trace(shifted), tiny)
        for _ in range(4):
            shifted = jnp.matmul(shifted, shifted, precision=jax.lax.Precision.HIGHEST)
    trace = jnp.maximum(jnp.trace(shifted), tiny)
    purity = jnp.sum(shifted * shifted) / jnp.maximum(trace * trace, tiny)  # 0 for the zero matrix
    row = shifted[jnp.argmax(jnp.diagonal(shifted))]
    # projector = v vT: any row is a multiple of v, the one with the largest diagonal is the best conditioned
    return row / jnp.maximum(jnp.sqrt(jnp.sum(row * row)), tiny), purity
