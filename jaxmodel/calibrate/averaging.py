"""The mean of many estimates of one transformation (RR-3507 §3.3), and the mean on SO(3) as reference.

The report averages roll-pitch-yaw angles or axis / angle, with arithmetic means, medians or Huber's M-estimator, each
scalar by itself. ``mean_on_group`` needs none of their precautions.
"""

from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3

Location = Literal["mean", "median", "huber_residuals", "huber_weights"]
Representation = Literal["roll_pitch_yaw", "axis_angle", "group"]
HUBER_K = 1.345  # Huber 1981: 95 % efficiency for normal noise
MAD_TO_SIGMA = 1.483
NEAR_PI = 0.3  # rad; the report only says "about pi"


def average(
    transforms: Float[np.ndarray, "n 4 4"],
    representation: Representation = "roll_pitch_yaw",
    location: Location = "mean",
) -> Float[np.ndarray, "4 4"]:
    """The "mean" transformation: rotation in a representation, each of its numbers and the translation by ``location``.

    Raises ``ValueError`` for no transforms.
    """
    if len(transforms) == 0:
        raise ValueError("the mean of no transformations is not defined")
    R = transforms[:, :3, :3]
    rotation = {
        "roll_pitch_yaw": average_roll_pitch_yaw,
        "axis_angle": average_axis_angle,
        "group": mean_on_group,
    }[representation](R, location)
    t = np.array([locate(transforms[:, k, 3], location) for k in range(3)])
    return se3.compose(rotation, t)


def locate(values: Float[np.ndarray, " n"], location: Location = "mean") -> float:
    """A location of samples: mean, median, or Huber's M-estimator by residuals or by weights (§3.3.3)."""
    if location == "mean":
        return float(np.mean(values))
    if location == "median":
        return float(np.median(values))
    return huber(values, by="residuals" if location == "huber_residuals" else "weights")


def huber(values: Float[np.ndarray, " n"], by: Literal["residuals", "weights"], steps: int = 100) -> float:
    """Huber's M-estimator of location with ``k = 1.345``, the scale fixed at 1.483 times the median deviation.

    By residuals: Newton steps on eq. 3.16; by weights: ``T = sum w x / sum w`` (eq. 3.17). Both end at the same place.
    Where half the values tie, the scale is 0 and the median is the answer.
    """
    T = float(np.median(values))
    S = MAD_TO_SIGMA * float(np.median(np.abs(values - T)))
    if S == 0:
        return T
    for _ in range(steps):
        r = (values - T) / S
        if by == "residuals":
            inside = np.abs(r) <= HUBER_K
            step = float(np.sum(np.clip(r, -HUBER_K, HUBER_K)) * S / max(int(inside.sum()), 1))
        else:
            w = np.minimum(1.0, HUBER_K / np.maximum(np.abs(r), 1e-300))  # psi(r) / r, 1 at 0
            step = float(np.sum(w * values) / np.sum(w)) - T
        T += step
        if abs(step) <= 1e-15 * (abs(T) + S):
            break
    return T


def average_angle(angles: Float[np.ndarray, " n"], location: Location = "mean") -> float:
    """The mean of angles (rad), on [0, 2 pi[ or on ]-pi, pi], whichever spreads less (§3.3.1); in ]-pi, pi]."""
    wide, narrow = _candidates(angles)
    chosen = narrow if np.std(wide) > np.std(narrow) else wide
    return float(_narrow(np.array(locate(chosen, location))))


def _narrow(angles: np.ndarray) -> np.ndarray:
    return np.asarray(np.pi - np.mod(np.pi - angles, 2 * np.pi))


def _candidates(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.mod(angles, 2 * np.pi), _narrow(angles)


def average_roll_pitch_yaw(R: Float[np.ndarray, "n 3 3"], location: Location = "mean") -> Float[np.ndarray, "3 3"]:
    """The rotation of the averaged angles, ``R = Rz(yaw) Ry(pitch) Rx(roll)``; pitch is to stay off 90 degrees."""
    angles = Rotation.from_matrix(R).as_euler("xyz")
    mean = np.array([average_angle(angles[:, k], location) for k in range(3)])
    return Rotation.from_euler("xyz", mean).as_matrix()


def average_axis_angle(R: Float[np.ndarray, "n 3 3"], location: Location = "mean") -> Float[np.ndarray, "3 3"]:
    """The rotation of the averaged axis and angle (§3.3.2).

    Near pi an axis and its opposite stand for the same rotation: the axes are turned to one side of their largest
    coefficient, and the angles with or without that sign, whichever spreads less (the report's step 3).
    """
    vectors = Rotation.from_matrix(R).as_rotvec()
    angles = np.linalg.norm(vectors, axis=1)
    axes = vectors / np.where(angles > 0, angles, 1.0)[:, None]
    theta = locate(angles, location)
    if abs(theta - np.pi) < NEAR_PI:
        c = int(np.argmax(np.mean(np.abs(axes), axis=0)))
        sign = np.where(axes[:, c] < 0, -1.0, 1.0)
        axes = sign[:, None] * axes
        # an axis turned over turns the angle over too: theta becomes -theta, that is 2 pi - theta
        turned = np.mod(sign * angles, 2 * np.pi)
        theta = locate(turned if np.std(angles) >= np.std(turned) else angles, location)
    axis = np.array([locate(axes[:, k], location) for k in range(3)])
    length = float(np.linalg.norm(axis))
    return Rotation.from_rotvec(theta * axis / length if length > 0 else np.zeros(3)).as_matrix()


def mean_on_group(R: Float[np.ndarray, "n 3 3"], location: Location = "mean") -> Float[np.ndarray, "3 3"]:
    """The mean on SO(3): least sum of squared angles, or of Huber's function of the angles for a robust location.

    ``median`` is the geometric one (least sum of angles, Weiszfeld's weights).
    """
    mean = Rotation.from_matrix(R).mean()
    for _ in range(200):
        errors = (Rotation.from_matrix(R) * mean.inv()).as_rotvec()
        angles = np.linalg.norm(errors, axis=1)
        step = np.average(errors, axis=0, weights=_group_weights(angles, location))
        mean = Rotation.from_rotvec(step) * mean
        if np.linalg.norm(step) < 1e-14:
            break
    return mean.as_matrix()


def _group_weights(angles: np.ndarray, location: Location) -> np.ndarray:
    if location == "mean":
        return np.ones(len(angles))
    if location == "median":
        return 1.0 / np.maximum(angles, 1e-12)
    # the angle of a three-dimensional normal error has its median at 1.538 standard deviations of one component
    scale = float(np.median(angles)) / 1.538
    return np.minimum(1.0, 2 * HUBER_K * scale / np.maximum(angles, 1e-300)) if scale > 0 else np.ones(len(angles))
