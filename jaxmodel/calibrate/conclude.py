"""From a method's estimate to an answer with a verdict (host): the method's own where the motions determine it."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.observability import Observability, without_noise_rotations
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.search import Search
from jaxmodel.calibrate.verdict import judge, plainly_solved
from jaxmodel.geometry import se3
from jaxmodel.geometry.arrays import AnyArray


class Solved(eqx.Module):
    """What one problem's kernel returns."""

    estimate: Estimate
    angle: Float[AnyArray, " n"]
    distance: Float[AnyArray, " n"]
    weight: Float[AnyArray, " n"]
    rotation: Float[AnyArray, "9 9"]
    scatter_A: Float[AnyArray, "3 3"]
    scatter_B: Float[AnyArray, "3 3"]
    sound: Bool[AnyArray, ""]


def pair_residuals(
    A: Float[np.ndarray, "n 4 4"], B: Float[np.ndarray, "n 4 4"], X: Float[np.ndarray, "4 4"], scale: float = 1.0
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Angle (rad) and distance (unit of B) by which ``A X`` and ``X B`` differ, A's translations times ``scale``."""
    left, right = A.copy(), X @ B
    left[:, :3, 3] *= scale
    left = left @ X
    chord = np.linalg.norm((left - right)[:, :3, :3], axis=(1, 2)) / np.sqrt(8.0)
    angle = 2 * np.arcsin(np.clip(chord, 0.0, 1.0))
    return angle, np.linalg.norm((left - right)[:, :3, 3], axis=1)


def conclude(
    A: np.ndarray, B: np.ndarray, weights: np.ndarray, solved: Solved, unknown_scale: bool
) -> tuple[np.ndarray, float, Observability, bool]:
    """The verdict on one problem, and its X: the method's own where it has one, else that of the search."""
    X, scale = se3.compose(np.asarray(solved.estimate.R), np.asarray(solved.estimate.t)), float(solved.estimate.scale)
    angle, distance = np.asarray(solved.angle), np.asarray(solved.distance)
    squares = np.array([np.sum(weights * angle**2)])
    rotation, scatter_A = np.asarray(solved.rotation)[None], np.asarray(solved.scatter_A)[None]
    scatter_B = np.asarray(solved.scatter_B)[None]
    plain = bool(plainly_solved(rotation, scatter_A, scatter_B, squares, np.array([len(A)]))[0])
    plain &= np.isfinite(X).all() and (scale > 0 or unknown_scale)
    if plain:
        verdict = judge(A, B, X, scale, angle, distance, unknown_scale)
        if verdict.outcome is not Outcome.SCALE_TIED:
            return X, scale, verdict, False
    A_real, B_real = without_noise_rotations(A, B)
    search = Search(A_real, B_real, weights, unknown_scale)
    found_X, found_scale = search.best()
    found_angle, found_distance = pair_residuals(A, B, found_X, found_scale)
    verdict = judge(A_real, B_real, found_X, found_scale, found_angle, found_distance, unknown_scale, search)
    if verdict.outcome is Outcome.SCALE_TIED:
        # up to a common factor: the answer whose scale is 1, in the unit of A
        return Search(A_real, B_real, weights, False).best()[0], np.nan, verdict, True
    own = _cost(angle, distance, verdict)
    if verdict.outcome is Outcome.SOLVED and own <= 2 * _cost(found_angle, found_distance, verdict):
        return X, scale, verdict, False
    free = verdict.free_direction if verdict.outcome is not Outcome.ROTATION_ONLY else None
    if verdict.independent_axes == 0:
        found_X[:3, 3] = 0.0
    elif free is not None:
        found_X[:3, 3] -= free * (free @ found_X[:3, 3])
    return found_X, found_scale, verdict, True


def _cost(angle: np.ndarray, distance: np.ndarray, verdict: Observability) -> float:
    rotation, translation = max(verdict.rotation_noise, 1e-15), max(verdict.translation_noise, 1e-300)
    return float(np.sum((angle / rotation) ** 2) + np.sum((distance / translation) ** 2))
