"""How far to trust ``joint``'s covariance: what the data show beyond the noise that it assumes.

It is right where errors are independent, normal and of the kind that ``noise`` says. Real errors also have causes that
all poses share: a target or a focal length of the wrong size, a robot whose kinematics are off. Three looks at the data
tell: the answer without each part of the workspace (jackknife), the camera's lengths set free, and the answer of the
pairs of poses, which weigh the same errors otherwise. What stands out of the noise is added to the covariance. It is no
proof: an error with another cause (a focal length off, where only depth is stretched) shows in part.
"""

from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, f
from scipy.stats import t as student

from jaxmodel.calibrate.joint import Noise
from jaxmodel.calibrate.loss import Loss
from jaxmodel.calibrate.many_poses import solve_many_poses
from jaxmodel.calibrate.motions import Chain, chain, order_by_content
from jaxmodel.calibrate.poses import HandEye, calibrate_poses, joint_many
from jaxmodel.calibrate.resampling import differences
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.geometry.masked import size_class

FEWEST = 10  # poses; fewer tell nothing about their own spread
BLOCKS = 10
DRAWS = 40
LEAST_WEIGHT = 0.3  # a pose that a robust loss weighs less is left out of the pairs
SURE = 1e-3
"""Chance of calling sound poses inconsistent, at each look."""
Cause = Literal["spread", "scale", "pairs"]


@dataclass(frozen=True)
class Finding:
    """What one look shows beyond the noise: ``shift`` of X (rotation vector in rad, translation) and its ``size``.

    ``spread``: parts of the workspace disagree, ``size`` times what the noise explains (no single shift). ``scale``:
    the camera's lengths would rather be ``size`` times as long, with that ``deviation``. ``pairs``: all pairs of poses
    by the linear method are ``shift`` away, ``size`` standard deviations of what the noise explains.
    """

    cause: Cause
    size: float
    shift: Float[np.ndarray, "6"]
    deviation: float = float("nan")


@dataclass(frozen=True)
class Trust:
    """``covariance`` to be stated for X: the model's own, widened by every finding; ``spread`` is the jackknife's."""

    covariance: Float[np.ndarray, "6 6"]
    model: Float[np.ndarray, "6 6"]
    spread: Float[np.ndarray, "6 6"]
    findings: tuple[Finding, ...]


def trust(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "n 4 4"],
    found: HandEye,
    key: jax.Array,
    noise: Noise = "camera",
    unknown_scale: bool = False,
    loss: Loss = "none",
) -> Trust:
    """Look at the poses that ``found``, an answer of ``joint`` with the same options, was made from; at least 10.

    Nothing depends on the order of the poses. Raises :class:`InputError` for fewer poses or another method's answer.
    """
    n, model = len(hand), found.covariance
    if n < FEWEST or model is None or found.weights is None:
        raise InputError(f"{n} poses by {found.method} tell nothing of their spread; {FEWEST} by joint are needed.")
    order = order_by_content(chain(hand, camera, found.setup))
    hand, camera, weights = hand[order], camera[order], found.weights[order]
    metric = camera.copy()
    metric[:, :3, 3] *= found.scale
    poses = chain(hand, metric, found.setup)
    without = _without_blocks(poses)
    simulated = _simulated(poses, found, key, noise)
    streams = _stacked(simulated, poses, len(without))
    mask = np.concatenate([np.ones((DRAWS, n), bool), without])
    start = np.broadcast_to(found.X, (len(mask), 4, 4))
    solution = joint_many(*_padded(streams, mask), noise=noise, start=start, loss=loss)
    X = se3.compose(solution.X.R, solution.X.t)
    spread = _jackknife(differences(X[DRAWS:], found.X))
    covariance, excess = _widened(model, spread, len(without))
    findings = [Finding("spread", excess, np.zeros(6))] if excess > 0 else []
    if not unknown_scale:
        findings += other_scale(hand, camera, found, noise, weights if loss == "none" else None, loss)
    used = weights > LEAST_WEIGHT * weights.max()
    both = Chain(np.append(simulated.H, poses.H[None], 0)[:, used], np.append(simulated.C, poses.C[None], 0)[:, used])
    mask = np.ones(both.H.shape[:2], bool)
    findings += _pairs(solve_many_poses(*_padded(both, mask)), X[:DRAWS], found.X)
    stated = covariance
    for one in findings:
        stated = _larger(stated, covariance + np.outer(one.shift, one.shift))
    return Trust(stated, model, spread, tuple(findings))


def _without_blocks(poses: Chain) -> Bool[np.ndarray, "b n"]:
    """Which poses are left without each block; a block is a part of the workspace, whose errors go together."""
    n = len(poses.H)
    place = poses.H[:, :3, 3] - poses.H[:, :3, 3].mean(axis=0)
    along = place @ np.linalg.svd(place, full_matrices=False)[2][0]
    without = np.ones((min(n, BLOCKS), n), bool)
    for row, block in zip(without, np.array_split(np.argsort(along, kind="stable"), len(without)), strict=True):
        row[block] = False
    return without


def _simulated(poses: Chain, found: HandEye, key: jax.Array, noise: Noise) -> Chain:
    """The same hand poses (or the same camera poses) with errors of the size that was seen, about exact ones."""
    X, Z, n = found.X, found.Z, len(poses.H)
    with jax.enable_x64(True):
        drawn = np.asarray(jax.random.normal(key, (DRAWS, n, 7), np.float64))
    exact = Z @ se3.inverse(X @ poses.C) if noise == "hand" else se3.inverse(poses.H @ X) @ Z
    turn = Rotation.from_rotvec(found.rotation_noise * drawn[..., :3].reshape(-1, 3)).as_matrix()
    shift = found.translation_noise * drawn[..., 3:6]
    if noise == "depth":
        sight = exact[:, :3, 3] / np.linalg.norm(exact[:, :3, 3], axis=1, keepdims=True)
        across = np.sqrt(max(1.5 * found.translation_noise**2 - 0.5 * found.depth_noise**2, 0.0)) * drawn[..., 3:6]
        across -= np.sum(across * sight, axis=-1, keepdims=True) * sight
        shift = across + found.depth_noise * drawn[..., 6:] * sight
    noisy = se3.compose(turn.reshape(DRAWS, n, 3, 3) @ exact[:, :3, :3], exact[:, :3, 3] + shift)
    if noise == "hand":
        return Chain(noisy, np.broadcast_to(poses.C, noisy.shape))
    return Chain(np.broadcast_to(poses.H, noisy.shape), noisy)


def _stacked(simulated: Chain, poses: Chain, times: int) -> Chain:
    """The simulated poses, then the real ones so many times."""
    real = (times, *poses.H.shape)
    return Chain(
        np.concatenate([simulated.H, np.broadcast_to(poses.H, real)]),
        np.concatenate([simulated.C, np.broadcast_to(poses.C, real)]),
    )


def _padded(poses: Chain, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """To a size class, so that few shapes are compiled."""
    b, n = mask.shape
    rest = size_class(n, smallest=16) - n
    eye = np.broadcast_to(np.eye(4), (b, rest, 4, 4))
    none = np.zeros((b, rest), bool)
    return np.append(poses.H, eye, 1), np.append(poses.C, eye, 1), np.append(mask, none, 1)


def _jackknife(d: Float[np.ndarray, "b 6"]) -> Float[np.ndarray, "6 6"]:
    d = d - d.mean(axis=0)
    return (len(d) - 1) / len(d) * d.T @ d


def _widened(model: np.ndarray, spread: np.ndarray, blocks: int) -> tuple[Float[np.ndarray, "6 6"], float]:
    """The larger of both covariances in every direction where the spread stands out of the model's, and by how much."""
    freedom = 6 * (blocks - 1)
    mean = float(np.trace(np.linalg.solve(model, spread))) / 6
    if mean * freedom < chi2.isf(SURE, freedom):
        return model, 0.0
    return _larger(model, spread), float(np.sqrt(mean))


def _larger(one: np.ndarray, other: np.ndarray) -> Float[np.ndarray, "6 6"]:
    """A covariance that is the larger of both in every direction."""
    root = np.linalg.cholesky(one)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ other @ inverse.T)
    wide = root @ vectors
    return wide * np.maximum(values, 1.0) @ wide.T


def other_scale(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "n 4 4"],
    found: HandEye,
    noise: Noise = "camera",
    weights: Float[np.ndarray, " n"] | None = None,
    loss: Loss = "none",
) -> list[Finding]:
    """Whether the poses that ``found`` was made from would rather have the camera's lengths of another scale."""
    free = calibrate_poses(
        hand, camera, found.setup, "joint", unknown_scale=True, noise=noise, weights=weights, loss=loss
    )
    if not free.outcome.usable or not free.scale_deviation > 0:
        return []
    deviation = free.scale_deviation / free.scale
    if abs(np.log(free.scale)) < student.isf(SURE / 2, free.freedom) * deviation:
        return []
    return [Finding("scale", free.scale, differences(free.X[None], found.X)[0], free.scale_deviation)]


def _pairs(paired: np.ndarray, joint: np.ndarray, X: np.ndarray) -> list[Finding]:
    """The linear method on all pairs against ``joint``, beside what simulated poses of the same noise show."""
    seen = differences(paired[-1:], X)[0]
    expected = np.stack([differences(one[None], other)[0] for one, other in zip(paired[:-1], joint, strict=True)])
    shift = seen - expected.mean(axis=0)
    squared = float(shift @ np.linalg.solve(np.cov(expected.T), shift)) / (1 + 1 / DRAWS)
    if squared * (DRAWS - 6) / (6 * (DRAWS - 1)) < f.isf(SURE, 6, DRAWS - 6):
        return []
    return [Finding("pairs", float(np.sqrt(squared / 6)), shift)]
