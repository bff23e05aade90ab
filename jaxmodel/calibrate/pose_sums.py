"""Sums over all pairs of a set of poses, at the cost of sums over the poses; the batch is the last axis.

With ``a_i`` one stream's and ``b_i`` the other's motion from a reference pose to pose i, the motions between any two
are ``A_ij = a_j a_i^-1`` and ``B_ij = b_j b_i^-1``. For ``A Z = Z B``, Z = (R, t), write ``N_i = R_a^T R R_b``: then
``R_A R - R R_B = R_a,j (N_i - N_j) R_b,i^T``, and the translation's residual has the length of
``p_i - p_j - N_j (c_i - c_j)`` with ``p = R_a^T (t - t_a)`` and ``c = -R_b^T t_b``. Both sums of squares factor. Each
pair counts in both directions, so the order of the poses does not matter.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.geometry import batch_last as batch


class Motions(NamedTuple):
    """Motions from the reference pose to each pose: unit quaternion and translation."""

    q: Float[jax.Array, "4 n b"]
    t: Float[jax.Array, "3 n b"]


class RotationForm(NamedTuple):
    """``r^T square r`` is the weighted mean over all pairs of ``|R_A R - R R_B|^2 / 2``, r = vec R (eq. 3.13).

    ``mean`` M is that of ``R_a kron R_b``: vec of the mean N is ``M^T r``.
    """

    square: Float[jax.Array, "9 9 b"]
    mean: Float[jax.Array, "9 9 b"]

    def exchanged(self) -> "RotationForm":
        """The form of the inverse problem ``B Y = Y A``, in vec R^T."""
        return RotationForm(*(a.reshape(3, 3, 3, 3, -1).transpose(1, 0, 3, 2, 4).reshape(9, 9, -1) for a in self))


class TranslationForm(NamedTuple):
    """The weighted mean over all pairs of ``|(R_A - I) t + t_A - R t_B|^2`` (eq. 3.14) in r = vec R and s = (t, 1).

    ``sum_k R_k spread R_k^T + 2 r^T across s + s^T square s`` with the rows R_k of R, which need be no rotation.
    """

    spread: Float[jax.Array, "3 3 b"]
    across: Float[jax.Array, "9 4 b"]
    square: Float[jax.Array, "4 4 b"]


def motions(T: Float[jax.Array, "3 4 n b"], inverted: bool) -> Motions:
    """Poses, or their inverses, as motions."""
    q, t = batch.quaternion(T[:, :3]), T[:, 3]
    if not inverted:
        return Motions(q, t)
    return Motions(batch.conjugate(q), -batch.apply(batch.transposed(T[:, :3]), t))


def from_first(poses: Motions, w: Float[jax.Array, "n b"]) -> Motions:
    """``T_i T_r^-1``, r the first pose that is there: small motions keep their digits."""
    place = jnp.arange(len(w))[:, None]
    here = place == jnp.argmax(w > 0, axis=0)
    q_r, t_r = (jnp.sum(jnp.where(here, a, 0.0), axis=1)[:, None] for a in poses)
    q = batch.quaternion_product(poses.q, batch.conjugate(q_r))
    return Motions(q, poses.t - batch.apply(batch.rotation(q), t_r))


def mean(values: Float[jax.Array, "... n b"], w: Float[jax.Array, "n b"]) -> Float[jax.Array, "... b"]:
    """Weighted mean over the poses, for weights whose sum is 1."""
    return jnp.sum(w * values, axis=-2)


def rotation_form(a: Motions, b: Motions, w: Float[jax.Array, "n b"]) -> RotationForm:
    """The sums of eq. 3.13.

    Half the mean of ``S^T S`` is ``I - M M^T``; with ``M = I + E`` that is ``-(E + E^T) - E E^T``, which loses no
    digits to the identity.
    """
    x, sym_x = batch.rotation_excess(a.q)
    y, sym_y = batch.rotation_excess(b.q)
    eye = jnp.eye(3, dtype=w.dtype)[:, :, None]
    K = batch.sum_of_krons(w * x, y)
    E = batch.kron(mean(x, w), eye) + batch.kron(eye, mean(y, w)) + K
    symmetric = batch.kron(mean(sym_x, w), eye) + batch.kron(eye, mean(sym_y, w)) + K + batch.transposed(K)
    square = -symmetric - batch.matmul(E, batch.transposed(E))
    return RotationForm(square, E + jnp.eye(9, dtype=w.dtype)[:, :, None])


def translation_form(
    a: Motions, b: Motions, w: Float[jax.Array, "n b"], M: Float[jax.Array, "9 9 b"]
) -> TranslationForm:
    """The sums of eq. 3.14: with means taken off p and c, and ``p = D s`` for ``D = [R_a^T - I, -R_a^T t_a]``,

    ``sum w |p_i - p_j - N_j (c_i - c_j)|^2`` over all pairs is ``2 sum w |p|^2 + tr R V R^T - 2 <R, Phi(s)>``, where
    V is the mean of ``R_b (cov c + c c^T) R_b^T`` and Phi that of ``R_a (cov p c + p c^T) R_b^T``.
    """
    excess = batch.transposed(batch.rotation_excess(a.q)[0])
    P = excess + jnp.eye(3, dtype=w.dtype)[:, :, None, None]
    U = batch.rotation(b.q)
    x, c = -batch.apply(P, a.t), -batch.apply(batch.transposed(U), b.t)
    D = jnp.concatenate([excess, x[:, None]], axis=1)
    D, c = D - mean(D, w)[:, :, None], c - mean(c, w)[:, None]
    turned, weighted = batch.apply(U, c), w * c
    covariance = batch.sum_of_products(D, weighted)  # (3, 4, 3)
    own = batch.sum_of_products(batch.matmul(batch.transposed(P), D), w * turned)
    Phi = batch.matmul(M, _s_last(covariance)) + _s_last(own)
    each = batch.matmul(batch.matmul(U, batch.sum_of_products(weighted, c)[:, :, None]), batch.transposed(U))
    spread = mean(each, w) + batch.sum_of_products(w * turned, turned)
    return TranslationForm(spread, -Phi, 2 * batch.sum_of_squares(D, w))


def _s_last(sums: Float[jax.Array, "3 4 3 b"]) -> Float[jax.Array, "9 4 b"]:
    return jnp.swapaxes(sums, 1, 2).reshape(9, 4, -1)


def with_spread(spread: Float[jax.Array, "3 3 b"]) -> Float[jax.Array, "9 9 b"]:
    """``I kron V``: the square of the translation's form in vec R."""
    return batch.kron(jnp.eye(3, dtype=spread.dtype)[:, :, None], spread)
