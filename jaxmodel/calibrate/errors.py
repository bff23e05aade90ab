"""Measures of a calibration's error: RR-3507 §3.4 and its Table 3.2, angles, and the error at a working distance."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxmodel.geometry import se3


@dataclass(frozen=True)
class CalibrationError:
    """Errors of one X against a reference.

    ``quaternion_squared`` is RR-3507's measure ``|q^ - q|^2 = 2 - 2 cos(angle / 2)`` (which the report prints without
    the square), q and -q made to agree; ``relative_translation`` is ``|t - t*| / |t*|``.
    """

    angle_deg: float
    quaternion_squared: float
    distance: float
    relative_translation: float


def calibration_error(X: Float[np.ndarray, "4 4"], reference: Float[np.ndarray, "4 4"]) -> CalibrationError:
    """All measures of ``X`` against ``reference``; the relative one is NaN where the reference has no translation."""
    angle = float(se3.rotation_angle_deg(X[:3, :3] @ reference[:3, :3].T))
    distance = float(np.linalg.norm(X[:3, 3] - reference[:3, 3]))
    size = float(np.linalg.norm(reference[:3, 3]))
    squared = float(quaternion_error(np.array(angle)))
    return CalibrationError(angle, squared, distance, distance / size if size > 0 else float("nan"))


def quaternion_error(angle_deg: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """RR-3507's rotation error of a residual angle (Table 3.2): ``2 - 2 cos(angle / 2) = 4 sin^2(angle / 4)``."""
    return np.asarray(4 * np.sin(np.radians(angle_deg) / 4) ** 2)


def quaternion_error_angle_deg(error: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """The residual angle of a rotation error: the inverse of ``quaternion_error``."""
    return np.asarray(np.degrees(4 * np.arcsin(np.clip(np.sqrt(error) / 2, 0.0, 1.0))))


def root_mean_square(values: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch"]:
    """RR-3507's RMS over draws."""
    return np.asarray(np.sqrt(np.mean(np.square(values), axis=-1)))


def reach_covariance(
    covariance: Float[np.ndarray, "6 6"], X: Float[np.ndarray, "4 4"], point: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """Covariance of where a point seen by the camera is placed by X, from X's ``(rotation, translation)`` covariance.

    ``point`` is in the camera's frame. ``p = R q + t`` moves by ``d x (R q) + e``.
    """
    x, y, z = X[:3, :3] @ point
    lever = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])  # d x v = -[v] d
    J = np.concatenate([lever, np.eye(3)], axis=1)
    return J @ covariance @ J.T


def expected_error(
    covariance: Float[np.ndarray, "6 6"], X: Float[np.ndarray, "4 4"], distance: float, freedom: float = np.inf
) -> float:
    """Root mean square error of a point at ``distance`` along the camera's axis (z), in the unit of X.

    With few degrees of freedom the noise level itself is uncertain: the factor nu / (nu - 2) of Student's law.
    """
    total = float(np.trace(reach_covariance(covariance, X, np.array([0.0, 0.0, distance]))))
    widen = 1.0 if np.isinf(freedom) else (freedom / (freedom - 2) if freedom > 2 else float("nan"))
    return float(np.sqrt(total * widen))
