"""Inverse kinematics of any serial arm by Levenberg-Marquardt from several starts, all poses and starts at once.

Joint limits enter as residuals that are zero inside, so a solution within them is exact; half of the starts do without
them, only to tell a pose beyond the limits from one out of reach. The small normal equations are solved by elimination.
"""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float
from scipy.stats import qmc

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.elimination import NormalEquations, solve_semidefinite
from jaxmodel.plan.arm import Arm, forward

MAX_STEPS = 100
POLISH = 3  # plain Gauss-Newton steps at the end, which double the digits each
GAIN = 100.0  # of all residuals, so that the solver's first damping (1) is a small one


def joint_starts(arm: Arm, count: int) -> Float[np.ndarray, "s n"]:
    """``count`` postures spread over the limits (a turn, or the arm's size, where infinite), the middle first."""
    reach = np.array([np.pi if kind == "revolute" else arm.size for kind in arm.kinds])
    low = np.where(np.isfinite(arm.limits[:, 0]), arm.limits[:, 0], arm.middle - reach)
    high = np.where(np.isfinite(arm.limits[:, 1]), arm.limits[:, 1], arm.middle + reach)
    spread = qmc.Halton(arm.count, scramble=False).random(count + 1)[1:]
    starts = low + spread * (high - low)
    starts[0] = arm.middle
    return starts


def search_postures(
    arm: Arm,
    T_world_sensor: Float[jax.Array, "4 4"],
    near: Float[jax.Array, " n"],
    starts: Float[AnyArray, "s n"],
    size: Float[AnyArray, ""],
) -> Float[jax.Array, "c n"]:
    """Where Levenberg-Marquardt from ``near`` and from each start ends: first within the limits, then without them.

    ``size``: the length that counts as one radian. Not every end is a solution: check by ``forward``.
    """
    starts = jnp.concatenate([near[None], jnp.asarray(starts)])
    held = jnp.repeat(jnp.array([1.0, 0.0], starts.dtype), len(starts))
    return jax.vmap(lambda start, hold: _descend(arm, T_world_sensor, start, hold, size))(
        jnp.tile(starts, (2, 1)), held
    )


def _descend(arm: Arm, wanted: jax.Array, start: jax.Array, hold: jax.Array, size: AnyArray) -> jax.Array:
    low, high = jnp.asarray(arm.limits).T
    unit = jnp.where(jnp.array([kind == "revolute" for kind in arm.kinds]), 1.0, size)

    def residual(step: jax.Array, _: None) -> jax.Array:
        joints = start + unit * step
        place = forward(arm, joints)
        beyond = jnp.maximum(joints - high, 0.0) + jnp.minimum(joints - low, 0.0)
        return GAIN * jnp.concatenate(
            [
                (place[:3, 3] - wanted[:3, 3]) / size,
                # chords, which unlike a rotation's logarithm are smooth everywhere
                (place[:3, :3] - wanted[:3, :3]).reshape(9) / jnp.sqrt(2.0),
                hold * beyond / unit,
            ]
        )

    solution = optx.least_squares(
        residual,
        optx.LevenbergMarquardt(rtol=1e-6, atol=1e-6, linear_solver=NormalEquations()),
        jnp.zeros_like(start),
        max_steps=MAX_STEPS,
        throw=False,
    )

    def polish(_: jax.Array, step: jax.Array) -> jax.Array:
        # damped by a rounding's worth: at a singularity, or with more joints than needed, the step stays short
        J, r = jax.jacfwd(residual)(step, None), residual(step, None)
        normal = J.T @ J
        lifted = normal + 1e-9 * jnp.trace(normal) * jnp.eye(len(step), dtype=step.dtype)
        return step - solve_semidefinite(lifted, J.T @ r)

    return start + unit * jax.lax.fori_loop(0, POLISH, polish, solution.value)
