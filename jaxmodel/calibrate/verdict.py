"""The verdict on one set of motions and one solution: what is determined, what is free, which other answers exist."""

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.calibrate.observability import (
    Axes,
    NoiseLevel,
    Observability,
    flips,
    linear_ranks,
    noise_level,
    rotation_axes,
    scale_information,
    stands_out,
    turn_information,
)
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.search import Search
from jaxmodel.geometry import se3

SAME_ANSWER_RAD = 1e-3
INFORMATION_RATIO = 1e-14  # as for the axes: below it exact data are called deficient


def judge(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "n 4 4"],
    X: Float[np.ndarray, "4 4"],
    scale: float,
    angle: Float[np.ndarray, " n"],
    distance: Float[np.ndarray, " n"],
    unknown_scale: bool,
    search: Search | None = None,
) -> Observability:
    """The verdict at a solution X with its residual angles (rad) and distances (unit of B).

    ``search`` looks for other answers; without it none is reported.
    """
    R = X[:3, :3]
    moved_B = B[:, :3, 3] @ R.T
    reach = float(np.sqrt(np.sum(X[:3, 3] ** 2) + np.max(np.sum(moved_B**2, axis=1), initial=0.0)))
    noise = noise_level(angle, distance, reach)
    axes = rotation_axes(A, B, R, noise)
    outcome, free_direction, free_axis = _case(A, moved_B, axes, noise, unknown_scale)
    if outcome in (Outcome.SOLVED, Outcome.SCALE_TIED) and unknown_scale:
        value, whole = scale_information(A, scale)
        value = max(value - INFORMATION_RATIO * whole, 0.0)
        tied = not stands_out(value, 3 * len(A) - 3, noise.translation, noise.freedom)
        outcome = Outcome.SCALE_TIED if tied else Outcome.SOLVED
    alternatives = np.zeros((0, 4, 4))
    if search is not None and outcome in (Outcome.SOLVED, Outcome.TRANSLATION_ALONG_AXIS, Outcome.ROTATION_ONLY):
        alternatives = _other_answers(A, X, moved_B, axes, noise, angle, distance, search)
        if len(alternatives):
            outcome = Outcome.SEVERAL_ANSWERS
    return Observability(
        outcome,
        axes.count,
        free_direction,
        free_axis,
        alternatives,
        linear_ranks(A, B, noise),
        float(np.sqrt(noise.rotation)),
        float(np.sqrt(noise.translation)),
    )


def _case(
    A: np.ndarray, moved_B: np.ndarray, axes: Axes, noise: NoiseLevel, unknown_scale: bool
) -> tuple[Outcome, np.ndarray | None, np.ndarray | None]:
    n = len(A)
    if axes.count == 2:
        return Outcome.SOLVED, None, None
    if axes.count == 1:
        value, whole = turn_information(A, moved_B, axes.main, unknown_scale)
        value = max(value - INFORMATION_RATIO * whole, 0.0)
        if stands_out(value, 2 * n - 2, noise.translation, noise.freedom):
            return Outcome.TRANSLATION_ALONG_AXIS, axes.main, None
        return Outcome.ROTATION_ABOUT_AXIS, axes.main, axes.main
    # no rotation: the directions of the translations are all there is
    scatter = np.sum(moved_B**2) * np.eye(3) - moved_B.T @ moved_B
    values, vectors = np.linalg.eigh(scatter)
    if not stands_out(float(values[2]), 3 * n, noise.translation, noise.freedom):
        return Outcome.NO_MOTION, None, None
    least = max(float(values[0]) - INFORMATION_RATIO * float(values[2]), 0.0)
    if stands_out(least, 2 * n, noise.translation, noise.freedom):
        return Outcome.ROTATION_ONLY, None, None
    return Outcome.ROTATION_ABOUT_AXIS, None, vectors[:, 0]


def _other_answers(
    A: np.ndarray,
    X: np.ndarray,
    moved_B: np.ndarray,
    axes: Axes,
    noise: NoiseLevel,
    angle: np.ndarray,
    distance: np.ndarray,
    search: Search,
) -> np.ndarray:
    """The ends of descents from the half turns of X that fit as well as X itself, each once."""
    ends = search.from_starts(flips(A, moved_B, axes) @ X[:3, :3])
    kept: list[np.ndarray] = []
    for end, cost, rotation, translation in zip(
        ends.X(), ends.cost, ends.rotation_squares, ends.translation_squares, strict=True
    ):
        if not np.isfinite(cost):
            continue
        worse = stands_out(rotation - float(np.sum(angle**2)), 3, noise.rotation, noise.freedom)
        worse |= stands_out(translation - float(np.sum(distance**2)), 3, noise.translation, noise.freedom)
        known = [X, *kept]
        apart = [np.radians(se3.rotation_angle_deg(end[:3, :3] @ other[:3, :3].T)) for other in known]
        if not worse and min(apart) > max(SAME_ANSWER_RAD, 10 * np.sqrt(noise.rotation)):
            kept.append(end)
    return np.stack(kept) if kept else np.zeros((0, 4, 4))


def plainly_solved(
    sums_rotation: Float[np.ndarray, "b 9 9"],
    scatter_A: Float[np.ndarray, "b 3 3"],
    scatter_B: Float[np.ndarray, "b 3 3"],
    rotation_squares: Float[np.ndarray, " b"],
    count: Int[np.ndarray, " b"],
) -> np.ndarray:
    """For many problems at once: those whose rotation block has one null vector and whose axes plainly differ.

    What is left needs ``judge``. The margins are those of the largest F limits, so nothing doubtful passes.
    """
    freedom = np.maximum(3 * count - 3, 1)
    variance = rotation_squares / freedom + (4 * np.finfo(np.float64).eps) ** 2
    margin = np.where(count > 4, 10.0, 100.0)
    plain = np.isfinite(rotation_squares)
    for scatter in (scatter_A, scatter_B):
        values = np.linalg.eigvalsh(np.where(plain[:, None, None], scatter, 0.0))
        plain &= values[:, 0] > margin * 2 * count * variance
        plain &= values[:, 0] > 1e-6 * values[:, 2]
    values = np.linalg.eigvalsh(np.where(plain[:, None, None], sums_rotation, 0.0))
    plain &= values[:, 1] > margin * 4 * count * variance
    return plain & (values[:, 1] > 1e-6 * values[:, 8])
