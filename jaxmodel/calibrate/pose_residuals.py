"""How far an answer is from each pose and from each pair of poses, one measure for every method."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import f

from jaxmodel.calibrate.conclude import pair_residuals
from jaxmodel.calibrate.motions import Chain, MotionPairs, Setup, chain
from jaxmodel.geometry import se3

SURE = 1e-3


@dataclass(frozen=True)
class CameraErrors:
    """Of each camera pose against the predicted one: angle (rad), distance across its line of sight, and along it."""

    turn: Float[np.ndarray, " n"]
    across: Float[np.ndarray, " n"]
    along: Float[np.ndarray, " n"]

    @property
    def kinds(self) -> tuple[tuple[Float[np.ndarray, " n"], int], ...]:
        """Each kind with its number of dimensions."""
        return (self.turn, 3), (self.across, 2), (self.along, 1)


def camera_errors(poses: Chain, X: Float[np.ndarray, "4 4"], Z: Float[np.ndarray, "4 4"]) -> CameraErrors:
    """How far each camera pose, metric, is from ``X^-1 H^-1 Z``."""
    predicted = se3.inverse(poses.H @ X) @ Z
    angle = np.radians(se3.rotation_angle_deg(np.swapaxes(predicted[:, :3, :3], 1, 2) @ poses.C[:, :3, :3]))
    error, place = poses.C[:, :3, 3] - predicted[:, :3, 3], poses.C[:, :3, 3]
    distance = np.linalg.norm(place, axis=1, keepdims=True)
    sight = np.where(distance > 0, place / np.where(distance > 0, distance, 1.0), [0.0, 0.0, 1.0])
    along = np.sum(error * sight, axis=1)
    return CameraErrors(angle, np.linalg.norm(error - along[:, None] * sight, axis=1), np.abs(along))


def depth_stands_out(errors: CameraErrors) -> bool:
    """Whether the variance along the line of sight differs from that across it, beyond 1 chance in 1000 (F test)."""
    n = len(errors.along)
    along, across = float(np.mean(errors.along**2)), float(np.mean(errors.across**2)) / 2
    if n < 6 or along == 0 or across == 0:
        return False
    # each variance with its part of the twelve unknowns
    larger = float(f.sf(along / across, n - 2, 2 * n - 4))
    return min(larger, 1 - larger) < SURE / 2


def pose_residuals(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "n 4 4"],
    setup: Setup,
    X: Float[np.ndarray, "4 4"],
    Z: Float[np.ndarray, "4 4"],
    scale: float = 1.0,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Angle (rad) and distance (unit of the hand) of each camera pose from the one that X and Z predict.

    ``H X C = Z`` predicts ``C = X^-1 H^-1 Z``; the camera's translations are given in ``1 / scale`` of the hand's unit.
    """
    errors = camera_errors(chain(hand, _scaled(camera, scale), setup), X, Z)
    return errors.turn, np.hypot(errors.across, errors.along)


def motion_residuals(
    motions: MotionPairs, X: Float[np.ndarray, "4 4"], scale: Float[np.ndarray, " m"] | float = 1.0
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Angle (rad) and distance (unit of the hand) of ``A X - X B``, A the hand's motion and B the camera's.

    X is the camera's place (``T_hand_camera``, or ``T_base_camera`` of a fixed camera), ``scale`` that of the camera's
    translations in each motion.
    """
    camera = motions.A.copy()
    camera[:, :3, 3] *= np.broadcast_to(scale, len(camera))[:, None]
    return pair_residuals(se3.inverse(motions.B), se3.inverse(camera), X)


def _scaled(camera: Float[np.ndarray, "n 4 4"], scale: float) -> Float[np.ndarray, "n 4 4"]:
    metric = camera.copy()
    metric[:, :3, 3] *= scale
    return metric
