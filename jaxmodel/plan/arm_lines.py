"""The lines of an arm's joints at zero, what tells one kind of arm from another; and its chain of points."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxmodel.plan.arm import Arm, link_frames


class Lines(NamedTuple):
    """Unit ``directions`` and a point of each joint's axis, and the sensor's pose, all joints at zero."""

    directions: Float[np.ndarray, "n 3"]
    points: Float[np.ndarray, "n 3"]
    T_base_sensor: Float[np.ndarray, "4 4"]


def joint_lines(arm: Arm) -> Lines:
    """The axes of all joints at zero, in the base frame."""
    place, directions, points = np.eye(4), [], []
    for before, axis in zip(arm.T_parent_joint, arm.axes, strict=True):
        place = place @ before
        directions.append(place[:3, :3] @ axis)
        points.append(place[:3, 3])
    return Lines(np.stack(directions), np.stack(points), place @ arm.T_last_flange @ arm.T_flange_sensor)


def chain_points(arm: Arm, joints: Float[np.ndarray, " n"]) -> Float[np.ndarray, "m 3"]:
    """Base, joints, flange and sensor of an arm at ``joints``, in the world, from foot to tip: for drawing."""
    with jax.enable_x64(True):
        chain = link_frames(arm, jnp.asarray(joints, jnp.float64))
        places = [arm.T_world_base, *np.asarray(chain.T_world_link), chain.T_world_flange, chain.T_world_sensor]
        return np.stack([np.asarray(T)[:3, 3] for T in places])


def meeting_point(
    directions: Float[np.ndarray, "m 3"], points: Float[np.ndarray, "m 3"], tolerance: float
) -> Float[np.ndarray, "3"] | None:
    """The point that all lines pass through to within ``tolerance``, or None; parallel lines have none."""
    off = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    normal = off.sum(axis=0)
    if np.linalg.cond(normal) > 1e9:
        return None
    centre = np.linalg.solve(normal, np.einsum("nij,nj->i", off, points))
    away = np.linalg.norm(np.einsum("nij,nj->ni", off, centre - points), axis=1)
    return centre if away.max() <= tolerance else None
