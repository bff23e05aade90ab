"""How far an answer is from each pose and from each pair of poses, one measure for every method."""

import numpy as np
from jaxtyping import Float

from jaxmodel.calibrate.conclude import pair_residuals
from jaxmodel.calibrate.motions import MotionPairs, Setup, chain
from jaxmodel.geometry import se3


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
    poses = chain(hand, _scaled(camera, scale), setup)
    predicted = se3.inverse(poses.H @ X) @ Z
    angle = np.radians(se3.rotation_angle_deg(np.swapaxes(predicted[:, :3, :3], 1, 2) @ poses.C[:, :3, :3]))
    return angle, np.linalg.norm(predicted[:, :3, 3] - poses.C[:, :3, 3], axis=1)


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
