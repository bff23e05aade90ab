"""Small matrices and quaternions with the batch as the last axis: each operation runs over all sets at once.

``(3, 3, b)`` instead of ``(b, 3, 3)``: processors work along the last axis, and no call to LAPACK is needed.
"""

import functools
import operator
from collections.abc import Callable, Iterable

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.geometry.polar import skew as skew_rows

SQUARINGS = 3  # the eigenvalues' ratio to the power 8 in every step that follows
MOST_STEPS = 128


def matmul(a: Float[jax.Array, "i k ..."], b: Float[jax.Array, "k j ..."]) -> Float[jax.Array, "i j ..."]:
    """Matrix product, its inner sum written out: three times as fast as a reduction."""
    return _sum(a[:, k][:, None] * b[k][None] for k in range(a.shape[1]))


def transposed(a: Float[jax.Array, "i j ..."]) -> Float[jax.Array, "j i ..."]:
    """Matrix transpose."""
    return jnp.swapaxes(a, 0, 1)


def apply(a: Float[jax.Array, "i k ..."], v: Float[jax.Array, "k ..."]) -> Float[jax.Array, "i ..."]:
    """Matrix times vector."""
    return _sum(a[:, k] * v[k][None] for k in range(a.shape[1]))


def sum_of_krons(a: Float[jax.Array, "3 3 n b"], b: Float[jax.Array, "3 3 n b"]) -> Float[jax.Array, "9 9 b"]:
    """Sum over n of Kronecker products."""
    return _sum_over(lambda x, y: x[:, None, :, None] * y[None, :, None, :], a, b).reshape(9, 9, -1)


def sum_of_products(a: Float[jax.Array, "*i n b"], b: Float[jax.Array, "j n b"]) -> Float[jax.Array, "*i j b"]:
    """Sum over n of outer products."""
    return _sum_over(lambda x, y: x[..., None, :] * y, a, b)


def sum_of_squares(a: Float[jax.Array, "i j n b"], w: Float[jax.Array, "n b"]) -> Float[jax.Array, "j j b"]:
    """Sum over n of ``w a^T a``."""
    return _sum_over(lambda x, y: matmul(transposed(y), x), a, w * a)


def kron(a: Float[jax.Array, "3 3 ..."], b: Float[jax.Array, "3 3 ..."]) -> Float[jax.Array, "9 9 ..."]:
    """Kronecker product."""
    product = a[:, None, :, None] * b[None, :, None, :]
    return product.reshape(9, 9, *product.shape[4:])


def skew(v: Float[jax.Array, "3 ..."]) -> Float[jax.Array, "3 3 ..."]:
    """The matrix of the cross product with v."""
    return jnp.moveaxis(skew_rows(jnp.moveaxis(v, 0, -1)), (-2, -1), (0, 1))


def quaternion_product(p: Float[jax.Array, "4 ..."], q: Float[jax.Array, "4 ..."]) -> Float[jax.Array, "4 ..."]:
    """``p q``, scalar first."""
    a, b, c, d = p
    e, f, g, h = q
    return jnp.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ]
    )


def conjugate(q: Float[jax.Array, "4 ..."]) -> Float[jax.Array, "4 ..."]:
    """The inverse of a unit quaternion."""
    return jnp.concatenate([q[:1], -q[1:]])


def quaternion(R: Float[jax.Array, "3 3 ..."]) -> Float[jax.Array, "4 ..."]:
    """Unit quaternion (w, x, y, z) of either sign, sound at every angle: the largest component comes from a root."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    xy, xz, yz = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    rows = (
        (1 + trace, x, y, z),
        (x, 1 + 2 * R[0, 0] - trace, xy, xz),
        (y, xy, 1 + 2 * R[1, 1] - trace, yz),
        (z, xz, yz, 1 + 2 * R[2, 2] - trace),
    )
    best, q = rows[0][0], jnp.stack(rows[0])
    for k in range(1, 4):
        larger = rows[k][k] > best
        best, q = jnp.where(larger, rows[k][k], best), jnp.where(larger, jnp.stack(rows[k]), q)
    return q * jax.lax.rsqrt(jnp.sum(q * q, axis=0))


def rotation(q: Float[jax.Array, "4 ..."]) -> Float[jax.Array, "3 3 ..."]:
    """Rotation matrix of a unit quaternion."""
    excess, _ = rotation_excess(q)
    return excess + jnp.eye(3, dtype=q.dtype).reshape(3, 3, *([1] * (q.ndim - 1)))


def rotation_excess(q: Float[jax.Array, "4 ..."]) -> tuple[Float[jax.Array, "3 3 ..."], Float[jax.Array, "3 3 ..."]]:
    """``R - I`` and ``R + R^T - 2 I`` of a unit quaternion, both exact to rounding however small the angle."""
    V = skew(q[1:])
    square = matmul(V, V)
    return 2 * (q[0] * V + square), 4 * square


def nearest_rotation(matrix: Float[jax.Array, "3 3 b"]) -> Float[jax.Array, "3 3 b"]:
    """The orthogonal polar factor of matrices of positive determinant, by Newton's iteration (Higham 1986)."""

    def step(_: jax.Array, X: jax.Array) -> jax.Array:
        cofactors = _cofactors(X)
        volume = jnp.sum(X[0] * cofactors[0], axis=0)
        scale = jnp.cbrt(volume)
        return 0.5 * (X / scale + cofactors * (scale / volume))

    return jax.lax.fori_loop(0, 12, step, matrix)


def determinant(matrix: Float[jax.Array, "3 3 b"]) -> Float[jax.Array, " b"]:
    """Determinant of 3 x 3 matrices."""
    return jnp.sum(matrix[0] * _cofactors(matrix)[0], axis=0)


def solve_symmetric(matrix: Float[jax.Array, "3 3 b"], right: Float[jax.Array, "3 b"]) -> Float[jax.Array, "3 b"]:
    """Solution of 3 x 3 symmetric systems by cofactors; not finite where the matrix is singular."""
    cofactors = _cofactors(matrix)
    return apply(cofactors, right) / jnp.sum(matrix[0] * cofactors[0], axis=0)


def solve_positive(
    matrix: Float[jax.Array, "m m b"], right: Float[jax.Array, "m b"], rounding: float = 1e-12
) -> Float[jax.Array, "m b"]:
    """Solution of symmetric positive semi-definite systems by scaled elimination.

    An unknown whose pivot is not above ``rounding`` of its own diagonal entry is left at zero.
    """
    size = len(right)
    diagonal = jnp.stack([matrix[k, k] for k in range(size)])
    scale = jnp.where(diagonal > 0, jax.lax.rsqrt(jnp.where(diagonal > 0, diagonal, 1.0)), 0.0)
    augmented = jnp.concatenate([matrix * scale[:, None] * scale[None], (right * scale)[:, None]], axis=1)
    place = jnp.arange(size)[:, None, None]

    def step(k: jax.Array, rows: jax.Array) -> jax.Array:
        row, column = jnp.take(rows, k, axis=0), jnp.take(rows, k, axis=1)
        pivot = jnp.take(row, k, axis=0)
        known = pivot > rounding
        reduced = jnp.where(known, row / jnp.where(known, pivot, 1.0), 0.0)
        return jnp.where(place == k, reduced[None], rows - column[:, None] * reduced[None])

    return jax.lax.fori_loop(0, size, step, augmented)[:, -1] * scale


def smallest_eigenvector(matrix: Float[jax.Array, "m m b"]) -> Float[jax.Array, "m b"]:
    """Unit eigenvector of the smallest eigenvalue of positive semi-definite matrices.

    Their inverse is squared a few times and then applied until no vector of the batch changes any more.
    """
    size = matrix.shape[0]
    eye = jnp.eye(size, dtype=matrix.dtype)[:, :, None]
    trace = jnp.trace(matrix)
    power = _inverse(matrix / jnp.where(trace > 0, trace, 1.0) + 1e-14 * eye)

    def square(_: jax.Array, power: jax.Array) -> jax.Array:
        power = power / jnp.trace(power)
        return matmul(power, power)

    power = jax.lax.fori_loop(0, SQUARINGS, square, power)
    # close to the projector v v^T: the row with the largest diagonal is the best conditioned
    diagonal = jnp.stack([power[k, k] for k in range(size)])
    chosen = jnp.arange(size)[:, None] == jnp.argmax(diagonal, axis=0)
    start = _unit(jnp.sum(jnp.where(chosen[:, None], power, 0.0), axis=0))

    def again(state: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array, jax.Array]:
        step, v, _ = state
        next_v = _unit(apply(power, v))
        return step + 1, next_v, jnp.max(jnp.abs(next_v - v))

    def moving(state: tuple[jax.Array, jax.Array, jax.Array]) -> jax.Array:
        step, _, change = state
        return (step < MOST_STEPS) & (change > 4 * jnp.finfo(matrix.dtype).eps)

    infinite = jnp.asarray(jnp.inf, matrix.dtype)
    return jax.lax.while_loop(moving, again, (jnp.zeros((), jnp.int32), start, infinite))[1]


def _sum_over(term: Callable[..., jax.Array], *arrays: jax.Array) -> jax.Array:
    """Sum over the last axis but one: a loop, which compiles faster than its terms written out and is as fast."""

    def at(i: jax.Array | int) -> jax.Array:
        return term(*(jax.lax.dynamic_index_in_dim(a, i, a.ndim - 2, keepdims=False) for a in arrays))

    return jax.lax.fori_loop(1, arrays[0].shape[-2], lambda i, total: total + at(i), at(0))


def _sum(terms: Iterable[jax.Array]) -> jax.Array:
    return functools.reduce(operator.add, terms)


def _unit(v: Float[jax.Array, "m b"]) -> Float[jax.Array, "m b"]:
    return v * jax.lax.rsqrt(jnp.sum(v * v, axis=0))


def _inverse(matrix: Float[jax.Array, "m m b"]) -> Float[jax.Array, "m m b"]:
    """Inverse of positive definite matrices by Gauss-Jordan elimination in place."""
    size = matrix.shape[0]
    place = jnp.arange(size)

    def step(k: jax.Array, A: jax.Array) -> jax.Array:
        here = place == k
        row, column = jnp.take(A, k, axis=0), jnp.take(A, k, axis=1)
        pivot = jnp.take(row, k, axis=0)
        reduced = jnp.where(here[:, None], 1.0, row) / pivot
        left = jnp.where(here[:, None], 0.0, column)
        kept = jnp.where(here[None, :, None], 0.0, A)
        return jnp.where(here[:, None, None], reduced[None], kept - left[:, None] * reduced[None])

    inverse = jax.lax.fori_loop(0, size, step, matrix)
    return 0.5 * (inverse + transposed(inverse))


def _cofactors(matrix: Float[jax.Array, "3 3 b"]) -> Float[jax.Array, "3 3 b"]:
    a, b, c = matrix
    cross = lambda u, v: jnp.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])  # noqa: E731
    return jnp.stack([cross(b, c), cross(c, a), cross(a, b)])
