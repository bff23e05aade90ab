"""Hand-eye self-calibration: camera translations known up to one scale, one for each group, or one for each motion.

RR-3507 ch. 4: without a target, camera motions come from a reconstruction whose unit is arbitrary. The hand's
translations bring the metre: a motion that turns about a fixed point brings none, and then scale and translation are
tied (eqs 4.1 - 4.4).
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.conclude import pair_residuals
from jaxmodel.calibrate.observability import NoiseLevel, noise_level, only_noise_rotations, stands_out
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.rigid import checked_motions
from jaxmodel.calibrate.solve import solve
from jaxmodel.errors import InputError

INFORMATION_RATIO = 1e-14


class Scales(Enum):
    """How many unknown scales there are."""

    COMMON = "common"
    GROUPS = "groups"
    MOTIONS = "motions"


@dataclass(frozen=True)
class SelfCalibration:
    """X of AX = XB (A camera, B hand) in the unit of B, and the scale of each group of motions.

    ``scale[g]`` times the given translation is metric; NaN where ``determined[g]`` is False. ``group`` is the group of
    each motion. ``scale_deviation`` is the standard deviation of each scale from the residuals. Residuals: rad, unit
    of B. Where ``outcome`` is SCALE_TIED the translation of X is in the unit of the first group of A.
    """

    X: Float[np.ndarray, "4 4"]
    scale: Float[np.ndarray, " g"]
    scale_deviation: Float[np.ndarray, " g"]
    determined: Bool[np.ndarray, " g"]
    group: Int[np.ndarray, " n"]
    outcome: Outcome
    rotation_residuals: Float[np.ndarray, " n"]
    translation_residuals: Float[np.ndarray, " n"]


def self_calibrate(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "m 4 4"],
    scales: Scales = Scales.COMMON,
    group: Int[np.ndarray, " k"] | None = None,
    refine: bool = True,
) -> SelfCalibration:
    """Rotation, translation and scales from camera motions A of unknown scale and hand motions B.

    The rotation needs no scale (eq. 3.13); translation and scales follow by linear least squares (eq. 4.3 for one
    scale, eq. 4.4 for one each, blocks of it for groups), then ``refine`` brings all to least squares together. A
    separate scale for a pure translation is found, but helps nothing else; within each group some rotating motion must
    carry its own translation. Raises :class:`InputError` for bad rows, or groups that are absent or not wanted.
    """
    A, B = checked_motions(A, "A"), checked_motions(B, "B")
    n = len(A)
    if len(B) != n:
        raise InputError(f"A and B must hold one motion each per row, but A has {n} rows and B has {len(B)}.")
    if (group is not None) != (scales is Scales.GROUPS):
        raise InputError("group names each motion's group; it is needed for scales='groups', and for nothing else.")
    if scales is Scales.COMMON:
        index = np.zeros(n, int)
    elif scales is Scales.MOTIONS:
        index = np.arange(n)
    else:
        index = np.unique(np.asarray(group), return_inverse=True)[1].reshape(-1)
        if len(index) != n:
            raise InputError(f"group must name the group of each of the {n} motions, but it has {len(index)} entries.")
    first = solve(A, B, "linear", unknown_scale=scales is Scales.COMMON)
    settled = first.outcome in (Outcome.SOLVED, Outcome.SCALE_TIED)
    if not settled and (scales is Scales.COMMON or first.observability.independent_axes < 2):
        count = int(index.max(initial=-1)) + 1
        unknown = np.full(count, np.nan)
        return SelfCalibration(
            first.X,
            np.full(count, first.scale) if scales is Scales.COMMON else unknown,
            unknown,
            np.zeros(count, bool),
            index,
            first.outcome,
            first.rotation_residuals,
            first.translation_residuals,
        )
    return _solve_groups(A, B, first.X[:3, :3], index, refine)


def scale_system(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "n 4 4"],
    R: Float[np.ndarray, "3 3"],
    index: Int[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "m u"], Float[np.ndarray, " m"]]:
    """The system of eq. 4.3 / 4.4: ``[R_A - I, t_A] (t_X, scale of its group) = R_X t_B``; ``index`` is the group."""
    n, count = len(A), int(index.max(initial=-1)) + 1
    left = np.zeros((n, 3, 3 + count))
    left[:, :, :3] = A[:, :3, :3] - np.eye(3)
    left[np.arange(n), :, 3 + index] = A[:, :3, 3]
    return left.reshape(3 * n, -1), (B[:, :3, 3] @ R.T).reshape(-1)


def _solve_groups(A: np.ndarray, B: np.ndarray, R: np.ndarray, index: np.ndarray, refine: bool) -> SelfCalibration:
    n, count = len(A), int(index.max(initial=-1)) + 1
    left, right = scale_system(A, B, R, index)
    # columns of unlike units: scaled before the rank is looked at
    size = _column_sizes(left)
    solution = np.linalg.lstsq(left / size, right, rcond=1e-12)[0] / size
    if refine:
        R, solution = _refine(A, B, R, solution, index)
        left, right = scale_system(A, B, R, index)
        size = _column_sizes(left)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, solution[:3]
    scale = solution[3:]
    scaled = A.copy()
    scaled[:, :3, 3] *= scale[index][:, None]
    angle, distance = pair_residuals(scaled, B, X)
    reach = float(np.sqrt(np.sum(X[:3, 3] ** 2) + np.max(np.sum(B[:, :3, 3] ** 2, axis=1))))
    noise = noise_level(angle, distance, reach, unknowns=min(3 + count, 3 * n - 1))
    # a group of pure translations says nothing but its own scale (the rank that eq. 4.4 misses): the others are looked
    # at without it
    turning = np.zeros(count, bool)
    turning[index[~only_noise_rotations(A, B)]] = True
    tied = _tied(A[turning[index]], B[turning[index]], R, noise)
    deviation = np.sqrt(noise.translation * np.diag(np.linalg.pinv((left / size).T @ (left / size), rcond=1e-12)))
    deviation = deviation[3:] / size[3:]
    _, values, V = np.linalg.svd(left / size)
    loose = np.abs(V[np.append(values, np.zeros(len(V) - len(values))) < 1e-7 * values[0]]).max(axis=0, initial=0.0)
    known = (loose[3:] < 1e-6) & (scale > 0) & (deviation < 0.5 * np.abs(scale))
    determined = known & ~(turning & tied)
    if tied:
        # the null vector of eq. 4.3 / 4.4, scaled to a first scale of 1
        columns = np.append(np.arange(3), 3 + np.flatnonzero(turning))
        null = np.linalg.svd((left / size)[:, columns])[2][-1] / size[columns]
        X[:3, 3] = null[:3] / null[3] if null[3] != 0 else np.nan
    whole = not tied and loose[:3].max() < 1e-6 and determined.any()
    outcome = Outcome.SOLVED if whole else Outcome.SCALE_TIED
    scale, deviation = (np.where(determined, values, np.nan) for values in (scale, deviation))
    return SelfCalibration(X, scale, deviation, determined, index, outcome, angle, distance)


def _column_sizes(matrix: Float[np.ndarray, "m u"]) -> Float[np.ndarray, " u"]:
    size = np.linalg.norm(matrix, axis=0)
    return np.where(size > 0, size, 1.0)


def _tied(A: np.ndarray, B: np.ndarray, R: np.ndarray, noise: NoiseLevel) -> bool:
    """Whether the hand only turned about one fixed point, so that eq. 4.1 is homogeneous in translation and scales.

    What the hand itself says is R_X t_B, less what a shift of its centre of turning explains.
    """
    own, whole = _hand_information(A, B, R)
    return not stands_out(own - INFORMATION_RATIO * whole, 3 * len(A) - 3, noise.translation, noise.freedom)


def _hand_information(A: np.ndarray, B: np.ndarray, R: np.ndarray) -> tuple[float, float]:
    """``sum |R_X t_B|^2`` once a fixed point that the hand turns about has taken its share, and before."""
    column = (B[:, :3, 3] @ R.T).reshape(-1)
    others = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    rest = column - others @ np.linalg.lstsq(others, column, rcond=1e-7)[0]
    return float(rest @ rest), float(column @ column)


def _refine(
    A: np.ndarray, B: np.ndarray, R: np.ndarray, solution: np.ndarray, index: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Newton over rotation, translation and all scales, rotation and translation weighted by their residuals."""
    eye = np.eye(3)
    basis = np.swapaxes(np.cross(eye[:, None, :], eye[None, :, :]), 1, 2)  # basis[c] @ v = e_c x v
    for _ in range(10):
        turned = R @ B[:, :3, :3] @ R.T
        rotation = (A[:, :3, :3] - turned).reshape(-1) / np.sqrt(2)
        change = np.einsum("cij,njk->nikc", basis, turned) - np.einsum("nij,cjk->nikc", turned, basis)
        left, right = scale_system(A, B, R, index)
        translation = left @ solution - right
        moved = B[:, :3, 3] @ R.T
        by_turn = np.stack([np.cross(moved, axis) for axis in eye], axis=2).reshape(-1, 3)
        freedom = max(3 * len(A) - 3, 1)
        weights = [1 / np.sqrt(np.sum(r**2) / freedom + 1e-24) for r in (rotation, translation)]
        J = np.concatenate(
            [
                np.concatenate([-change.reshape(-1, 3) / np.sqrt(2), np.zeros((len(rotation), len(solution)))], axis=1)
                * weights[0],
                np.concatenate([by_turn, left], axis=1) * weights[1],
            ]
        )
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        residual = np.concatenate([rotation * weights[0], translation * weights[1]])
        delta = np.linalg.lstsq(J / size, -residual, rcond=1e-10)[0] / size
        R = Rotation.from_rotvec(delta[:3]).as_matrix() @ R
        solution = solution + delta[3:]
        if np.linalg.norm(delta[:3]) < 1e-13:
            break
    return R, solution
