"""Turning joints into their limits: angles that differ by whole turns are the same place, but not the same posture."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.plan.arm import Arm

SLACK = 1e-9  # rad, or share of the arm's size: beyond a limit by less is rounding, and is moved onto it
TURN = 2 * np.pi


def within_limits(
    arm: Arm, joints: Float[jax.Array, "*batch n"], near: Float[jax.Array, " n"], size: Float[jax.Array, ""]
) -> tuple[Float[jax.Array, "*batch n"], Bool[jax.Array, "*batch"]]:
    """Joints turned by whole turns into their limits, as close to ``near`` as these allow, and whether all fit.

    A joint that does not fit is turned as close to ``near`` as it gets, and left outside.
    """
    low, high = jnp.asarray(arm.limits).T
    turning = jnp.array([kind == "revolute" for kind in arm.kinds])
    slack = jnp.where(turning, SLACK, SLACK * size)
    fewest, most = jnp.ceil((low - joints - slack) / TURN), jnp.floor((high - joints + slack) / TURN)
    wanted = jnp.round((near - joints) / TURN)
    turns = jnp.where(fewest <= most, jnp.clip(wanted, fewest, most), wanted)
    turned = joints + jnp.where(turning, TURN * turns, 0.0)
    fits = (turned >= low - slack) & (turned <= high + slack)
    return jnp.where(fits, jnp.clip(turned, low, high), turned), jnp.all(fits, axis=-1)


def limit_margin(arm: Arm, joints: Float[jax.Array, "*batch n"]) -> Float[jax.Array, "*batch"]:
    """Of the joint closest to a limit: its distance from it in half ranges, 1 in the middle, 0 at a limit."""
    low, high = jnp.asarray(arm.limits).T
    finite = jnp.isfinite(low) & jnp.isfinite(high)
    half = jnp.where(finite & (high > low), (high - low) / 2, 1.0)
    margin = jnp.minimum(joints - low, high - joints) / half
    # one limit only: no range to measure by; a joint that cannot move has no margin to lose
    return jnp.min(jnp.where(finite & (high > low), margin, jnp.where(finite, 1.0, jnp.minimum(margin, 1.0))), axis=-1)
