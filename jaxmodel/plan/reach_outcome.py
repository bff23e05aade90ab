"""How a search for joints ended, and what it found."""

from enum import IntEnum

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.geometry.arrays import AnyArray


class ReachOutcome(IntEnum):
    """Each value has a ``sentence``."""

    REACHED = 0
    SINGULAR = 1
    JOINT_LIMITS = 2
    OUT_OF_REACH = 3
    NOT_CONVERGED = 4
    NOT_FINITE = 5

    @property
    def sentence(self) -> str:
        return {
            ReachOutcome.REACHED: "the arm places the sensor there",
            ReachOutcome.SINGULAR: "the arm places the sensor there, in a singular posture: it cannot move on in every "
            "direction",
            ReachOutcome.JOINT_LIMITS: "the arm would reach the pose, but only beyond its joint limits",
            ReachOutcome.OUT_OF_REACH: "no joints of this arm, within limits or not, place the sensor there",
            ReachOutcome.NOT_CONVERGED: "no start of the search ended at the pose, which may be out of reach",
            ReachOutcome.NOT_FINITE: "the pose is not a finite rigid motion",
        }[self]

    @property
    def reached(self) -> bool:
        """Whether there are joints to go to."""
        return self in (ReachOutcome.REACHED, ReachOutcome.SINGULAR)


class Postures(eqx.Module):
    """All candidate joints of each pose: ``reached`` ones are exact and within the limits, the rest are not for use.

    ``exact`` ones reach the pose, within the limits or not. ``roll`` (rad) turns the pose about the sensor's z axis.
    """

    joints: Float[AnyArray, "*m c n"]
    reached: Bool[AnyArray, "*m c"]
    exact: Bool[AnyArray, "*m c"]
    roll: Float[AnyArray, "*m c"]
    position_error: Float[AnyArray, "*m c"]
    rotation_error: Float[AnyArray, "*m c"]


class Placements(eqx.Module):
    """The posture chosen for each pose; NaN joints where there is none.

    ``roll`` (rad): the pose reached is ``T_world_sensor @ Rz(roll)``. ``position_error`` (arm's unit) and
    ``rotation_error`` (rad) are from forward kinematics; where nothing reaches the pose, those of the nearest
    candidate. ``limit_margin``: distance of the joint closest to a limit, in half ranges. ``dexterity``:
    ``1 / |J^-1|`` with lengths in arm sizes: the sensor moves at least that fast for joints moving at unit rate, in
    any direction; 0 is singular.
    """

    joints: Float[AnyArray, "*m n"]
    outcome: Int[AnyArray, "*m"]
    roll: Float[AnyArray, "*m"]
    position_error: Float[AnyArray, "*m"]
    rotation_error: Float[AnyArray, "*m"]
    limit_margin: Float[AnyArray, "*m"]
    dexterity: Float[AnyArray, "*m"]

    @property
    def reached(self) -> Bool[np.ndarray, " m"]:
        """Which poses have joints."""
        return self.outcome <= ReachOutcome.SINGULAR

    def outcome_of(self, index: int) -> ReachOutcome:
        """The outcome of one pose, with its sentence."""
        return ReachOutcome(int(self.outcome[index]))
