"""Every method's answer to one hand-eye calibration, and what goes with the recommended one."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.calibrate.joint import Noise
from jaxmodel.calibrate.motions import MotionPairs, Setup, chain, motion_pairs
from jaxmodel.calibrate.observability import Observability
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.outliers import SUBSET, Consensus, consensus
from jaxmodel.calibrate.pose_residuals import camera_errors, depth_stands_out, motion_residuals, pose_residuals
from jaxmodel.calibrate.poses import HandEye, calibrate_poses
from jaxmodel.calibrate.resampling import bootstrap, leave_one_out
from jaxmodel.calibrate.self_calibration import Scales, SelfCalibration, self_calibrate
from jaxmodel.calibrate.solve import KNOWN_SCALE_ONLY, METHODS
from jaxmodel.calibrate.trust import FEWEST, Finding, Trust, other_scale, trust
from jaxmodel.geometry import se3
from jaxmodel.run.calibration.config import Config
from jaxmodel.run.calibration.paired_poses import PairedPoses
from jaxmodel.run.calibration.reason import reason_for

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
    weights: Float[np.ndarray, " n"] | None = None
    steps: int = 0


@dataclass(frozen=True)
class Answers:
    """All of them, the motions they are measured on, and which one is recommended for what reason.

    ``kept`` are the poses that were used, ``outlier`` those that contradict the others, ``score`` their normalised
    squared residuals (NaN where not looked for);
    ``left_out`` the change of X (rotation vector, translation) when a pose of ``kept`` is left out, NaN elsewhere.
    ``trust`` widens the covariance of ``joint`` by what the data show beyond its ``noise``; ``findings`` are its own,
    or, with too few poses for it, another scale of the camera's lengths.
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
    trust: Trust | None = None
    findings: tuple[Finding, ...] = ()
    noise: Noise = "camera"

    @property
    def covariance(self) -> Float[np.ndarray, "6 6"] | None:
        """That of the recommended answer, as it is to be stated."""
        return self.recommended.covariance if self.trust is None else self.trust.covariance


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
    noise: Noise = "camera" if config.noise == "auto" else config.noise
    every, answers = np.ones(n, bool), []
    if "joint" in names:
        first = _calibrate("joint", config, poses, setup, every, noise)
        done("joint")
        if first.outcome.usable and n >= FEWEST_TO_NAME:
            metric = _metric(poses.camera, first.scale)
            agreed = _agreement(config, poses.hand, metric, setup, noise)
            if agreed is not None:
                outlier, score = ~agreed.inlier, agreed.score
                if config.noise == "auto" and np.count_nonzero(agreed.inlier) >= FEWEST:
                    noise = _noise_seen(poses.hand, metric, setup, agreed)
            if not config.keep_outliers and config.loss == "none" and outlier.mean() <= MOST_OUTLIERS:
                kept = ~outlier
            done("outliers")
    solved: list[HandEye] = []
    for name in names:
        if unknown and name in KNOWN_SCALE_ONLY:
            continue
        solved.append(_calibrate(name, config, poses, setup, kept, noise))
        answers.append(_answer(name, solved[-1], poses, motions, kept))
        done(name)
    if not kept.all():
        answers.insert(
            1, _answer(ALL_POSES, _calibrate("joint", config, poses, setup, every, noise), poses, motions, every)
        )
    if unknown and config.method == "all":
        between = kept[motions.index].all(axis=1)
        found = self_calibrate(motions.A[between], motions.B[between])
        answers.append(_self_answer("self_calibration", found, setup, motions))
        done("self_calibration")
    chosen = answers[0]
    left_out, spread, looked, findings = np.full((n, 6), np.nan), None, None, ()
    rows = np.flatnonzero(kept)
    if chosen.outcome.usable and len(rows) >= 5:
        import jax

        key, hand, camera = jax.random.key(config.seed), poses.hand[rows], poses.camera[rows]
        metric = _metric(camera, float(chosen.scale[0]))
        options = setup, chosen.method, noise, solved[0].weights
        left_out[rows] = leave_one_out(hand, metric, *options).differences()
        done("leave one out")
        if config.bootstrap:
            spread = bootstrap(hand, metric, key, config.bootstrap, *options).covariance
            done("bootstrap")
        if chosen.covariance is not None and len(rows) >= FEWEST:
            looked = trust(hand, camera, solved[0], key, noise, unknown, config.loss)
            findings = looked.findings
            done("trust")
        elif chosen.covariance is not None and not unknown:
            findings = tuple(other_scale(hand, camera, solved[0], noise, loss=config.loss))
    found = Answers(
        setup, motions, answers, chosen, "", kept, outlier, score, left_out, spread, looked, findings, noise
    )
    return replace(found, reason=reason_for(found, config))


def _calibrate(
    method: str, config: Config, poses: PairedPoses, setup: Setup, kept: np.ndarray, noise: Noise
) -> HandEye:
    unknown = config.scales == "one"
    hand, camera = poses.hand[kept], poses.camera[kept]
    return calibrate_poses(hand, camera, setup, method, unknown_scale=unknown, noise=noise, loss=config.loss)


def _agreement(config: Config, hand: np.ndarray, camera: np.ndarray, setup: Setup, noise: Noise) -> Consensus | None:
    """Which poses agree, the camera's lengths being metric; nothing where those that do leave something open."""
    import jax

    found = consensus(hand, camera, jax.random.key(config.seed), setup, noise=noise)
    return found if found.calibration.outcome.usable else None


def _noise_seen(hand: np.ndarray, camera: np.ndarray, setup: Setup, agreed: Consensus) -> Noise:
    """Whether the camera's error along its line of sight is another than across it."""
    streams = chain(hand[agreed.inlier], camera[agreed.inlier], setup)
    errors = camera_errors(streams, agreed.calibration.X, agreed.calibration.Z)
    return "depth" if depth_stands_out(errors) else "camera"


def _answer(name: str, found: HandEye, poses: PairedPoses, motions: MotionPairs, kept: np.ndarray) -> Answer:
    """An answer found from the poses ``kept``, measured on all of them."""
    influence, weights = (
        None if values is None else _spread_out(values, kept) for values in (found.influence, found.weights)
    )
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
        weights,
        found.steps,
    )


def _spread_out(values: Float[np.ndarray, " k"], kept: Bool[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    result = np.full(len(kept), np.nan)
    result[kept] = values
    return result


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
