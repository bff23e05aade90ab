"""Which views of an observation sphere an arm can take (thesis §4.5, Fig. 4.13), and a mask of it for view spaces."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.plan.arm import Arm
from jaxmodel.plan.inverse_kinematics import InverseKinematics, inverse_kinematics, reachable
from jaxmodel.plan.reach_outcome import Placements, ReachOutcome
from jaxmodel.plan.viewpoints import ViewSpace


class ArmReach:
    """The poses an arm reaches, as a mask: ``Restricted(space, ArmReach(arm))`` is the space without the others.

    The sensor stands where the arm's ``T_flange_sensor`` puts it, the X of a hand-eye calibration
    (``arm.carrying(X)``). With ``method.rolls > 1`` a pose counts if some roll of it about the sensor's z axis is
    reached; :meth:`place` then returns the pose with its roll, which is the one to scan from.
    """

    def __init__(self, arm: Arm, method: InverseKinematics = InverseKinematics()) -> None:
        self.arm = arm
        self.method = method

    def __call__(self, poses: Float[np.ndarray, "n 4 4"]) -> Bool[np.ndarray, " n"]:
        """Which of ``T_world_sensor`` are reached; one that is no finite rigid motion is not."""
        poses = np.asarray(poses, np.float64)
        return reachable(self.arm, poses, self.method) if len(poses) else np.zeros(0, bool)

    def place(self, poses: Float[np.ndarray, "n 4 4"], current: Float[np.ndarray, " j"] | None = None) -> "ArmViews":
        """Joints for each pose, near ``current`` where given, and the pose with the roll that was chosen."""
        poses = np.asarray(poses, np.float64)
        found = inverse_kinematics(self.arm, poses, current, self.method)
        return ArmViews(rolled(poses, found.roll), found)


class ArmViews(eqx.Module):
    """Poses and the joints that take the sensor there.

    ``T_world_sensor``: with the roll that was chosen; where nothing reaches it, as it was asked for.
    """

    T_world_sensor: Float[AnyArray, "n 4 4"]
    placements: Placements

    @property
    def reached(self) -> Bool[np.ndarray, " n"]:
        """Which views have joints."""
        return self.placements.reached

    @property
    def share(self) -> float:
        """Share of the views that are reached: of the sphere's area, where they cover it evenly."""
        return float(np.mean(self.reached))

    @property
    def counts(self) -> dict[ReachOutcome, int]:
        """How many views ended in each outcome."""
        return {outcome: int(np.sum(self.placements.outcome == outcome)) for outcome in ReachOutcome}


class ReachMap(ArmViews):
    """``ArmViews`` of views that cover a view space evenly; ``parameters`` are theirs in that space."""

    parameters: Float[AnyArray, "n d"]


def reach_map(
    arm: Arm,
    space: ViewSpace,
    count: int = 1000,
    method: InverseKinematics = InverseKinematics(),
    seed: int = 0,
) -> ReachMap:
    """Joints for ``count`` views spread evenly over ``space``, a sphere or any other."""
    if count < 1:
        raise InputError(f"reach map: expected at least one view, not {count}.")
    parameters = np.asarray(space.spread(count, seed), np.float64)
    views = ArmReach(arm, method).place(space.poses(parameters))
    return ReachMap(views.T_world_sensor, views.placements, parameters)


def rolled(
    T_world_sensor: Float[np.ndarray, "*batch 4 4"], roll: Float[np.ndarray, "*batch"]
) -> Float[np.ndarray, "*batch 4 4"]:
    """Poses turned by ``roll`` (rad) about their own z axis; a NaN roll is none."""
    roll = np.where(np.isnan(roll), 0.0, roll)[..., None]
    x, y = T_world_sensor[..., :, 0], T_world_sensor[..., :, 1]
    turned = np.array(T_world_sensor, np.float64)
    turned[..., :, 0], turned[..., :, 1] = np.cos(roll) * x + np.sin(roll) * y, np.cos(roll) * y - np.sin(roll) * x
    return turned
