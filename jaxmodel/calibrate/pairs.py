"""Pairs of motions (A, B) with AX = XB as the kernels see them, and the sums that the closed forms need of them.

``vec`` stacks rows and the Kronecker product goes with it: ``vec(A X B^T) = (A kron B) vec(X)`` (RR-3507 §3.2.1).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from jaxmodel.geometry.polar import skew

NO_ROTATION = 1e-24  # squared sines below this are rounding of the identity


class Pairs(eqx.Module):
    """Motions of two rigidly linked frames, ``A X = X B``; a weight of zero is a row that is not there."""

    R_A: Float[jax.Array, "n 3 3"]
    t_A: Float[jax.Array, "n 3"]
    R_B: Float[jax.Array, "n 3 3"]
    t_B: Float[jax.Array, "n 3"]
    weight: Float[jax.Array, " n"]


class PairSums(eqx.Module):
    """Everything the closed forms need of a set of pairs, whatever their number.

    ``rotation``: ``sum w S^T S`` with ``S = I - R_A kron R_B`` (eq. 3.13). ``translation``: the quadratic form of
    ``sum w |(R_A - I) t_X + scale t_A - R_X t_B|^2`` in ``(vec R_X, t_X, scale)`` (eqs 3.14, 4.2).
    """

    rotation: Float[jax.Array, "9 9"]
    translation: Float[jax.Array, "13 13"]
    weight: Float[jax.Array, ""]


def make_pairs(
    A: Float[jax.Array, "n 4 4"], B: Float[jax.Array, "n 4 4"], weight: Float[jax.Array, " n"]
) -> tuple[Pairs, Bool[jax.Array, ""]]:
    """Pairs with their unused rows neutral, and whether all used rows are finite (if not, none is used)."""
    used = weight > 0
    finite = jnp.all(jnp.isfinite(A) & jnp.isfinite(B), axis=(1, 2)) & jnp.isfinite(weight)
    sound = jnp.all(finite | ~used) & jnp.all(jnp.isfinite(weight) & (weight >= 0))
    clean = (used & finite & sound)[:, None, None]
    A, B = jnp.where(clean, A, jnp.eye(4, dtype=A.dtype)), jnp.where(clean, B, jnp.eye(4, dtype=B.dtype))
    weight = jnp.where(clean[:, 0, 0], weight, 0.0)
    return Pairs(A[:, :3, :3], A[:, :3, 3], B[:, :3, :3], B[:, :3, 3], weight), sound


def exchanged(pairs: Pairs) -> Pairs:
    """The pairs of the inverse problem ``B Y = Y A``, ``Y = X^-1``."""
    return Pairs(pairs.R_B, pairs.t_B, pairs.R_A, pairs.t_A, pairs.weight)


def quaternions(R: Float[jax.Array, "n 3 3"]) -> Float[jax.Array, "n 4"]:
    """Unit quaternions (w, x, y, z) with w >= 0, sound at every angle and exact to rounding at small ones."""
    m = [[R[:, i, j] for j in range(3)] for i in range(3)]
    trace = m[0][0] + m[1][1] + m[2][2]
    x, y, z = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
    xy, xz, yz = m[0][1] + m[1][0], m[0][2] + m[2][0], m[1][2] + m[2][1]
    # rows of 4 q q^T; the one with the largest diagonal is the best conditioned
    rows = jnp.stack(
        [
            jnp.stack([1 + trace, x, y, z], -1),
            jnp.stack([x, 1 + 2 * m[0][0] - trace, xy, xz], -1),
            jnp.stack([y, xy, 1 + 2 * m[1][1] - trace, yz], -1),
            jnp.stack([z, xz, yz, 1 + 2 * m[2][2] - trace], -1),
        ],
        -2,
    )
    best = jnp.argmax(jnp.diagonal(rows, axis1=-2, axis2=-1), axis=-1)
    q = jnp.take_along_axis(rows, best[:, None, None], axis=-2)[:, 0]
    q = q / jnp.sqrt(jnp.sum(q * q, axis=-1, keepdims=True))
    return jnp.where(q[:, :1] < 0, -q, q)


def rotation_vectors(q: Float[jax.Array, "n 4"]) -> Float[jax.Array, "n 3"]:
    """Rotation vectors (angle times axis, angles in [0, pi]) of unit quaternions with w >= 0."""
    sine = jnp.sqrt(jnp.sum(q[:, 1:] ** 2, axis=-1))
    small = sine < 1e-9
    ratio = 2 * jnp.arctan2(sine, q[:, 0]) / jnp.where(small, 1.0, sine)
    return q[:, 1:] * jnp.where(small, 2.0, ratio)[:, None]


def align_signs(
    q_A: Float[jax.Array, "n 4"], q_B: Float[jax.Array, "n 4"], R_X: Float[jax.Array, "3 3"]
) -> Float[jax.Array, "n 4"]:
    """``q_B`` with the sign that makes ``|a - R_X b|`` smaller: near pi equal scalar signs are not enough."""
    agreement = jnp.sum(q_A[:, 1:] * (q_B[:, 1:] @ R_X.T), axis=-1)
    return jnp.where((agreement < 0)[:, None], -q_B, q_B)


def pair_sums(pairs: Pairs) -> PairSums:
    """The sums of a set of pairs, accumulated so that small motions lose no digits.

    With ``R_A = I + a`` and ``R_B = I + b``, ``S^T S = -(a + a^T) kron I - I kron (b + b^T) - (a kron b + its
    transpose)``; a, b and their symmetric parts come from the unit quaternions, so that each is exact to rounding.
    """
    w = pairs.weight
    q_A, q_B = quaternions(pairs.R_A), quaternions(pairs.R_B)
    a, sym_a = _excess(q_A)
    b, sym_b = _excess(q_B)
    n = w.shape[0]
    K = jnp.matmul((w[:, None] * a.reshape(n, 9)).T, b.reshape(n, 9), precision=jax.lax.Precision.HIGHEST)
    K = K.reshape(3, 3, 3, 3).transpose(0, 2, 1, 3).reshape(9, 9)  # sum w (a kron b)
    G, H = jnp.tensordot(w, sym_a, 1), jnp.tensordot(w, sym_b, 1)
    eye = jnp.eye(3, dtype=w.dtype)
    rotation = jnp.kron(G, eye) + jnp.kron(eye, H) - K - K.T
    # rows of the translation equation: -R t_B + a t_X + scale t_A, in (vec R_X, t_X, scale)
    left = -jnp.einsum("ki,nj->nkij", eye, pairs.t_B).reshape(n, 3, 9)
    rows = jnp.concatenate([left, a, pairs.t_A[:, :, None]], axis=2).reshape(3 * n, 13)
    weighted = rows * jnp.repeat(w, 3)[:, None]
    translation = jnp.matmul(weighted.T, rows, precision=jax.lax.Precision.HIGHEST)
    return PairSums(rotation, translation, jnp.sum(w))


def _excess(q: Float[jax.Array, "n 4"]) -> tuple[Float[jax.Array, "n 3 3"], Float[jax.Array, "n 3 3"]]:
    """``R - I`` and ``(R - I)^T (R - I)``, both exact to rounding however small the angle."""
    v = q[:, 1:]
    V = skew(v)
    square = jnp.einsum("nij,njk->nik", V, V)
    return 2 * q[:, :1, None] * V + 2 * square, -4 * square


def motion_excess(pairs: Pairs) -> Float[jax.Array, "n 3 3"]:
    """``R_A - I`` of each pair, exact to rounding."""
    return _excess(quaternions(pairs.R_A))[0]
