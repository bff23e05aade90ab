"""Joints along a curve of views, as a circle of the observation sphere: one posture flows into the next (thesis §4.5).

Each view has up to eight postures, times its rolls, times the whole turns its joint limits leave room for. Dynamic
programming keeps, view by view, every posture that some posture of the view before can move into, with the least
motion so far. Where none can, the path breaks, says why, and starts anew; it runs each stretch as far as any choice of
postures would.
"""

from enum import IntEnum
from itertools import product
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.plan.arm import Arm
from jaxmodel.plan.inverse_kinematics import InverseKinematics, all_postures, inverse_kinematics
from jaxmodel.plan.joint_limits import TURN
from jaxmodel.plan.reach_map import rolled
from jaxmodel.plan.reach_outcome import Postures, ReachOutcome
from jaxmodel.plan.viewpoints import Circle


class Continuity(IntEnum):
    """How a view follows the one before it; each value has a ``sentence``."""

    CONTINUES = 0
    STARTS = 1
    LIMIT_BETWEEN = 2
    SINGULAR_BETWEEN = 3
    JOINT_LIMITS = 4
    OUT_OF_REACH = 5
    NOT_CONVERGED = 6
    NOT_FINITE = 7

    @property
    def sentence(self) -> str:
        return {
            Continuity.CONTINUES: "the joints move on from the view before",
            Continuity.STARTS: "the path starts here",
            Continuity.LIMIT_BETWEEN: "the joints would move on from the view before only beyond a limit: the arm must "
            "change its posture",
            Continuity.SINGULAR_BETWEEN: "no posture continues the one before without a jump: a singular posture lies "
            "between, or the views lie too far apart for the largest step",
            Continuity.JOINT_LIMITS: "the view is reached only beyond the joint limits",
            Continuity.OUT_OF_REACH: "the view is out of reach",
            Continuity.NOT_CONVERGED: "no start of the search ended at the view, which may be out of reach",
            Continuity.NOT_FINITE: "the view is not a finite rigid motion",
        }[self]


UNREACHED = {
    ReachOutcome.JOINT_LIMITS: Continuity.JOINT_LIMITS,
    ReachOutcome.OUT_OF_REACH: Continuity.OUT_OF_REACH,
    ReachOutcome.NOT_CONVERGED: Continuity.NOT_CONVERGED,
    ReachOutcome.NOT_FINITE: Continuity.NOT_FINITE,
}


class PathBreak(NamedTuple):
    """Views ``first`` to ``last`` for which the path breaks for one ``reason``."""

    first: int
    last: int
    reason: Continuity


class ArmPath(eqx.Module):
    """Joints for each view of a path; NaN where there are none.

    ``T_world_sensor``: the poses with the roll chosen. ``stretch`` counts the pieces within which the joints move
    without a jump, -1 where a view is not reached. ``continuity``: how each view follows the one before.
    """

    T_world_sensor: Float[AnyArray, "m 4 4"]
    joints: Float[AnyArray, "m n"]
    roll: Float[AnyArray, " m"]
    stretch: Int[AnyArray, " m"]
    continuity: Int[AnyArray, " m"]

    @property
    def breaks(self) -> list[PathBreak]:
        """Where the path breaks and why, neighbours with one reason together if they are not reached."""
        found: list[PathBreak] = []
        for view, value in enumerate(self.continuity):
            reason = Continuity(int(value))
            if reason in (Continuity.CONTINUES, Continuity.STARTS):
                continue
            if self.stretch[view] < 0 and found and found[-1].last == view - 1 and found[-1].reason == reason:
                found[-1] = found[-1]._replace(last=view)
            else:
                found.append(PathBreak(view, view, reason))
        return found

    @property
    def complete(self) -> bool:
        """Whether one stretch reaches every view."""
        return bool(np.all(self.stretch == 0))


def path_along_circle(
    arm: Arm,
    circle: Circle,
    count: int = 180,
    largest_step_deg: float = 10.0,
    method: InverseKinematics = InverseKinematics(),
    start_deg: float = 0.0,
) -> ArmPath:
    """Joints once around ``circle``, at ``count`` views and the first again, from ``start_deg``; see ``path_along``.

    Where the arm cannot go all round, another start gives another cut: start in the gap to have the longest stretch.
    """
    if count < 3:
        raise InputError(f"arm path: expected at least 3 views on a circle, not {count}.")
    angles = np.deg2rad(start_deg) + np.linspace(0, 2 * np.pi, count + 1)
    return path_along(arm, circle.poses(angles[:, None]), largest_step_deg, method)


def path_along(
    arm: Arm,
    T_world_sensor: Float[np.ndarray, "m 4 4"],
    largest_step_deg: float = 10.0,
    method: InverseKinematics = InverseKinematics(),
) -> ArmPath:
    """Joints along a sequence of poses, in as few stretches as the postures allow.

    Args:
        arm: the arm, with its limits.
        T_world_sensor: neighbouring views of one curve, world frame, arm's unit.
        largest_step_deg: how far any joint may move from view to view; a slide, that angle in radian times the
            arm's size.
        method: with several rolls, each is a choice, and changes along the path where the step allows.
    """
    if not largest_step_deg > 0:
        raise InputError(f"arm path: expected a positive largest step, not {largest_step_deg}.")
    wanted = np.asarray(T_world_sensor, np.float64)
    outcome = inverse_kinematics(arm, wanted, None, method).outcome
    found = all_postures(arm, wanted, None, method)
    tracker = _Tracker(arm, np.deg2rad(largest_step_deg))
    joints, roll = np.full((len(wanted), arm.count), np.nan), np.full(len(wanted), np.nan)
    stretch, continuity = np.full(len(wanted), -1, np.int32), np.zeros(len(wanted), np.int32)
    layers: list[_Layer] = []
    number = 0
    for view in range(len(wanted)):
        states = tracker.states(found, view)
        following = tracker.step(layers[-1], states) if layers else None
        if layers and following is None:
            # a joint that a singular posture leaves free, or a search, may continue from where the arm is
            near = all_postures(arm, wanted[view : view + 1], layers[-1].best, method)
            more = tracker.states(near, 0)
            following = tracker.step(layers[-1], more)
            states = states if len(states.joints) else more
        if following is not None:
            layers.append(following)
            continue
        reached = len(states.joints) > 0
        if layers:
            limited = tracker.continues_beyond_limits(layers[-1], found, view)
            number = _write(layers, view, number, joints, roll, stretch)
            between = Continuity.LIMIT_BETWEEN if limited else Continuity.SINGULAR_BETWEEN
        else:
            between = Continuity.STARTS
        continuity[view] = between if reached else UNREACHED[ReachOutcome(int(outcome[view]))]
        layers = [_Layer(states.joints, states.roll, np.zeros(len(states.joints)), None)] if reached else []
    _write(layers, len(wanted), number, joints, roll, stretch)
    return ArmPath(rolled(wanted, roll), joints, roll, stretch, continuity)


class _States(NamedTuple):
    """Postures of one view within the limits, with all whole turns."""

    joints: Float[np.ndarray, "k n"]
    roll: Float[np.ndarray, " k"]


class _Layer(NamedTuple):
    """States of one view that the path can be in, the least motion to them and the state before each."""

    joints: Float[np.ndarray, "k n"]
    roll: Float[np.ndarray, " k"]
    cost: Float[np.ndarray, " k"]
    before: Int[np.ndarray, " k"] | None

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        return self.joints[np.argmin(self.cost)]


class _Tracker:
    """What the steps of one path share."""

    def __init__(self, arm: Arm, largest_step: float) -> None:
        turning = np.array([kind == "revolute" for kind in arm.kinds])
        self.low, self.high = arm.limits.T
        self.endless = turning & ~np.isfinite(arm.limits).all(axis=1)
        self.turning = turning
        self.unit = np.where(turning, 1.0, arm.size)
        self.largest = largest_step
        more = np.where(turning & ~self.endless, np.floor((self.high - self.low) / TURN), 0).astype(int)
        self.turns = TURN * np.array(list(product(*(range(count + 1) for count in more))), np.float64)

    def states(self, found: Postures, view: int) -> _States:
        kept = found.reached[view]
        joints = found.joints[view][kept]
        fewest = np.ceil((self.low - joints) / TURN - 1e-12)
        lowest = np.where(self.turning & ~self.endless, joints + TURN * np.where(self.endless, 0, fewest), joints)
        every = (lowest[:, None] + self.turns).reshape(-1, joints.shape[1])
        roll = np.repeat(found.roll[view][kept], len(self.turns))
        slack = 1e-9 * self.unit
        inside = np.all((every >= self.low - slack) & (every <= self.high + slack), axis=1)
        return _States(np.clip(every[inside], self.low, self.high), roll[inside])

    def moves(self, before: np.ndarray, after: np.ndarray, turning: np.ndarray) -> np.ndarray:
        """Motion (before, after, joint) in radian or arm sizes, to the nearest whole turn where ``turning``."""
        move = after[None] - before[:, None]
        return np.where(turning, move - TURN * np.round(move / TURN), move) / self.unit

    def step(self, layer: _Layer, states: _States) -> _Layer | None:
        """The states that some state before can move into, or None."""
        if len(states.joints) == 0:
            return None
        move = self.moves(layer.joints, states.joints, self.endless)
        can = np.abs(move).max(axis=2) <= self.largest
        cost = np.where(can, layer.cost[:, None] + np.sum(move**2, axis=2), np.inf)
        into = can.any(axis=0)
        if not into.any():
            return None
        before = np.argmin(cost, axis=0)[into]
        # a joint without limits goes on turning from where it is
        joints = layer.joints[before] + move[before, np.flatnonzero(into)] * self.unit
        joints = np.where(self.endless, joints, states.joints[into])
        return _Layer(joints, states.roll[into], np.min(cost, axis=0)[into], before)

    def continues_beyond_limits(self, layer: _Layer, found: Postures, view: int) -> bool:
        """Whether a posture that would follow is there but for the limits."""
        exact = found.joints[view][found.exact[view]]
        if len(exact) == 0:
            return False
        return bool((np.abs(self.moves(layer.joints, exact, self.turning)).max(axis=2) <= self.largest).any())


def _write(
    layers: list[_Layer], end: int, number: int, joints: np.ndarray, roll: np.ndarray, stretch: np.ndarray
) -> int:
    """The stretch that ends before view ``end``, read back from its last layer; the number of the next stretch."""
    if not layers:
        return number
    state = int(np.argmin(layers[-1].cost))
    for view, layer in zip(range(end - 1, -1, -1), reversed(layers), strict=False):
        joints[view], roll[view], stretch[view] = layer.joints[state], layer.roll[state], number
        state = -1 if layer.before is None else int(layer.before[state])
    return number + 1
