"""Nonlinear least squares for AX = XB by Levenberg-Marquardt (RR-3507 §2.2.3; Horaud and Dornaika 1995).

Both costs are quadratic forms in ``(vec R_X, t_X, scale)``, so that all pairs together are a few residuals. Prefer
``solve_nonlinear`` where motions are independent measurements (from absolute poses: ``joint``); the quaternion form
with its penalty and its two free weights is here as published.
"""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import solve_linear
from jaxmodel.calibrate.pairs import Pairs, PairSums, align_signs, exchanged, pair_sums, quaternions
from jaxmodel.calibrate.refine import Weighting, linearise, refine, turn
from jaxmodel.geometry.elimination import NormalEquations, square_root
from jaxmodel.geometry.polar import skew
from jaxmodel.geometry.rigid_fit import rotation_from_quaternion

Stream = Literal["A", "B"]
MAX_STEPS = 60
TINY = 1e-100  # a scale below it was not determined: its inverse would be no number
TOLERANCE = 1e-7  # of a step (rad, relative length) and of the cost; the last digits come afterwards


class _Problem(eqx.Module):
    """A start, the square roots of the two quadratic forms, and the length that the translation's tangent counts in."""

    start: Estimate
    rotation: Float[jax.Array, "9 9"]
    translation: Float[jax.Array, "13 13"]
    length: Float[jax.Array, ""]

    def moved(self, tangent: Float[jax.Array, " k"]) -> Estimate:
        scale = self.start.scale + tangent[6] if tangent.shape[0] == 7 else self.start.scale
        return Estimate(turn(tangent[:3]) @ self.start.R, self.start.t + self.length * tangent[3:6], scale)

    def residual(self, tangent: Float[jax.Array, " k"]) -> Float[jax.Array, "22"]:
        point = self.moved(tangent)
        r = point.R.reshape(9)
        z = jnp.concatenate([r, point.t, point.scale[None]])
        return jnp.concatenate([self.rotation @ r, self.translation @ z])


def descend(sums: PairSums, start: Estimate, weighting: Weighting, unknown_scale: bool = False) -> Estimate:
    """Levenberg-Marquardt on the group from ``start``, all pairs at once through their sums."""
    # the motions' own length, so that neither damping nor stopping depends on the unit
    squares = jnp.trace(sums.translation[:9, :9]) / 3 + start.scale**2 * sums.translation[12, 12]
    length = jnp.where(squares > 0, jnp.sqrt(squares / jnp.where(squares > 0, sums.weight, 1.0)), 1.0)
    lengths = squares + length**2 * jnp.trace(sums.translation[9:12, 9:12])
    # a curvature of 1e4 whatever the weights, so that the solver's first damping (1) is a small one
    curvature = weighting.rotation * jnp.trace(sums.rotation) + weighting.translation * lengths
    unit = 1e4 / jnp.where(curvature > 0, curvature, 1.0)
    problem = _Problem(
        start,
        jnp.sqrt(0.5 * unit * weighting.rotation) * square_root(sums.rotation),
        jnp.sqrt(unit * weighting.translation) * square_root(sums.translation),
        length,
    )
    solution = optx.least_squares(
        lambda tangent, p: p.residual(tangent),
        optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE, linear_solver=NormalEquations()),
        jnp.zeros(7 if unknown_scale else 6, start.t.dtype),
        args=problem,
        max_steps=MAX_STEPS,
        throw=False,
    )
    found = problem.moved(solution.value)
    steps = start.steps + solution.stats["num_steps"].astype(jnp.int32)
    return Estimate(found.R, found.t, found.scale, steps, solution.result == optx.RESULTS.successful)


def solve_nonlinear(
    pairs: Pairs, unknown_scale: bool = False, noise_in: Stream = "A", weighting: Weighting | None = None
) -> Estimate:
    """Maximum likelihood for independent motions of which one stream carries the noise, started from ``linear``.

    With noise in A, A is predicted as ``X B X^-1`` and its rotation and translation errors stay independent; with
    noise in B the roles are exchanged (RR-3507's own cost, group instead of penalty). Without ``weighting`` the
    variances of rotation and translation are estimated from the residuals, three times over.
    """
    start = solve_linear(pairs, unknown_scale)
    if noise_in == "A":
        return inverted(_reweighted(exchanged(pairs), inverted(start), unknown_scale, weighting))
    return _reweighted(pairs, start, unknown_scale, weighting)


def _reweighted(pairs: Pairs, start: Estimate, unknown_scale: bool, weighting: Weighting | None) -> Estimate:
    sums = pair_sums(pairs)

    def weights_at(estimate: Estimate) -> Weighting:
        return variance_components(pairs, estimate) if weighting is None else weighting

    def once(_: jax.Array, estimate: Estimate) -> Estimate:
        return descend(sums, estimate, weights_at(estimate), unknown_scale)

    estimate = jax.lax.fori_loop(0, 3 if weighting is None else 1, once, start)
    # the quadratic form squares the condition number; residuals pair by pair give the last digits back
    return refine(pairs, estimate, weights_at(estimate), unknown_scale)


def variance_components(pairs: Pairs, estimate: Estimate) -> Weighting:
    """Weights 1 / variance of one component of the rotation and of the translation residuals at an estimate.

    The rotation residuals are chords, as in the cost: their sum of squares is a quadratic form, too.
    """
    line = linearise(pairs, estimate)
    count = jnp.maximum(3 * jnp.sum(pairs.weight > 0) - 3, 1)
    reach = jnp.sum(estimate.t**2) + jnp.max(jnp.sum(pairs.t_B**2 + (estimate.scale * pairs.t_A) ** 2, axis=1))
    rounding = 1e-18  # exact data: weights stay within what the stopping rule can resolve
    rotation = jnp.sum(pairs.weight * jnp.sum(line.rotation**2, axis=1)) / count + rounding
    translation = jnp.sum(pairs.weight * jnp.sum(line.translation**2, axis=1)) / count + rounding * reach
    return Weighting(1.0 / rotation, 1.0 / jnp.where(translation > 0, translation, 1.0))


def inverted(estimate: Estimate) -> Estimate:
    """The estimate of the exchanged problem ``B Y = Y A``: Y is ``X^-1`` in the unit of A, its scale is on B."""
    R = estimate.R.T
    scale = 1.0 / jnp.where(jnp.abs(estimate.scale) > TINY, estimate.scale, 1.0)
    return Estimate(R, -scale * (R @ estimate.t), scale, estimate.steps, estimate.converged)


class QuaternionWeights(eqx.Module):
    """``axes`` and ``translations`` are lambda_1 and lambda_2 of §2.2.3, ``penalty`` is lambda."""

    axes: Float[jax.Array, ""] | float = 1.0
    translations: Float[jax.Array, ""] | float = 1.0
    penalty: Float[jax.Array, ""] | float = 2e6


def solve_quaternion_penalty(pairs: Pairs, weights: QuaternionWeights, start: Estimate | None = None) -> Estimate:
    """§2.2.3 as published: axes and translations under a quaternion that a penalty keeps near unit length.

    ``sum l1 |n_A - q n_B q*|^2 + l2 |q t_B q* - (R_A - I) t - t_A|^2 + l (1 - q q)^2`` over (q, t), with unit axes. The
    start is the linear solution, or the one given; the report does not say which weights it used.
    """
    first = solve_linear(pairs)
    start = first if start is None else start
    q_A = quaternions(pairs.R_A)
    q_B = align_signs(q_A, quaternions(pairs.R_B), first.R)
    n_A, n_B = _unit(q_A[:, 1:]), _unit(q_B[:, 1:])
    n = n_A.shape[0]
    # rows of n_A - Q n_B in (vec Q, 1), Q the homogeneous matrix of the quaternion
    left = -jnp.einsum("ki,nj->nkij", jnp.eye(3, dtype=n_A.dtype), n_B).reshape(3 * n, 9)
    rows = jnp.concatenate([left, n_A.reshape(3 * n, 1)], axis=1)
    axes = square_root((rows * jnp.repeat(pairs.weight, 3)[:, None]).T @ rows)
    translations = square_root(pair_sums(pairs).translation)

    def residual(y: jax.Array, _: None) -> jax.Array:
        q, t = y[:4], y[4:]
        Q = _homogeneous(q).reshape(9)
        one = jnp.ones(1, q.dtype)
        return jnp.concatenate(
            [
                jnp.sqrt(weights.axes) * (axes @ jnp.concatenate([Q, one])),
                jnp.sqrt(weights.translations) * (translations @ jnp.concatenate([Q, t, one])),
                jnp.sqrt(weights.penalty) * (1 - q @ q)[None],
            ]
        )

    solution = optx.least_squares(
        residual,
        optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE, linear_solver=NormalEquations()),
        jnp.concatenate([quaternions(start.R[None])[0], start.t]),
        max_steps=MAX_STEPS * 4,
        throw=False,
    )
    q = solution.value[:4]
    R = rotation_from_quaternion(q / jnp.sqrt(q @ q))
    steps = solution.stats["num_steps"].astype(jnp.int32)
    return Estimate(R, solution.value[4:], first.scale, steps, solution.result == optx.RESULTS.successful)


def _homogeneous(q: Float[jax.Array, "4"]) -> Float[jax.Array, "3 3"]:
    """``q v q*`` as a matrix, for a quaternion of any length."""
    w, v = q[0], q[1:]
    return (w * w - v @ v) * jnp.eye(3, dtype=q.dtype) + 2 * jnp.outer(v, v) + 2 * w * skew(v)


def _unit(vectors: Float[jax.Array, "n 3"]) -> Float[jax.Array, "n 3"]:
    length = jnp.sqrt(jnp.sum(vectors**2, axis=1, keepdims=True))
    return vectors / jnp.where(length > 0, length, 1.0)
