"""Hand-eye calibration from absolute poses: named by frames, with covariance; ``joint`` is the recommended answer."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.calibrate.joint import JointSolution, Noise, Pose, Poses, kernel, target_from
from jaxmodel.calibrate.loss import Loss, checked_loss
from jaxmodel.calibrate.motions import Chain, PairChoice, Setup, chain, motion_pairs
from jaxmodel.calibrate.observability import Observability
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.rigid import checked_motions
from jaxmodel.calibrate.solve import METHODS, Calibration, solve, solve_many
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.geometry.masked import pad_rows, size_class


@dataclass(frozen=True)
class HandEye:
    """Both unknowns of a set-up, each by its frames' names.

    ``transforms``: ``T_hand_camera`` and ``T_base_target`` (camera on the hand), or ``T_base_camera`` and
    ``T_hand_target`` (camera fixed), with their inverses; metric, in the unit of the hand's poses. ``scale`` times the
    camera's translations is metric; ``scale_deviation`` is its standard deviation (``joint``, scale unknown).
    ``covariance`` of X (the first of them) is that of ``(rotation, translation)``
    errors ``R <- exp(d) R`` (rad), ``t <- t + e``; only ``joint`` has one, with ``freedom`` degrees of freedom. One
    residual for each pose (``joint``) or each motion (the other methods): rad and unit of the hand. ``weights``: of
    each pose, those given times those of a robust loss. ``rotation_noise`` (rad), ``translation_noise`` and
    ``depth_noise``: as ``JointSolution`` has them, metric.
    """

    setup: Setup
    method: str
    transforms: dict[str, Float[np.ndarray, "4 4"]]
    scale: float
    outcome: Outcome
    observability: Observability
    rotation_residuals: Float[np.ndarray, " m"]
    translation_residuals: Float[np.ndarray, " m"]
    covariance: Float[np.ndarray, "6 6"] | None = None
    freedom: float = float("nan")
    influence: Float[np.ndarray, " n"] | None = None
    weights: Float[np.ndarray, " n"] | None = None
    steps: int = 0
    rotation_noise: float = float("nan")
    translation_noise: float = float("nan")
    depth_noise: float = float("nan")
    scale_deviation: float = float("nan")

    @property
    def X(self) -> Float[np.ndarray, "4 4"]:
        """The camera's place: T_hand_camera, or T_base_camera for a fixed camera."""
        return self.transforms[self.setup.x_name]

    @property
    def Z(self) -> Float[np.ndarray, "4 4"]:
        """The target's place: T_base_target, or T_hand_target for a fixed camera."""
        return self.transforms[self.setup.z_name]


def calibrate_poses(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "m 4 4"],
    setup: Setup = Setup.EYE_IN_HAND,
    method: str = "joint",
    pairs: PairChoice = "all",
    unknown_scale: bool = False,
    noise: Noise = "camera",
    weights: Float[np.ndarray, " k"] | None = None,
    loss: str = "none",
) -> HandEye:
    """Calibrate from paired absolute poses: ``hand`` T_base_hand, ``camera`` as ``setup`` says; at least two.

    ``method="joint"`` refines both unknowns from all poses; ``noise`` names the stream that carries the noise. Any
    method of ``solve`` works on ``pairs`` of poses instead. ``weights`` are those of the poses, and a pair weighs the
    product of its two; a robust ``loss`` weighs the poses by what ``joint`` leaves of each, whatever the method, since
    a wrong pose spoils every pair that it is in. Raises :class:`InputError` for bad rows, unequal lengths
    and fewer than two poses; motions that leave something open give a partial answer with its verdict.
    """
    hand, camera = checked_motions(hand, "hand"), checked_motions(camera, "camera")
    poses = chain(hand, camera, setup)
    if len(hand) < 2:
        raise InputError(f"{len(hand)} pose gives no motion; at least 2 are needed, 3 for a whole answer.")
    if method != "joint" and method not in METHODS:
        raise InputError(f"method must be one of joint, {', '.join(METHODS)}, not {method!r}.")
    weights = np.ones(len(hand)) if weights is None else np.asarray(weights, np.float64)
    if weights.shape != (len(hand),) or not np.isfinite(weights).all() or (weights < 0).any():
        raise InputError(f"weights must be {len(hand)} finite numbers >= 0, one for each pose.")
    kind = checked_loss(loss)
    motions = motion_pairs(poses, pairs)

    def on_pairs(method: str, weights: np.ndarray) -> Calibration:
        pair_weights = weights[motions.index[:, 0]] * weights[motions.index[:, 1]]
        return solve(motions.A, motions.B, method, unknown_scale, pair_weights)

    first = on_pairs("linear" if method == "joint" else method, weights)
    if (method == "joint" or loss != "none") and first.outcome in (Outcome.SOLVED, Outcome.SEVERAL_ANSWERS):
        joint = _joint(poses, weights, setup, first, noise, unknown_scale, kind)
        if method == "joint":
            return joint
        assert joint.weights is not None
        weights = joint.weights
        first = on_pairs(method, weights)
    scale = 1.0 if np.isnan(first.scale) else first.scale
    X = se3.inverse(first.X)
    Z = _target(poses, weights, X, scale)
    return HandEye(
        setup,
        method if method != "joint" else first.method,
        named(setup, X, Z),
        first.scale,
        first.outcome,
        first.observability,
        first.rotation_residuals,
        first.translation_residuals,
        weights=weights,
        steps=first.steps,
    )


def joint_many(
    hand: Float[np.ndarray, "b n 4 4"],
    camera: Float[np.ndarray, "b n 4 4"],
    mask: Bool[np.ndarray, "b n"] | None = None,
    setup: Setup = Setup.EYE_IN_HAND,
    noise: Noise = "camera",
    unknown_scale: bool = False,
    start: Float[np.ndarray, "b 4 4"] | None = None,
    loss: str = "none",
) -> JointSolution:
    """``joint`` for a batch of problems, as NumPy arrays with a leading batch axis; no verdict is made.

    Without ``start`` (X of the set-up) each problem begins at the linear solution of all its pairs.
    """
    b, n = hand.shape[:2]
    mask = np.ones((b, n), bool) if mask is None else mask
    poses = chain(hand.reshape(-1, 4, 4), camera.reshape(-1, 4, 4), setup)
    poses = Chain(poses.H.reshape(b, n, 4, 4), poses.C.reshape(b, n, 4, 4))
    if start is None:
        i, j = np.triu_indices(n, 1)
        A = poses.C[:, j] @ se3.inverse(poses.C[:, i])
        B = se3.inverse(poses.H[:, j]) @ poses.H[:, i]
        found = solve_many(A, B, mask[:, i] & mask[:, j], unknown_scale=unknown_scale, verdict=False)
        start, scale = se3.inverse(found.X), found.scale
    else:
        scale = np.ones(b)
    return _run(poses, mask.astype(np.float64), start, scale, noise, unknown_scale, checked_loss(loss))


def joint_weighted(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "n 4 4"],
    weights: Float[np.ndarray, "k n"],
    setup: Setup = Setup.EYE_IN_HAND,
    noise: Noise = "camera",
    loss: Loss = "none",
) -> Float[np.ndarray, "k 4 4"]:
    """X by ``joint`` for each row of weights of the same poses, all from the linear solution of all of them."""
    poses = chain(hand, camera, setup)
    motions = motion_pairs(poses)
    start = se3.inverse(solve(motions.A, motions.B).X)
    k = len(weights)
    every = Chain(np.broadcast_to(poses.H, (k, *poses.H.shape)), np.broadcast_to(poses.C, (k, *poses.C.shape)))
    found = _run(every, weights, np.broadcast_to(start, (k, 4, 4)), np.ones(k), noise, False, loss)
    return se3.compose(np.asarray(found.X.R), np.asarray(found.X.t))


def named(
    setup: Setup, X: Float[np.ndarray, "4 4"], Z: Float[np.ndarray, "4 4"]
) -> dict[str, Float[np.ndarray, "4 4"]]:
    """Both unknowns and their inverses under their frames' names."""
    result = {}
    for name, T in ((setup.x_name, X), (setup.z_name, Z)):
        to, of = name.removeprefix("T_").split("_")
        result[name], result[f"T_{of}_{to}"] = T, se3.inverse(T)
    return result


def _joint(
    poses: Chain, weights: np.ndarray, setup: Setup, first: Calibration, noise: Noise, unknown_scale: bool, loss: Loss
) -> HandEye:
    length = size_class(len(poses.H), smallest=16)
    identity = np.broadcast_to(np.eye(4), (length - len(poses.H), 4, 4))
    padded = Chain(np.concatenate([poses.H, identity]), np.concatenate([poses.C, identity]))
    solution = _run(
        Chain(padded.H[None], padded.C[None]),
        pad_rows(weights, length)[None],
        se3.inverse(first.X)[None],
        np.array([first.scale]),
        noise,
        unknown_scale,
        loss,
    )
    n = len(poses.H)
    outcome = first.outcome
    if outcome is Outcome.SOLVED and not solution.converged[0]:
        outcome = Outcome.NOT_CONVERGED
    X, Z = (se3.compose(pose.R[0], pose.t[0]) for pose in (solution.X, solution.Z))
    metric = 1.0 if noise == "hand" else float(solution.scale[0])
    return HandEye(
        setup,
        "joint",
        named(setup, X, Z),
        float(solution.scale[0]),
        outcome,
        first.observability,
        solution.rotation_residuals[0, :n],
        metric * solution.translation_residuals[0, :n],
        solution.covariance[0, :6, :6],
        float(solution.freedom[0]),
        solution.influence[0, :n],
        weights * solution.weight[0, :n],
        int(solution.steps[0]),
        float(solution.rotation_noise[0]),
        metric * float(solution.translation_noise[0]),
        metric * float(solution.depth_noise[0]),
        float(solution.scale[0] * np.sqrt(solution.covariance[0, 12, 12])) if unknown_scale else float("nan"),
    )


def _run(
    poses: Chain,
    weights: np.ndarray,
    X: np.ndarray,
    scale: np.ndarray,
    noise: Noise,
    unknown_scale: bool,
    loss: Loss = "none",
) -> JointSolution:
    with jax.enable_x64(True):
        inputs = Poses(poses.H[..., :3, :3], poses.H[..., :3, 3], poses.C[..., :3, :3], poses.C[..., :3, 3], weights)
        start = Pose(X[:, :3, :3], X[:, :3, 3])
        metric = Poses(inputs.R_hand, inputs.t_hand, inputs.R_camera, scale[:, None, None] * inputs.t_camera, weights)
        Z = jax.jit(jax.vmap(target_from))(metric, start)
        return jax.tree.map(np.asarray, kernel(noise, unknown_scale, loss)(inputs, start, Z, scale))


def _target(poses: Chain, weights: np.ndarray, X: np.ndarray, scale: float) -> np.ndarray:
    C = poses.C.copy()
    C[:, :3, 3] *= scale
    seen = poses.H @ X @ C
    U, _, Vt = np.linalg.svd(np.tensordot(weights, seen[:, :3, :3], 1))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return se3.compose(R, weights @ seen[:, :3, 3] / weights.sum())
