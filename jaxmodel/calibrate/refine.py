"""Gauss-Newton on the group from the pairs themselves: the last digits, residuals and information of an estimate.

The unknowns are ``(rotation vector, translation, scale)``: ``R_X <- exp(d) R_X``, ``t_X <- t_X + e``.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.pairs import NO_ROTATION, Pairs, motion_excess
from jaxmodel.geometry.elimination import solve_semidefinite
from jaxmodel.geometry.polar import skew
from jaxmodel.geometry.rigid_fit import rotation_from_quaternion


class Weighting(eqx.Module):
    """Weights of the squared rotation residuals (rad^-2) and translation residuals (length^-2)."""

    rotation: Float[jax.Array, ""]
    translation: Float[jax.Array, ""]


class Linearisation(eqx.Module):
    """Residuals of a set of pairs at an estimate and their derivatives by the seven unknowns."""

    rotation: Float[jax.Array, "n 9"]
    rotation_jacobian: Float[jax.Array, "n 9 7"]
    translation: Float[jax.Array, "n 3"]
    translation_jacobian: Float[jax.Array, "n 3 7"]


def turn(vector: Float[jax.Array, "3"]) -> Float[jax.Array, "3 3"]:
    """A rotation whose vector is ``vector`` to second order, exactly orthonormal: a step on SO(3)."""
    quaternion = jnp.concatenate([jnp.ones(1, vector.dtype), 0.5 * vector])
    return rotation_from_quaternion(quaternion * jax.lax.rsqrt(jnp.sum(quaternion * quaternion)))


def linearise(pairs: Pairs, estimate: Estimate) -> Linearisation:
    """Rotation: ``(R_A - R_X R_B R_X^T) / sqrt 2``, whose norm is the residual's angle to third order (rad).

    Translation: ``(R_A - I) t_X + scale t_A - R_X t_B`` (eq. 3.14), in the unit of t_B, in A's frame.
    """
    n = pairs.weight.shape[0]
    R, a = estimate.R, motion_excess(pairs)
    turned = jnp.einsum("ij,njk,lk->nil", R, pairs.R_B, R)
    basis = skew(jnp.eye(3, dtype=R.dtype))
    change = jnp.einsum("cij,njk->nikc", basis, turned) - jnp.einsum("nij,cjk->nikc", turned, basis)
    root = jnp.sqrt(jnp.asarray(0.5, R.dtype))
    rotation_jacobian = jnp.concatenate([-root * change.reshape(n, 9, 3), jnp.zeros((n, 9, 4), R.dtype)], axis=2)
    moved = pairs.t_B @ R.T
    translation = a @ estimate.t + estimate.scale * pairs.t_A - moved
    translation_jacobian = jnp.concatenate([skew(moved), a, pairs.t_A[:, :, None]], axis=2)
    rotation = root * (pairs.R_A - turned).reshape(n, 9)
    return Linearisation(rotation, rotation_jacobian, translation, translation_jacobian)


def information(
    pairs: Pairs, line: Linearisation, weighting: Weighting
) -> tuple[Float[jax.Array, "7 7"], Float[jax.Array, "7"]]:
    """The normal matrix and the gradient of the weighted cost."""
    w_R, w_t = weighting.rotation * pairs.weight, weighting.translation * pairs.weight
    normal = jnp.einsum("n,nki,nkj->ij", w_R, line.rotation_jacobian, line.rotation_jacobian)
    normal += jnp.einsum("n,nki,nkj->ij", w_t, line.translation_jacobian, line.translation_jacobian)
    gradient = jnp.einsum("n,nki,nk->i", w_R, line.rotation_jacobian, line.rotation)
    gradient += jnp.einsum("n,nki,nk->i", w_t, line.translation_jacobian, line.translation)
    return normal, gradient


def refine(
    pairs: Pairs, estimate: Estimate, weighting: Weighting, unknown_scale: bool = False, steps: int = 2
) -> Estimate:
    """A few Gauss-Newton steps; directions that the pairs say nothing about are left alone."""
    size = 7 if unknown_scale else 6
    total, moved = jnp.sum(pairs.weight), jnp.sum(pairs.weight * jnp.sum(pairs.t_B**2, axis=1))
    turns = weighting.rotation * total + weighting.translation * moved
    shifts = weighting.translation * total
    least = NO_ROTATION * jnp.stack([turns, turns, turns, shifts, shifts, shifts, jnp.zeros_like(turns)])
    for _ in range(steps):
        normal, gradient = information(pairs, linearise(pairs, estimate), weighting)
        step = solve_semidefinite(normal[:size, :size], -gradient[:size], least=least[:size])
        scale = estimate.scale + step[6] if unknown_scale else estimate.scale
        moved = Estimate(turn(step[:3]) @ estimate.R, estimate.t + step[3:6], scale, estimate.steps, estimate.converged)
        estimate = moved
    return estimate


def residuals(pairs: Pairs, estimate: Estimate) -> tuple[Float[jax.Array, " n"], Float[jax.Array, " n"]]:
    """Per pair: the angle between R_A R_X and R_X R_B (rad) and ``|(R_A - I) t_X + scale t_A - R_X t_B|``."""
    line = linearise(pairs, estimate)
    chord = jnp.sqrt(jnp.sum(line.rotation**2, axis=1))  # 2 sin(angle / 2)
    angle = 2 * jnp.arcsin(jnp.clip(0.5 * chord, 0.0, 1.0))
    return angle, jnp.sqrt(jnp.sum(line.translation**2, axis=1))
