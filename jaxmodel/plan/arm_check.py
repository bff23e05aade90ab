"""An independent check that joints place the sensor where they should: plain NumPy, no code shared with the solvers."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.plan.arm import Arm


class ReachCheck(NamedTuple):
    """Of each posture: ``position_error`` (arm's unit), ``rotation_error`` (rad), and whether all limits are kept."""

    position_error: Float[np.ndarray, "*batch"]
    rotation_error: Float[np.ndarray, "*batch"]
    within_limits: Bool[np.ndarray, "*batch"]


def check_reached(
    arm: Arm, joints: Float[np.ndarray, "*batch n"], T_world_sensor: Float[np.ndarray, "*batch 4 4"]
) -> ReachCheck:
    """Distance and angle between the sensor's pose at ``joints`` and the one wanted; NaN joints give NaN and False."""
    joints, wanted = np.asarray(joints, np.float64), np.asarray(T_world_sensor, np.float64)
    place = np.broadcast_to(np.eye(4), (*joints.shape[:-1], 4, 4)) @ arm.T_world_base
    for i, kind in enumerate(arm.kinds):
        x, y, z = arm.axes[i]
        motion = np.zeros((*joints.shape[:-1], 4, 4))
        motion[..., range(4), range(4)] = 1.0
        if kind == "prismatic":
            motion[..., :3, 3] = joints[..., i, None] * arm.axes[i]
        else:
            c, s = np.cos(joints[..., i]), np.sin(joints[..., i])
            rows = [
                [c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s],
                [y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s],
                [z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)],
            ]
            motion[..., :3, :3] = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
        place = place @ arm.T_parent_joint[i] @ motion
    place = place @ arm.T_last_flange @ arm.T_flange_sensor
    distance = np.linalg.norm(place[..., :3, 3] - wanted[..., :3, 3], axis=-1)
    # the chord between two rotations is 2 sqrt(2) sin(angle / 2), exact for small angles too
    chord = np.linalg.norm(place[..., :3, :3] - wanted[..., :3, :3], axis=(-2, -1))
    angle = 2 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0))
    within = np.all((joints >= arm.limits[:, 0]) & (joints <= arm.limits[:, 1]), axis=-1)
    return ReachCheck(np.asarray(distance), np.asarray(angle), np.asarray(within))
