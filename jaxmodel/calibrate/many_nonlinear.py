"""Nonlinear least squares for very many sets of poses: the problem of ``solve_nonlinear``, batch last.

Both sums of squares are quadratic forms of ``(vec R, t, 1)`` (``pose_sums.py``), so neither a step nor the residual
sums that the weights come from pass over the pairs, or even over the poses. Levenberg-Marquardt with a damping for each
set; a 6 x 6 system by elimination.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxmodel.calibrate.pose_sums import RotationForm, TranslationForm, with_spread
from jaxmodel.geometry import batch_last as batch

ROUNDS = 4  # descents, each with the weights of the one before: as ``solve_nonlinear``
MOST_STEPS = 30
TOLERANCE = 1e-8  # of a step (rad, relative length): what is left after it is a hundredth of it or less
ROUNDING = 1e-18  # variances of exact data, as ``solve_nonlinear`` takes them
LEAST_DAMPING, FIRST_DAMPING = 1e-12, 1e-6


class _Weights(NamedTuple):
    rotation: Float[jax.Array, " b"]
    translation: Float[jax.Array, " b"]


class _Descent(NamedTuple):
    """Where each set is, its cost and damping, and the sets that still move."""

    step: Int[jax.Array, ""]
    R: Float[jax.Array, "3 3 b"]
    t: Float[jax.Array, "3 b"]
    cost: Float[jax.Array, " b"]
    damping: Float[jax.Array, " b"]
    moving: Bool[jax.Array, " b"]


def nonlinear(
    rotation: RotationForm,
    translation: TranslationForm,
    R: Float[jax.Array, "3 3 b"],
    t: Float[jax.Array, "3 b"],
    poses: Float[jax.Array, " b"],
) -> tuple[Float[jax.Array, "3 3 b"], Float[jax.Array, "3 b"]]:
    """R and t of least weighted cost from a start; ``poses`` is how many each set has.

    The weights are 1 / variance of one component of the residuals of rotation and translation, anew in each round.
    """
    # over unit weights of all ordered pairs: residual sum = poses^2 x mean, with 3 unknowns less than components
    freedom = (3 * poses * (poses - 1) - 3) / poses**2

    def round_(_: jax.Array, at: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        turns, shifts = _squares(rotation, translation, *at)
        reach = jnp.sum(at[1] ** 2, axis=0) + jnp.trace(translation.spread) + translation.square[3, 3]
        weights = _Weights(
            1 / (jnp.maximum(turns, 0.0) / freedom + ROUNDING),
            1 / (jnp.maximum(shifts, 0.0) / freedom + ROUNDING * jnp.where(reach > 0, reach, 1.0)),
        )
        return _descend(rotation, translation, weights, jnp.sqrt(reach), *at)

    return jax.lax.fori_loop(0, ROUNDS, round_, (R, t))


def _squares(
    rotation: RotationForm, translation: TranslationForm, R: Float[jax.Array, "3 3 b"], t: Float[jax.Array, "3 b"]
) -> tuple[Float[jax.Array, " b"], Float[jax.Array, " b"]]:
    """The means of squared residuals: rotation (rad^2, chords) and translation."""
    r, s = R.reshape(9, -1), jnp.concatenate([t, jnp.ones_like(t[:1])])
    turns = jnp.sum(r * batch.apply(rotation.square, r), axis=0)
    moved = batch.matmul(R, translation.spread).reshape(9, -1) + 2 * batch.apply(translation.across, s)
    return turns, jnp.sum(r * moved, axis=0) + jnp.sum(s * batch.apply(translation.square, s), axis=0)


def _descend(
    rotation: RotationForm,
    translation: TranslationForm,
    weights: _Weights,
    reach: Float[jax.Array, " b"],
    R: Float[jax.Array, "3 3 b"],
    t: Float[jax.Array, "3 b"],
) -> tuple[Float[jax.Array, "3 3 b"], Float[jax.Array, "3 b"]]:
    whole = weights.rotation * rotation.square + weights.translation * with_spread(translation.spread)
    across, own = weights.translation * translation.across, weights.translation * translation.square
    # a cost is known to rounding of its terms only
    blur = 1e-14 * (jnp.trace(whole) + own[3, 3])

    def cost_at(R: jax.Array, t: jax.Array) -> jax.Array:
        turns, shifts = _squares(rotation, translation, R, t)
        return weights.rotation * turns + weights.translation * shifts

    def again(state: _Descent) -> _Descent:
        r, s = state.R.reshape(9, -1), jnp.concatenate([state.t, jnp.ones_like(state.t[:1])])
        D = _turned(state.R)
        slope = batch.apply(whole, r) + batch.apply(across, s)
        pull = batch.apply(batch.transposed(across[:, :3]), r) + batch.apply(own[:3], s)
        gradient = jnp.concatenate([batch.apply(batch.transposed(D), slope), pull])
        turns = batch.matmul(batch.transposed(D), batch.matmul(whole, D))
        both = batch.matmul(batch.transposed(D), across[:, :3])
        normal = jnp.concatenate(
            [
                jnp.concatenate([turns, both], axis=1),
                jnp.concatenate([batch.transposed(both), own[:3, :3]], axis=1),
            ]
        )
        damped = normal * (1 + state.damping * jnp.eye(6, dtype=r.dtype)[:, :, None])
        step = -batch.solve_positive(damped, gradient, 0.0)
        next_R, next_t = batch.matmul(_turn(step[:3]), state.R), state.t + step[3:]
        cost = cost_at(next_R, next_t)
        better = cost <= state.cost + blur
        length = jnp.max(jnp.abs(step) / jnp.stack([jnp.ones_like(reach)] * 3 + [reach] * 3), axis=0)
        return _Descent(
            state.step + 1,
            jnp.where(better, next_R, state.R),
            jnp.where(better, next_t, state.t),
            jnp.where(better, cost, state.cost),
            jnp.where(better, jnp.maximum(state.damping / 10, LEAST_DAMPING), state.damping * 100),
            state.moving & (length > TOLERANCE),
        )

    def unfinished(state: _Descent) -> jax.Array:
        return (state.step < MOST_STEPS) & jnp.any(state.moving)

    cost = cost_at(R, t)
    start = _Descent(jnp.zeros((), jnp.int32), R, t, cost, jnp.full_like(cost, FIRST_DAMPING), jnp.isfinite(cost))
    end = jax.lax.while_loop(unfinished, again, start)
    return end.R, end.t


def _turned(R: Float[jax.Array, "3 3 b"]) -> Float[jax.Array, "9 3 b"]:
    """The derivative of ``vec(exp(d) R)`` by the rotation vector d: rows of ``e_a x R``."""
    zero = jnp.zeros_like(R[0])
    columns = (jnp.stack([zero, -R[2], R[1]]), jnp.stack([R[2], zero, -R[0]]), jnp.stack([-R[1], R[0], zero]))
    return jnp.stack([column.reshape(9, -1) for column in columns], axis=1)


def _turn(vector: Float[jax.Array, "3 b"]) -> Float[jax.Array, "3 3 b"]:
    """A rotation whose vector is ``vector`` to second order: a step on SO(3)."""
    q = jnp.concatenate([jnp.ones_like(vector[:1]), 0.5 * vector])
    return batch.rotation(q * jax.lax.rsqrt(jnp.sum(q * q, axis=0)))
