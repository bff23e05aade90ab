"""Small symmetric systems by hand-written elimination: batched LAPACK calls can hang on CPU, and are slow per lane."""

from typing import Any

import jax
import jax.numpy as jnp
import lineax
from jaxtyping import Bool, Float


def solve_positive(
    matrix: Float[jax.Array, "m m"], right: Float[jax.Array, " m"], least: Float[jax.Array, " m"] | float = 0.0
) -> tuple[Float[jax.Array, " m"], Bool[jax.Array, ""]]:
    """Solution of a small symmetric positive definite system by scaled elimination, and whether it is well posed.

    ``least``: a diagonal entry below it is rounding, and is not scaled up to look
    like a measurement.
    """
    size = right.shape[0]
    diagonal = jnp.maximum(jnp.diagonal(matrix), least)
    scale = jax.lax.rsqrt(jnp.where(diagonal > 0, diagonal, 1.0))  # unit diagonal: rotation and translation alike
    augmented = jnp.concatenate([matrix * scale[:, None] * scale[None, :], (right * scale)[:, None]], axis=1)
    smallest = jnp.asarray(jnp.inf, matrix.dtype)
    for k in range(size):
        pivot = augmented[k, k]
        smallest = jnp.minimum(smallest, pivot)
        pivot = jnp.where(pivot > 0, pivot, 1.0)
        reduced = augmented[k] / pivot
        eliminated = augmented - augmented[:, k : k + 1] * reduced[None, :]
        augmented = jnp.where((jnp.arange(size) == k)[:, None], reduced[None, :], eliminated)
    # a pivot at rounding level means a direction the data say nothing about
    rounding = 1e-5 if matrix.dtype == jnp.float32 else 1e-13
    return augmented[:, -1] * scale, smallest > rounding


def solve_semidefinite(
    matrix: Float[jax.Array, "m m"],
    right: Float[jax.Array, " m"],
    rounding: float = 1e-12,
    least: Float[jax.Array, "*some"] | float = 0.0,
) -> Float[jax.Array, " m"]:
    """A solution of a symmetric positive semi-definite system: unknowns whose pivot is rounding are left at zero.

    ``rounding`` is relative to the unknown's diagonal entry; an unknown whose entry is not above ``least`` is left too.
    """
    scale = jnp.where(jnp.diagonal(matrix) > least, _unit_scale(matrix), 0.0)
    augmented = jnp.concatenate([matrix * scale[:, None] * scale[None, :], (right * scale)[:, None]], axis=1)
    return _eliminate(augmented, rounding)[:, -1] * scale


def inverse_positive(matrix: Float[jax.Array, "m m"]) -> Float[jax.Array, "m m"]:
    """Inverse of a small symmetric positive definite matrix; unknowns whose pivot is not positive get zeros."""
    scale = _unit_scale(matrix)
    size = matrix.shape[0]
    unit = jnp.eye(size, dtype=matrix.dtype)
    augmented = jnp.concatenate([matrix * scale[:, None] * scale[None, :], unit], axis=1)
    inverse = _eliminate(augmented, 0.0)[:, size:] * scale[:, None] * scale[None, :]
    return 0.5 * (inverse + inverse.T)


def square_root(matrix: Float[jax.Array, "m m"], rounding: float = 1e-15) -> Float[jax.Array, "m m"]:
    """``U`` with ``U^T U = matrix`` for a symmetric positive semi-definite matrix; its null space gives zero rows."""
    size = matrix.shape[0]
    scale = _unit_scale(matrix)

    def body(k: jax.Array, state: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        rest, factor = state
        pivot = rest[k, k]
        known = pivot > rounding
        row = jnp.where(known & (jnp.arange(size) >= k), rest[k] / jnp.sqrt(jnp.where(known, pivot, 1.0)), 0.0)
        return rest - row[:, None] * row[None, :], factor.at[k].set(row)

    start = (matrix * scale[:, None] * scale[None, :], jnp.zeros_like(matrix))
    _, factor = jax.lax.fori_loop(0, size, body, start)
    return factor / jnp.where(scale > 0, scale, 1.0)[None, :]


def _unit_scale(matrix: Float[jax.Array, "m m"]) -> Float[jax.Array, " m"]:
    diagonal = jnp.diagonal(matrix)
    return jnp.where(diagonal > 0, jax.lax.rsqrt(jnp.where(diagonal > 0, diagonal, 1.0)), 0.0)


def _eliminate(augmented: Float[jax.Array, "m k"], rounding: float) -> Float[jax.Array, "m k"]:
    """Gauss-Jordan without exchange of rows: a loop and not unrolled code, which compiles slowly for larger systems."""
    size = augmented.shape[0]

    def body(k: jax.Array, augmented: jax.Array) -> jax.Array:
        pivot = augmented[k, k]
        known = pivot > rounding
        reduced = jnp.where(known, augmented[k] / jnp.where(known, pivot, 1.0), 0.0)
        eliminated = augmented - augmented[:, k][:, None] * reduced[None, :]
        return jnp.where((jnp.arange(size) == k)[:, None], reduced[None, :], eliminated)

    return jax.lax.fori_loop(0, size, body, augmented)


class NormalEquations(lineax.AbstractLinearSolver[jax.Array]):
    """Least squares for optimistix by normal equations and elimination: no LAPACK call inside its loop."""

    def init(self, operator: lineax.AbstractLinearOperator, options: dict[str, Any]) -> jax.Array:
        return operator.as_matrix()

    def compute(
        self, state: jax.Array, vector: Any, options: dict[str, Any]
    ) -> tuple[Any, lineax.RESULTS, dict[str, Any]]:
        flat = jnp.concatenate([leaf.reshape(-1) for leaf in jax.tree.leaves(vector)])
        return solve_semidefinite(state.T @ state, state.T @ flat, 1e-15), lineax.RESULTS.successful, {}

    def transpose(self, state: jax.Array, options: dict[str, Any]) -> tuple[jax.Array, dict[str, Any]]:
        return state.T, options

    def conj(self, state: jax.Array, options: dict[str, Any]) -> tuple[jax.Array, dict[str, Any]]:
        return state, options

    def assume_full_rank(self) -> bool:
        return False
