"""2D laser profiles: one distance a beam, in a plane; poses in it are (x, y, angle), metre and radian."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

JUMP = 0.15
"""Neighbours on one surface are closer than this share of their distance from the laser (and a few centimetres)."""
LEAST_JUMP = 0.1


class Profile(NamedTuple):
    """``points (b, 2)`` of each beam in the laser's frame, ``normals (b, 2)`` unit, towards the laser; ``held (b,)``
    whether the beam came back; ``lined (b,)`` whether it has neighbours enough for a normal.
    """

    points: Float[np.ndarray, "b 2"]
    normals: Float[np.ndarray, "b 2"]
    held: Bool[np.ndarray, " b"]
    lined: Bool[np.ndarray, " b"]


def profile(
    ranges: Float[np.ndarray, " b"], farthest: float, first_deg: float = -90.0, step_deg: float = 1.0
) -> Profile:
    """Points and normals of one scan; beam k looks along ``first_deg + k step_deg``, counter-clockwise from ahead.

    ``farthest``: readings from here on mean that nothing came back. A normal is that of the least-squares line through
    up to two neighbours on each side that lie on the same surface.
    """
    angle = np.deg2rad(first_deg + step_deg * np.arange(len(ranges)))
    held = np.isfinite(ranges) & (ranges > 0) & (ranges < farthest)
    reach = np.where(held, ranges, 0.0)
    points = reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    count = np.zeros(len(ranges))
    first, second = np.zeros((len(ranges), 2)), np.zeros((len(ranges), 2, 2))
    limit = np.maximum(JUMP * reach, LEAST_JUMP)
    for by in (-2, -1, 0, 1, 2):
        other = np.clip(np.arange(len(ranges)) + by, 0, len(ranges) - 1)
        offset = points[other] - points
        near = held & held[other] & (np.linalg.norm(offset, axis=1) <= limit * max(abs(by), 1))
        near &= np.arange(len(ranges)) + by == other
        offset = np.where(near[:, None], offset, 0.0)
        count += near
        first += offset
        second += offset[:, :, None] * offset[:, None, :]
    safe = np.maximum(count, 1)
    mean = first / safe[:, None]
    spread = second / safe[:, None, None] - mean[:, :, None] * mean[:, None, :]
    # the direction of least spread of a 2 x 2 matrix, in closed form
    turn = 0.5 * np.arctan2(2 * spread[:, 0, 1], spread[:, 0, 0] - spread[:, 1, 1])
    normals = np.column_stack([-np.sin(turn), np.cos(turn)])
    normals *= np.where(np.sum(normals * points, axis=1) > 0, -1.0, 1.0)[:, None]
    lined = held & (count >= 3)
    return Profile(points, normals, held, lined)


def motion(pose: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """The 3 x 3 matrix that maps points of the frame at ``pose`` into the frame the pose is given in."""
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    out = np.zeros((*pose.shape[:-1], 3, 3))
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = c, -s, pose[..., 0]
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = s, c, pose[..., 1]
    out[..., 2, 2] = 1.0
    return out


def compose(a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """The pose of b, given in the frame at a, in the frame that a is given in."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + c * b[..., 0] - s * b[..., 1]
    y = a[..., 1] + s * b[..., 0] + c * b[..., 1]
    return np.stack([x, y, wrapped(np.asarray(a[..., 2] + b[..., 2]))], axis=-1)


def between(a: Float[np.ndarray, "*n 3"], b: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """The pose of b seen from a."""
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * x + s * y, -s * x + c * y, wrapped(np.asarray(b[..., 2] - a[..., 2]))], axis=-1)


def wrapped(angle: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """The same angle from -pi to pi."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
