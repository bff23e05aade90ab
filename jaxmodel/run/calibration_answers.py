"""Every method's answer to one hand-eye calibration, and what goes with the recommended one."""

from collections.abc import Callable
from dataclasses import dataclass, replace

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

ALL_POSES = "joint, all poses"
FEWEST_TO_NAME = SUBSET + 4
"""Poses from which on outliers are looked for: fewer cannot outvote a wrong one."""
MOST_OUTLIERS = 0.4
"""A larger share of poses that contradict the rest is no share of outliers."""


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

    ``kept`` are the poses that were used, ``outlier`` those that contradict the others, ``score`` their normalised
    squared residuals (NaN where not looked for);
    ``left_out`` the change of X (rotation vector, translation) when a pose of ``kept`` is left out, NaN elsewhere.
    ``rescaled``: joint once more with a free scale of the camera's lengths, to check them against the hand's.
    """

    setup: Setup
    motions: MotionPairs
    answers: list[Answer]
    recommended: Answer
    reason: str
    kept: Bool[np.ndarray, " n"]
    outlier: Bool[np.ndarray, " n"]
    score: Float[np.ndarray, " n"]
    left_out: Float[np.ndarray, "n 6"]
    bootstrap: Float[np.ndarray, "6 6"] | None
    rescaled: HandEye | None = None


def find_answers(config: Config, poses: PairedPoses, done: Callable[[str], None]) -> Answers:
    """Run the methods that ``config`` asks for on the poses that agree; ``done`` is told of each."""
    setup = Setup(config.setup)
    if config.scales in ("per-group", "per-motion"):
        return _separate_scales(config, poses, setup, done)
    unknown = config.scales == "one"
    motions = motion_pairs(chain(poses.hand, poses.camera, setup))
    n = len(poses.hand)
    kept, outlier, score = np.ones(n, bool), np.zeros(n, bool), np.full(n, np.nan)
    names = ["joint", *METHODS] if config.method == "all" else [config.method]
    answers, whole = [], None
    if "joint" in names:
        found = _calibrate("joint", config, poses, setup, kept)
        whole = _answer("joint", found, poses, motions, kept)
        done("joint")
        if whole.outcome.usable and n >= FEWEST_TO_NAME:
            metric = _metric(poses.camera, float(whole.scale[0]))
            outlier, score = _contradicting(config, poses.hand, metric, setup)
            if not config.keep_outliers and outlier.mean() <= MOST_OUTLIERS:
                kept = ~outlier
            done("outliers")
    for name in names:
        if unknown and name in KNOWN_SCALE_ONLY:
            continue
        if name == "joint" and whole is not None and kept.all():
            answers.append(whole)
            continue
        answers.append(_answer(name, _calibrate(name, config, poses, setup, kept), poses, motions, kept))
        done(name)
    if whole is not None and not kept.all():
        answers.insert(1, replace(whole, method=ALL_POSES))
    if unknown and config.method == "all":
        between = kept[motions.index].all(axis=1)
        found = self_calibrate(motions.A[between], motions.B[between])
        answers.append(_self_answer("self_calibration", found, setup, motions))
        done("self_calibration")
    chosen = answers[0]
    left_out, spread, rescaled = np.full((n, 6), np.nan), None, None
    if chosen.outcome.usable and chosen.method == "joint" and not unknown:
        rescaled = calibrate_poses(poses.hand[kept], poses.camera[kept], setup, unknown_scale=True, noise=config.noise)
    rows = np.flatnonzero(kept)
    if chosen.outcome.usable and len(rows) >= 5:
        hand, camera = poses.hand[rows], _metric(poses.camera[rows], float(chosen.scale[0]))
        left_out[rows] = leave_one_out(hand, camera, setup, chosen.method, config.noise).differences()
        done("leave one out")
        if config.bootstrap:
            import jax

            key = jax.random.key(config.seed)
            replicas = bootstrap(hand, camera, key, config.bootstrap, setup, chosen.method, config.noise)
            spread = replicas.covariance
            done("bootstrap")
    return Answers(
        setup, motions, answers, chosen, _reason(chosen, config, kept), kept, outlier, score, left_out, spread, rescaled
    )


def _calibrate(method: str, config: Config, poses: PairedPoses, setup: Setup, kept: np.ndarray) -> HandEye:
    unknown = config.scales == "one"
    hand, camera = poses.hand[kept], poses.camera[kept]
    return calibrate_poses(hand, camera, setup, method, unknown_scale=unknown, noise=config.noise)


def _contradicting(
    config: Config, hand: np.ndarray, camera: np.ndarray, setup: Setup
) -> tuple[Bool[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """The poses that contradict the others, and each pose's score; the camera's lengths are metric."""
    import jax

    found = consensus(hand, camera, jax.random.key(config.seed), setup, noise=config.noise)
    if not found.calibration.outcome.usable:
        return np.zeros(len(hand), bool), found.score
    return ~found.inlier, found.score


def _reason(answer: Answer, config: Config, kept: np.ndarray) -> str:
    if not answer.outcome.usable:
        return f"no method determines more: {answer.outcome.sentence}"
    if config.method not in ("all", "joint"):
        return f"{answer.method} is the only method that was asked for"
    words = "it uses each absolute pose once, where pairs of poses count it many times, and knows its own covariance"
    wrong = len(kept) - int(kept.sum())
    return words if not wrong else f"{words}; {wrong} of {len(kept)} poses contradict the others and are left out"


def _answer(name: str, found: HandEye, poses: PairedPoses, motions: MotionPairs, kept: np.ndarray) -> Answer:
    """An answer found from the poses ``kept``, measured on all of them."""
    influence = None
    if found.influence is not None:
        influence = np.full(len(kept), np.nan)
        influence[kept] = found.influence
    scale = 1.0 if np.isnan(found.scale) else found.scale
    return Answer(
        name,
        found.transforms,
        found.outcome,
        found.observability,
        np.array([found.scale]),
        np.array([found.scale_deviation]),
        *motion_residuals(motions, found.X, scale),
        *pose_residuals(poses.hand, poses.camera, found.setup, found.X, found.Z, scale),
        found.covariance,
        found.freedom,
        influence,
        found.steps,
    )


def _metric(camera: Float[np.ndarray, "n 4 4"], scale: float) -> Float[np.ndarray, "n 4 4"]:
    scaled = camera.copy()
    scaled[:, :3, 3] *= scale
    return scaled


def _self_answer(name: str, found: SelfCalibration, setup: Setup, motions: MotionPairs) -> Answer:
    X = se3.inverse(found.X)
    to, of = setup.x_name.removeprefix("T_").split("_")
    known = np.where(np.isnan(found.scale), 1.0, found.scale)
    of_motion = float(known[0]) if len(known) == 1 else known[found.group]
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
    return Answers(
        setup,
        motions,
        answers,
        answers[0],
        reason,
        np.ones(n, bool),
        np.zeros(n, bool),
        none,
        np.full((n, 6), np.nan),
        None,
    )
