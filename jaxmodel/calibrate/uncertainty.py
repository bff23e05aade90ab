"""How far to trust X: its covariance from independent motions, and intervals that know how few the motions are.

Poses are not independent motions: pairs of the same poses share their errors, and treating them as independent is wrong
by an order of magnitude. From absolute poses take the covariance that ``joint`` returns.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from jaxmodel.calibrate.nonlinear import Stream
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3

ROUNDS = 4  # the shares of the unknowns and the variances settle in two or three
ROUNDING = 1e-30


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of (rotation, translation) errors of X: ``R <- exp(d) R`` (rad), ``t <- t + e`` (unit of B).

    ``rotation_noise`` (rad) and ``translation_noise`` are the standard deviations of one component of the noisy
    stream; ``freedom`` the degrees of freedom of the less well known of both.
    """

    covariance: Float[np.ndarray, "6 6"]
    rotation_noise: float
    translation_noise: float
    freedom: float


def motion_uncertainty(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "n 4 4"],
    X: Float[np.ndarray, "4 4"],
    noise_in: Stream = "A",
) -> Uncertainty:
    """The uncertainty of the X that ``nonlinear`` finds in independent motions of which one stream carries the noise.

    It is the Cramer-Rao bound at the noise that the residuals show: variance components, each with its own share of the
    unknowns. Raises :class:`InputError` for fewer than three motions, which leave nothing to see the noise by.
    """
    if len(A) < 3:
        raise InputError(f"{len(A)} motions show nothing of the noise; at least 3 are needed.")
    if noise_in == "B":
        other = motion_uncertainty(B, A, se3.inverse(X))
        M = _by_inverse(X)
        return Uncertainty(M @ other.covariance @ M.T, other.rotation_noise, other.translation_noise, other.freedom)
    n = len(A)
    R, t = X[:3, :3], X[:3, 3]
    predicted = R @ B[:, :3, :3] @ R.T
    excess = np.eye(3) - predicted
    moved = B[:, :3, 3] @ R.T
    turn = Rotation.from_matrix(A[:, :3, :3] @ np.swapaxes(predicted, 1, 2)).as_rotvec()
    shift = A[:, :3, 3] - moved - excess @ t
    by_turn = np.concatenate([excess, np.zeros((n, 3, 3))], axis=2)
    by_shift = np.concatenate([_skew(predicted @ t) @ excess - _skew(moved), excess], axis=2)
    information = [np.einsum("nki,nkj->ij", J, J) for J in (by_turn, by_shift)]
    squares = np.array([np.sum(turn**2), np.sum(shift**2)])
    freedom = np.array([3.0 * n - 3, 3.0 * n - 3])
    covariance, variance = np.zeros((6, 6)), squares / freedom
    for _ in range(ROUNDS):
        variance = squares / freedom + ROUNDING
        parts = [N / v for N, v in zip(information, variance, strict=True)]
        covariance = np.linalg.pinv(parts[0] + parts[1], rcond=1e-14, hermitian=True)
        freedom = np.array([max(3.0 * n - np.sum(covariance * part), 1.0) for part in parts])
    noise = np.sqrt(variance)
    return Uncertainty(covariance, float(noise[0]), float(noise[1]), float(freedom.min()))


def half_widths(
    covariance: Float[np.ndarray, "k k"], freedom: float, confidence: float = 0.95
) -> Float[np.ndarray, " k"]:
    """Half the width of each unknown's interval: Student's, since few motions leave the noise level uncertain too."""
    return np.asarray(student.ppf(0.5 + confidence / 2, freedom) * np.sqrt(np.diag(covariance)))


def _by_inverse(X: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "6 6"]:
    """Errors of X from those of X^-1, to first order."""
    R, t = X[:3, :3], X[:3, 3]
    return np.block([[-R, np.zeros((3, 3))], [_skew(t) @ R, -R]])


def _skew(v: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3 3"]:
    return np.cross(v[..., None, :], -np.eye(3))
