"""Registration of 2D laser profiles: ICP in the plane as a kernel of the lane engine, one item a pair (thesis §5.2).

Each point of the source is paired with the nearest of the target's, as in the thesis, and pulled onto the line there
(Censi 2008), which lets profiles slide along walls as they must. What odometry said holds a motion that the profiles
do not tell, along a corridor, and no other: it enters as the prior that it is. The guess comes from odometry alone.
"""

from enum import IntEnum
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.elimination import solve_positive
from jaxmodel.lanes import Kernel

ALIKE = 0.7
"""Least cosine between the normals of partners."""
SOFT = 2.0
"""Scatters at which a pair's weight has fallen to a quarter."""
STILL = 1e-3
"""A step that moves by less, metre and radian added, ends the registration: less than any laser of this kind tells."""
LEAST_SCATTER = 0.01
"""Metre, of the distances to lines: no laser of this kind is better."""


class ProfileOutcome(IntEnum):
    """How the registration of a pair of profiles ended. All but the first keep the odometry."""

    CONVERGED = 0
    STEP_LIMIT = 1
    TOO_FEW_PAIRS = 2
    TOO_FAR = 3

    @property
    def sentence(self) -> str:
        """What the outcome means."""
        return {
            ProfileOutcome.CONVERGED: "the steps have died down near what odometry said",
            ProfileOutcome.STEP_LIMIT: "the step limit was reached before the steps had died down: odometry is kept",
            ProfileOutcome.TOO_FEW_PAIRS: "too few points have a partner: odometry is kept",
            ProfileOutcome.TOO_FAR: "the result is further from odometry than odometry errs: odometry is kept",
        }[self]


class ProfileOptions(eqx.Module):
    """Lengths in metre, angles in radian.

    ``reach``, ``last_reach``: how far partners may be at first and at last, ``shrink`` from step to step;
    ``odometry_turn``, ``odometry_shift``: standard deviations of one step of odometry, ``odometry_growth`` of its
    shift; ``most``: of these deviations that a result may be off; ``fewest``: share of the points that must have a
    partner.
    """

    reach: float = 1.0
    last_reach: float = 0.15
    shrink: float = 0.85
    steps: int = 40
    fewest: float = 0.3
    odometry_turn: float = 0.05
    odometry_shift: float = 0.05
    odometry_growth: float = 0.1
    most: float = 5.0


class ProfilePair(NamedTuple):
    """An item: the target's points and normals, the source's points and normals, and odometry's guess of the source's
    pose in the target's frame. Structure of arrays, padded; masks say what counts.
    """

    target: Float[AnyArray, "*b 2 m"]
    target_normals: Float[AnyArray, "*b 2 m"]
    target_mask: Bool[AnyArray, "*b m"]
    source: Float[AnyArray, "*b 2 n"]
    source_normals: Float[AnyArray, "*b 2 n"]
    source_mask: Bool[AnyArray, "*b n"]
    guess: Float[AnyArray, "*b 3"]


class ProfileFit(NamedTuple):
    """``pose`` of the source in the target's frame, also where it is not to be believed; ``information (3, 3)`` of
    (x, y, angle), the profiles' own without odometry's, every pair by its weight over the square of the scatter;
    ``error`` mean distance to lines of the pairs kept, metre; ``matched`` share of the source's points.
    """

    pose: Float[AnyArray, "*b 3"]
    information: Float[AnyArray, "*b 3 3"]
    error: Float[AnyArray, "*b"]
    matched: Float[AnyArray, "*b"]
    steps: Int[AnyArray, "*b"]
    outcome: Int[AnyArray, "*b"]


class _State(NamedTuple):
    item: ProfilePair
    pose: Float[jax.Array, "3"]
    reach: Float[jax.Array, ""]
    information: Float[jax.Array, "3 3"]
    error: Float[jax.Array, ""]
    matched: Float[jax.Array, ""]
    steps: Int[jax.Array, ""]
    still: Bool[jax.Array, ""]


class ProfileIcp(Kernel):
    """ICP of profiles; an item is a ``ProfilePair``."""

    options: ProfileOptions

    def init(self, item: ProfilePair) -> _State:
        zero = jnp.float32(0)
        reach = jnp.asarray(self.options.reach, jnp.float32)
        return _State(
            item,
            jnp.asarray(item.guess),
            reach,
            jnp.zeros((3, 3), jnp.float32),
            zero,
            zero,
            jnp.int32(0),
            jnp.array(False),
        )

    def done(self, state: _State) -> Bool[jax.Array, ""]:
        return state.still | (state.steps >= self.options.steps)

    def step(self, state: _State) -> _State:
        information, right, error, matched = self._equations(state)
        prior = self._prior(state.item)
        off = state.pose - state.item.guess
        solution, _ = solve_positive(information + jnp.diag(prior), right - prior * off)
        last = state.reach <= self.options.last_reach
        moved = jnp.abs(solution[0]) + jnp.abs(solution[1]) + jnp.abs(solution[2])
        return _State(
            state.item,
            state.pose + solution,
            jnp.maximum(state.reach * self.options.shrink, self.options.last_reach),
            information,
            error,
            matched,
            state.steps + 1,
            (last & (moved < STILL)) | ~jnp.isfinite(moved),
        )

    def finish(self, state: _State) -> ProfileFit:
        options = self.options
        deviation = 1 / jnp.sqrt(self._prior(state.item))
        off = jnp.abs(state.pose - state.item.guess) / deviation
        outcome = jnp.where(state.still, ProfileOutcome.CONVERGED, ProfileOutcome.STEP_LIMIT)
        outcome = jnp.where(jnp.max(off) > options.most, ProfileOutcome.TOO_FAR, outcome)
        outcome = jnp.where(state.matched < options.fewest, ProfileOutcome.TOO_FEW_PAIRS, outcome)
        sound = jnp.all(jnp.isfinite(state.pose))
        pose = jnp.where(sound, state.pose, state.item.guess)
        outcome = jnp.where(sound, outcome, ProfileOutcome.TOO_FEW_PAIRS).astype(jnp.int32)
        return ProfileFit(pose, state.information, state.error, state.matched, state.steps, outcome)

    def _prior(self, item: ProfilePair) -> Float[jax.Array, "3"]:
        """Information of odometry on (x, y, angle): it errs the more, the further it went."""
        options = self.options
        way = jnp.sqrt(item.guess[0] ** 2 + item.guess[1] ** 2)
        shift = options.odometry_shift + options.odometry_growth * way
        turn = options.odometry_turn + options.odometry_growth * jnp.abs(item.guess[2])
        return jnp.stack([1 / shift**2, 1 / shift**2, 1 / turn**2])

    def _equations(self, state: _State) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
        item, pose = state.item, state.pose
        c, s = jnp.cos(pose[2]), jnp.sin(pose[2])
        x, y = c * item.source[0] - s * item.source[1], s * item.source[0] + c * item.source[1]
        moved = x + pose[0], y + pose[1]
        across = moved[0][:, None] - item.target[0][None, :], moved[1][:, None] - item.target[1][None, :]
        squared = jnp.where(item.target_mask[None, :], across[0] ** 2 + across[1] ** 2, jnp.inf)
        index = jnp.argmin(squared, axis=1)
        near = jnp.min(squared, axis=1) < state.reach**2
        normal = item.target_normals[0][index], item.target_normals[1][index]
        turned = (
            c * item.source_normals[0] - s * item.source_normals[1],
            s * item.source_normals[0] + c * item.source_normals[1],
        )
        alike = normal[0] * turned[0] + normal[1] * turned[1] > ALIKE
        kept = item.source_mask & near & alike
        distance = normal[0] * (item.target[0][index] - moved[0]) + normal[1] * (item.target[1][index] - moved[1])
        distance = jnp.where(kept, distance, 0.0)
        count = jnp.maximum(jnp.sum(kept), 1).astype(jnp.float32)
        # the median of the kept distances: half of them are below it
        order = jnp.sort(jnp.where(kept, jnp.abs(distance), jnp.inf))
        middle = order[(jnp.sum(kept) // 2).astype(jnp.int32)]
        scatter = jnp.maximum(1.4826 * jnp.where(jnp.isfinite(middle), middle, LEAST_SCATTER), LEAST_SCATTER)
        weight = jnp.where(kept, 1 / (1 + (distance / (SOFT * scatter)) ** 2) ** 2, 0.0) / scatter**2
        row = normal[0], normal[1], normal[1] * x - normal[0] * y
        information = jnp.stack([jnp.stack([jnp.sum(weight * a * b) for b in row]) for a in row])
        right = jnp.stack([jnp.sum(weight * a * distance) for a in row])
        error = jnp.sum(jnp.abs(distance)) / count
        matched = jnp.sum(kept) / jnp.maximum(jnp.sum(item.source_mask), 1).astype(jnp.float32)
        return information, right, error, matched
