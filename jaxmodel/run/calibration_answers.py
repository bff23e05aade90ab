"""Every method's answer to one hand-eye calibration, and what goes with the recommended one."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.calibrate.motions import MotionPairs, Setup, chain, motion_pairs
from jaxmodel.calibrate.observability import Observability
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.outliers import SUBSET, consensus
from jaxmodel.calibrate.pose_residuals import motion_residuals, pose_residuals
from jaxmodel.calibrate.poses import HandEye, calibrate_poses
from jaxmodel.calibrate.resampling import bootstrap, leave_one_out
from jaxmodel.calibrate.self_calibration import Scales, SelfCalibration, self_calibrate
from jaxmodel.calibrate.solve import KNOWN_SCALE_ONLY, METHODS
from jaxmodel.geometry import se3
from jaxmodel.run.calibration_config import Config
from jaxmodel.run.paired_poses import PairedPoses

ROBUST = "joint, inliers"
FEWEST_TO_NAME = SUBSET + 4
"""Poses from which on outliers are looked for: fewer cannot outvote a wrong one."""


@dataclass(frozen=True)
class Answer:
    """One method's answer, by the names of its frames; residuals in rad and metre, of all poses and all motions.

    ``scale``: one for each group of motions (a single one unless there are groups); ``scale_deviation`` its standard
    deviation where it is known. Without a target's place (separate scales) there are no residuals of poses.
    """

    method: str
    transforms: dict[str, Float[np.ndarray, "4 4"]]
    outcome: Outcome
    observability: Observability | None
    scale: Float[np.ndarray, " g"]
    scale_deviation: Float[np.ndarray, " g"]
    pair_rotation: Float[np.ndarray, " m"]
    pair_translation: Float[np.ndarray, " m"]
    pose_rotation: Float[np.ndarray, " n"]
    pose_translation: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "6 6"] | None = None
    freedom: float = float("nan")
    influence: Float[np.ndarray, " n"] | None = None
    steps: int = 0


@dataclass(frozen=True)
class Answers:
    """All of them, the motions they are measured on, and which one is recommended for what reason.

    ``kept`` are the poses that agree, ``score`` their normalised squared residuals (NaN where not looked for);
    ``left_out`` the change of X (rotation vector, translation) when a pose of ``kept`` is left out, NaN elsewhere.
    """

    setup: Setup
    motions: MotionPairs
    answers: list[Answer]
    recommended: Answer
    reason: str
    kept: Bool[np.ndarray, " n"]
    score: Float[np.ndarray, " n"]
    left_out: Float[np.ndarray, "n 6"]
    bootstrap: Float[np.ndarray, "6 6"] | None


def find_answers(config: Config, poses: PairedPoses, done: Callable[[str], None]) -> Answers:
    """Run the methods that ``config`` asks for; ``done`` is told of each."""
    setup = Setup(config.setup)
    if config.scales in ("per-group", "per-motion"):
        return _separate_scales(config, poses, setup, done)
    unknown = config.scales == "one"
    motions = motion_pairs(chain(poses.hand, poses.camera, setup))
    names = ["joint", *METHODS] if config.method == "all" else [config.method]
    answers = []
    for name in names:
        if unknown and name in KNOWN_SCALE_ONLY:
            continue
        found = calibrate_poses(
            poses.hand, poses.camera, setup, name, unknown_scale=unknown, noise=config.noise
        )  # fmt: skip
        answers.append(_answer(name, found, poses, motions))
        done(name)
    if unknown and config.method == "all":
        answers.append(_self_answer("self_calibration", self_calibrate(motions.A, motions.B), setup, motions))
        done("self_calibration")
    n, none = len(poses.hand), np.full(len(poses.hand), np.nan)
    chosen, reason = answers[0], _reason(answers[0], config)
    kept, score = np.ones(n, bool), none
    if config.method in ("all", "joint") and chosen.outcome.usable and n >= FEWEST_TO_NAME:
        kept, score, robust = _without_outliers(config, poses, setup, chosen, motions)
        done("outliers")
        if robust is not None:
            answers.insert(1, robust)
            chosen = robust
            reason = f"{n - int(kept.sum())} of {n} poses contradict the others; without them, {reason}"
    left_out, spread = np.full((n, 6), np.nan), None
    rows = np.flatnonzero(kept)
    if chosen.outcome.usable and len(rows) >= 5:
        hand, camera = poses.hand[rows], _metric(poses.camera[rows], float(chosen.scale[0]))
        method = "joint" if chosen.method == ROBUST else chosen.method
        left_out[rows] = leave_one_out(hand, camera, setup, method, config.noise).differences()
        done("leave one out")
        if config.bootstrap:
            import jax

            key = jax.random.key(config.seed)
            spread = bootstrap(hand, camera, key, config.bootstrap, setup, method, config.noise).covariance
            done("bootstrap")
    return Answers(setup, motions, answers, chosen, reason, kept, score, left_out, spread)


def _reason(answer: Answer, config: Config) -> str:
    if not answer.outcome.usable:
        return f"no method determines more: {answer.outcome.sentence}"
    if config.method not in ("all", "joint"):
        return f"{answer.method} is the only method that was asked for"
    return "joint uses each absolute pose once, where pairs of poses count it many times, and knows its own covariance"


def _answer(name: str, found: HandEye, poses: PairedPoses, motions: MotionPairs) -> Answer:
    scale = 1.0 if np.isnan(found.scale) else found.scale
    return Answer(
        name,
        found.transforms,
        found.outcome,
        found.observability,
        np.array([found.scale]),
        np.array([np.nan]),
        *motion_residuals(motions, found.X, scale),
        *pose_residuals(poses.hand, poses.camera, found.setup, found.X, found.Z, scale),
        found.covariance,
        found.freedom,
        found.influence,
        found.steps,
    )


def _without_outliers(
    config: Config, poses: PairedPoses, setup: Setup, first: Answer, motions: MotionPairs
) -> tuple[np.ndarray, np.ndarray, Answer | None]:
    """The poses that agree, each pose's score, and the joint answer of those that agree where that is not all."""
    import jax

    scale = float(first.scale[0])
    metric = _metric(poses.camera, scale)
    found = consensus(poses.hand, metric, jax.random.key(config.seed), setup, noise=config.noise)
    if found.inlier.all() or not found.calibration.outcome.usable:
        return np.ones(len(metric), bool), found.score, None
    rows = np.flatnonzero(found.inlier)
    calibration: Any = found.calibration
    if config.scales == "one":
        calibration = calibrate_poses(
            poses.hand[rows], poses.camera[rows], setup, unknown_scale=True, noise=config.noise
        )  # fmt: skip
    answer = _answer(ROBUST, calibration, poses, motions)
    influence = np.full(len(metric), np.nan)
    if answer.influence is not None:
        influence[rows] = answer.influence
    return found.inlier, found.score, replace(answer, influence=influence)


def _metric(camera: Float[np.ndarray, "n 4 4"], scale: float) -> Float[np.ndarray, "n 4 4"]:
    scaled = camera.copy()
    scaled[:, :3, 3] *= scale
    return scaled


def _self_answer(name: str, found: SelfCalibration, setup: Setup, motions: MotionPairs) -> Answer:
    X = se3.inverse(found.X)
    to, of = setup.x_name.removeprefix("T_").split("_")
    of_motion = np.where(np.isnan(found.scale), 1.0, found.scale)[found.group]
    none = np.zeros(0)
    transforms = {setup.x_name: X, f"T_{of}_{to}": found.X}
    residuals = motion_residuals(motions, X, of_motion)
    return Answer(name, transforms, found.outcome, None, found.scale, found.scale_deviation, *residuals, none, none)


def _separate_scales(config: Config, poses: PairedPoses, setup: Setup, done: Callable[[str], None]) -> Answers:
    """One scale for each group of poses, or for each motion between neighbours."""
    streams = chain(poses.hand, poses.camera, setup)
    motions = motion_pairs(streams, "all" if config.scales == "per-group" else "consecutive")
    group: Int[np.ndarray, " m"] | None = None
    scales = Scales.MOTIONS
    if config.scales == "per-group":
        assert poses.groups is not None
        number = np.unique(poses.groups, return_inverse=True)[1]
        inside = number[motions.index[:, 0]] == number[motions.index[:, 1]]
        motions = MotionPairs(motions.A[inside], motions.B[inside], motions.index[inside])
        group, scales = number[motions.index[:, 0]], Scales.GROUPS
    answers = []
    for name, refine in (("refined", True), ("linear", False)):
        found = self_calibrate(motions.A, motions.B, scales, group, refine)
        answers.append(_self_answer(name, found, setup, motions))
        done(name)
    n = len(poses.hand)
    none = np.full(n, np.nan)
    reason = "refined brings the rotation, the translation and all scales to least squares together"
    if not answers[0].outcome.usable:
        reason = f"no method determines more: {answers[0].outcome.sentence}"
    return Answers(setup, motions, answers, answers[0], reason, np.ones(n, bool), none, np.full((n, 6), np.nan), None)
