"""Where to move the arm's base when the rest of the views is out of reach (thesis §4.5, Fig. 4.12)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.plan.arm import Arm
from jaxmodel.plan.inverse_kinematics import InverseKinematics, reachable


class Reposition(NamedTuple):
    """The base chosen among the candidates, and what it reaches.

    ``candidate``: its index, -1 if no candidate reaches any wanted view, and then ``T_world_base`` is where the arm
    stands; ``reached``: which wanted views it reaches; ``counts``: how many each candidate reaches.
    """

    candidate: int
    T_world_base: Float[np.ndarray, "4 4"]
    reached: Bool[np.ndarray, " m"]
    counts: Float[np.ndarray, " c"]

    @property
    def sentence(self) -> str:
        if self.candidate < 0:
            return "no candidate place of the base reaches any of the views still wanted"
        return f"candidate {self.candidate} reaches {int(self.reached.sum())} of {len(self.reached)} views still wanted"


def bases_around(
    centre: Float[np.ndarray, "3"],
    distances: Float[np.ndarray, " a"],
    bearings: Float[np.ndarray, " b"],
    turns: Float[np.ndarray, " t"] = np.zeros(1),
) -> Float[np.ndarray, "c 3"]:
    """Candidates (x, y, yaw) around ``centre``, seen from it at ``bearings`` (rad), facing it but for ``turns`` (rad).

    All combinations, distances slowest. The caller leaves out those where the platform cannot stand.
    """
    distance, bearing, turn = (a.ravel() for a in np.meshgrid(distances, bearings, turns, indexing="ij"))
    x, y = centre[0] + distance * np.cos(bearing), centre[1] + distance * np.sin(bearing)
    return np.stack([x, y, bearing + np.pi + turn], axis=1)


def base_poses(T_world_base: Float[np.ndarray, "4 4"], places: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "c 4 4"]:
    """``T_world_base`` moved to places (x, y, yaw in rad), its height and its tilt kept.

    The yaw is that of the base's x axis on the floor; the world's z axis is up.
    """
    places = np.asarray(places, np.float64)
    if not np.isfinite(places).all():
        raise InputError("reposition: expected finite candidates (x, y, yaw).")
    turn = places[:, 2] - np.arctan2(T_world_base[1, 0], T_world_base[0, 0])
    c, s, zero, one = np.cos(turn), np.sin(turn), np.zeros_like(turn), np.ones_like(turn)
    R = np.stack([np.stack(row, -1) for row in [[c, -s, zero], [s, c, zero], [zero, zero, one]]], -2)
    t = np.concatenate([places[:, :2], np.full((len(places), 1), T_world_base[2, 3])], axis=1)
    return se3.compose(R @ T_world_base[:3, :3], t)


def reach_matrix(
    arm: Arm,
    T_world_sensor: Float[np.ndarray, "m 4 4"],
    T_world_base: Float[np.ndarray, "c 4 4"],
    method: InverseKinematics = InverseKinematics(),
) -> Bool[np.ndarray, "c m"]:
    """Which views the arm reaches from each place of its base: all pairs in one batch, those too far left out."""
    for candidate in np.flatnonzero(~se3.are_rigid(T_world_base)):
        raise InputError(f"reposition: candidate {candidate} is not a rigid motion.")
    if len(T_world_base) == 0 or len(T_world_sensor) == 0:
        raise InputError("reposition: expected at least one candidate and one wanted view.")
    views = np.asarray(T_world_sensor, np.float64)
    shoulders = T_world_base @ arm.T_parent_joint[0] @ np.array([0.0, 0.0, 0.0, 1.0])
    away = np.linalg.norm(views[None, :, :3, 3] - shoulders[:, None, :3], axis=-1)
    # a pose that is not finite compares as too far; the share covers the rounding of the arm's own sum of lengths
    pairs = np.argwhere(away <= arm.size * (1 + 1e-6))
    matrix = np.zeros((len(T_world_base), len(views)), bool)
    if len(pairs):
        wanted = se3.inverse(T_world_base)[pairs[:, 0]] @ views[pairs[:, 1]]
        matrix[pairs[:, 0], pairs[:, 1]] = reachable(arm.at(np.eye(4)), wanted, method)
    return matrix


def reposition(
    arm: Arm,
    T_world_sensor: Float[np.ndarray, "m 4 4"],
    places: Float[np.ndarray, "c 3"],
    method: InverseKinematics = InverseKinematics(),
) -> Reposition:
    """The place of the base that reaches most of the views still wanted; among equals the nearest to the present one.

    Args:
        arm: where it stands now; its base keeps its height and tilt.
        T_world_sensor: views still wanted, world frame, arm's unit.
        places: candidates (x, y, yaw in rad) where the platform can stand, as of ``bases_around``.
        method: rolls and tolerances.
    """
    bases = base_poses(arm.T_world_base, places)
    matrix = reach_matrix(arm, T_world_sensor, bases, method)
    counts = matrix.sum(axis=1)
    travel = np.linalg.norm(bases[:, :2, 3] - arm.T_world_base[:2, 3], axis=1)
    best = int(np.lexsort((travel, -counts))[0])
    if counts[best] == 0:
        return Reposition(-1, arm.T_world_base, matrix[best], counts.astype(float))
    return Reposition(best, bases[best], matrix[best], counts.astype(float))
