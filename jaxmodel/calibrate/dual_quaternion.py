"""Daniilidis's unit dual quaternions (RR-3507 §2.2.2): rotation and translation at once, from the screws' axes.

Its equations weigh rotation and translation by the unit of length: here that is the root mean square of the motions'
own translations, so that metres and millimetres give one answer. At small rotations it loses digits: two exact motions
of 1e-4 rad are its limit. Signs are those of the linear solution: equal scalar parts are not enough near pi (ERRATA).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import linear_rotation, linear_translation
from jaxmodel.calibrate.pairs import Pairs, align_signs, pair_sums, quaternions
from jaxmodel.geometry.eigen import largest_eigenvector
from jaxmodel.geometry.elimination import inverse_positive
from jaxmodel.geometry.polar import skew
from jaxmodel.geometry.rigid_fit import rotation_from_quaternion


def solve_dual_quaternion(pairs: Pairs, unknown_scale: bool = False) -> Estimate:
    """The unit dual quaternion in the plane of the two smallest singular vectors of T (eqs 2.4 - 2.6).

    An unknown scale is that of eq. 4.3; the method itself has no place for one.
    """
    sums = pair_sums(pairs)
    R_linear = linear_rotation(sums)
    scale = linear_translation(sums, R_linear, unknown_scale).scale
    t_A, t_B = scale * pairs.t_A, pairs.t_B
    squares = jnp.sum(pairs.weight * jnp.sum(t_A**2 + t_B**2, axis=1))
    length = jnp.where(squares > 0, jnp.sqrt(squares / (2 * jnp.where(squares > 0, sums.weight, 1.0))), 1.0)
    q_A = quaternions(pairs.R_A)
    q_B = align_signs(q_A, quaternions(pairs.R_B), R_linear)
    top = _rows(q_A, q_B)
    bottom = _rows(_dual_part(q_A, t_A / length), _dual_part(q_B, t_B / length))
    T = jnp.concatenate([jnp.concatenate([top, jnp.zeros_like(top)], 2), jnp.concatenate([bottom, top], 2)], 1)
    T = (T * jnp.sqrt(pairs.weight)[:, None, None]).reshape(-1, 8)
    v_7, v_8 = _null_plane(T)
    q, dual = _unit_dual_quaternion(v_7, v_8)
    t = 2 * (q[0] * dual[1:] - dual[0] * q[1:] + jnp.cross(q[1:], dual[1:]))  # vector part of 2 q' q*
    return Estimate(rotation_from_quaternion(q), length * t, scale)


def _rows(a: Float[jax.Array, "n 4"], b: Float[jax.Array, "n 4"]) -> Float[jax.Array, "n 3 4"]:
    return jnp.concatenate([(a - b)[:, 1:, None], skew(a[:, 1:] + b[:, 1:])], axis=2)


def _dual_part(q: Float[jax.Array, "n 4"], t: Float[jax.Array, "n 3"]) -> Float[jax.Array, "n 4"]:
    """``q' = t q / 2`` of the motion (q, t); its scalar part is not used."""
    scalar = -jnp.sum(t * q[:, 1:], axis=1, keepdims=True)
    vector = q[:, :1] * t + jnp.cross(t, q[:, 1:])
    return 0.5 * jnp.concatenate([scalar, vector], axis=1)


def _null_plane(T: Float[jax.Array, "m 8"]) -> tuple[Float[jax.Array, "8"], Float[jax.Array, "8"]]:
    """An orthonormal basis of the plane of the two smallest singular vectors.

    Small rotations leave the columns of the dual part small, and the condition number would be that of their square:
    the inverse of ``T^T T`` is taken with both halves of the columns brought to one size.
    """
    halves = jnp.stack([jnp.sqrt(jnp.sum(T[:, :4] ** 2)), jnp.sqrt(jnp.sum(T[:, 4:] ** 2))])
    scale = jnp.repeat(1 / jnp.where(halves > 0, halves, 1.0), 4)
    even = T * scale
    normal = jnp.matmul(even.T, even, precision=jax.lax.Precision.HIGHEST)
    inverse = inverse_positive(normal + 1e-15 * jnp.eye(8, dtype=T.dtype)) * scale[:, None] * scale[None, :]
    v_8, _ = largest_eigenvector(inverse)
    v_7, _ = largest_eigenvector(inverse - (v_8 @ inverse @ v_8) * jnp.outer(v_8, v_8))
    basis = _orthonormal(jnp.stack([v_8, v_7], axis=1))
    # residuals taken row by row give back the digits that the normal matrix squared away
    for _ in range(4):
        step = inverse @ (T.T @ (T @ basis))
        basis = _orthonormal(basis - (step - basis @ (basis.T @ step)))
    return basis[:, 1], basis[:, 0]


def _orthonormal(basis: Float[jax.Array, "8 2"]) -> Float[jax.Array, "8 2"]:
    u = basis[:, 0] / jnp.sqrt(jnp.sum(basis[:, 0] ** 2))
    v = basis[:, 1] - (basis[:, 1] @ u) * u
    return jnp.stack([u, v / jnp.sqrt(jnp.sum(v * v))], axis=1)


def _unit_dual_quaternion(
    v_7: Float[jax.Array, "8"], v_8: Float[jax.Array, "8"]
) -> tuple[Float[jax.Array, "4"], Float[jax.Array, "4"]]:
    """The ``cos f v_7 + sin f v_8`` that eq. 2.6 allows, scaled to a unit quaternion (eq. 2.5).

    Eq. 2.6 is ``a cos^2 + b cos sin + c sin^2 = 0``: two directions f, of which the one with the longer quaternion is
    taken (the other is near zero length: it is the pure dual null vector). Where noise leaves no real root, the f that
    comes nearest to eq. 2.6.
    """
    a = v_7[:4] @ v_7[4:]
    b = v_7[:4] @ v_8[4:] + v_8[:4] @ v_7[4:]
    c = v_8[:4] @ v_8[4:]
    # (a + c) / 2 + (a - c) / 2 cos 2f + b / 2 sin 2f = 0
    middle, phase = jnp.arctan2(b, a - c), jnp.sqrt((a - c) ** 2 + b**2)
    half = jnp.arccos(jnp.clip(-(a + c) / jnp.where(phase > 0, phase, 1.0), -1.0, 1.0))
    angles = 0.5 * jnp.stack([middle + half, middle - half])
    z = jnp.cos(angles)[:, None] * v_7 + jnp.sin(angles)[:, None] * v_8
    length = jnp.sum(z[:, :4] ** 2, axis=1)
    best = z[jnp.argmax(length)] * jax.lax.rsqrt(jnp.maximum(jnp.max(length), jnp.finfo(z.dtype).tiny))
    return best[:4], best[4:]
