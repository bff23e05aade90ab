"""Two time-stamped streams brought together: the offset of their clocks from the angles that both must share.

Whatever X is, the hand and the camera turn by the same angle between two instants, so the offset is found before
anything is calibrated.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation, Slerp

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3

STRIDES = (0.02, 0.05, 0.1, 0.2)  # of the recording: the motions whose angles are compared


@dataclass(frozen=True)
class Stream:
    """Poses with their times in seconds, strictly increasing."""

    times: Float[np.ndarray, " n"]
    poses: Float[np.ndarray, "n 4 4"]


@dataclass(frozen=True)
class Synchronised:
    """Poses at the camera's times. A hand pose belongs to the camera pose taken at ``hand time - offset_s``.

    ``angle_error_deg``: root mean square difference of the angles at that offset; ``sharpness``: how often larger it is
    elsewhere (median over all offsets tried). A value near 1 means that the streams tell nothing of their offset.
    """

    offset_s: float
    hand: Float[np.ndarray, "n 4 4"]
    camera: Float[np.ndarray, "n 4 4"]
    times: Float[np.ndarray, " n"]
    angle_error_deg: float
    sharpness: float


def ordered(times: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n 4 4"]) -> Stream:
    """A stream in the order of time, each instant once (its first pose)."""
    unique, first = np.unique(times, return_index=True)
    return Stream(unique, poses[first])


def interpolate(stream: Stream, times: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 4 4"]:
    """Poses between those of a stream: rotation along the shortest turn, translation linear."""
    R = Slerp(stream.times, Rotation.from_matrix(stream.poses[:, :3, :3]))(times).as_matrix()
    t = np.stack([np.interp(times, stream.times, stream.poses[:, k, 3]) for k in range(3)], axis=1)
    return se3.compose(R, t)


def synchronise(
    hand: Stream, camera: Stream, largest_offset_s: float = 1.0, offset_s: float | None = None
) -> Synchronised:
    """The offset of the hand's clock to the camera's, within ``largest_offset_s``, or poses at the offset given.

    Hand poses are interpolated at the camera's times. Raises :class:`InputError` where the streams do not overlap.
    """
    inside = (camera.times - largest_offset_s >= hand.times[0]) & (camera.times + largest_offset_s <= hand.times[-1])
    if offset_s is not None:
        shifted = camera.times + offset_s
        inside = (shifted >= hand.times[0]) & (shifted <= hand.times[-1])
    if inside.sum() < 3:
        raise InputError(
            f"The streams overlap in {int(inside.sum())} camera poses: the hand covers {hand.times[0]:.3f} to "
            f"{hand.times[-1]:.3f} s, the camera {camera.times[0]:.3f} to {camera.times[-1]:.3f} s."
        )
    times, seen = camera.times[inside], camera.poses[inside]
    strides = sorted({max(1, int(share * len(times))) for share in STRIDES})
    seen_angles = [_angles(seen, stride) for stride in strides]

    def error(offset: float) -> float:
        moved = interpolate(hand, times + offset)
        differences = [_angles(moved, k) - angle for k, angle in zip(strides, seen_angles, strict=True)]
        return float(np.sqrt(np.mean(np.concatenate(differences) ** 2)))

    grid = np.linspace(-largest_offset_s, largest_offset_s, 101)
    if offset_s is None:
        values = np.array([error(offset) for offset in grid])
        best, step = grid[np.argmin(values)], grid[1] - grid[0]
        low, high = max(best - step, -largest_offset_s), min(best + step, largest_offset_s)
        found: Any = minimize_scalar(error, bounds=(low, high), method="bounded", options={"xatol": 1e-5})
        offset_s = float(found.x)
        least = error(offset_s)
        sharpness = float(np.median(values) / least) if least > 0 else float("inf")
    else:
        least, sharpness = error(offset_s), float("nan")
    return Synchronised(offset_s, interpolate(hand, times + offset_s), seen, times, float(np.degrees(least)), sharpness)


def _angles(poses: np.ndarray, stride: int) -> np.ndarray:
    turned = np.swapaxes(poses[:-stride, :3, :3], 1, 2) @ poses[stride:, :3, :3]
    return np.radians(se3.rotation_angle_deg(turned))
