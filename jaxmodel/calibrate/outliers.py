"""Naming wrong poses: consensus over random subsets first, then a refined fit of what agrees.

A mispaired or slipped pose spoils every pair that it is in, so poses are judged, not pairs: each subset's X says where
the fixed target is, and a pose that puts the target elsewhere is wrong.
"""

from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from jaxmodel.calibrate.joint import Noise
from jaxmodel.calibrate.motions import Chain, Setup, chain, order_by_content
from jaxmodel.calibrate.poses import HandEye, calibrate_poses
from jaxmodel.calibrate.rigid import checked_motions
from jaxmodel.calibrate.solve import Calibration, solve, solve_many
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3

SUBSET = 4  # poses; their six pairs determine X with something left to check
CONFIDENCE = 0.999
# median of the length of a three-dimensional normal error, in standard deviations of one component
MEDIAN_LENGTH = 1.5382
Loss = Literal["huber", "tukey"]


@dataclass(frozen=True)
class Consensus:
    """The calibration of the poses that agree, and which do; ``score`` is each pose's normalised squared residual.

    Right poses have scores like chi-squared of 6 degrees of freedom.
    """

    calibration: HandEye
    inlier: Bool[np.ndarray, " n"]
    score: Float[np.ndarray, " n"]


def consensus(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "m 4 4"],
    key: jax.Array,
    setup: Setup = Setup.EYE_IN_HAND,
    draws: int = 150,
    noise: Noise = "camera",
    rounds: int = 10,
) -> Consensus:
    """Poses that agree, named by consensus of ``draws`` subsets, and their joint calibration.

    Meant for up to 40 % of wrong poses among 12 or more. The draws depend on the poses' content and not on their order.
    """
    hand, camera = checked_motions(hand, "hand"), checked_motions(camera, "camera")
    poses = chain(hand, camera, setup)
    n = len(hand)
    if n < SUBSET + 2:
        raise InputError(f"{n} poses are too few to tell which are wrong; at least {SUBSET + 2} are needed.")
    order = order_by_content(poses)
    X = _candidates(Chain(poses.H[order], poses.C[order]), key, draws)
    best = X[int(np.argmin([_spread(poses, one) for one in X]))]
    inlier = _score(poses, best, np.ones(n, bool), True) < chi2.ppf(CONFIDENCE, 6)
    found, score = None, np.zeros(n)
    for _ in range(rounds):
        found = calibrate_poses(hand[inlier], camera[inlier], setup, "joint", noise=noise)
        score = _score(poses, found.X, inlier, False)
        renewed = score < chi2.ppf(CONFIDENCE, 6)
        if renewed.sum() < SUBSET or (renewed == inlier).all():
            break
        inlier = renewed
    assert found is not None
    return Consensus(found, inlier, score)


def _candidates(poses: Chain, key: jax.Array, draws: int) -> Float[np.ndarray, "k 4 4"]:
    n = len(poses.H)
    i, j = np.triu_indices(SUBSET, 1)
    keys = jax.vmap(lambda k: jax.random.fold_in(key, k))(np.arange(draws))
    subsets = np.asarray(jax.vmap(lambda k: jax.random.permutation(k, n)[:SUBSET])(keys))
    first, second = subsets[:, i], subsets[:, j]
    A = poses.C[second] @ se3.inverse(poses.C[first])
    B = se3.inverse(poses.H[second]) @ poses.H[first]
    X = se3.inverse(solve_many(A, B, verdict=False).X)
    return X[np.isfinite(X).all(axis=(1, 2))]


def _target_errors(poses: Chain, X: np.ndarray, among: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (rad) and translation by which each camera pose differs from the one that the hand predicts.

    The target is where the poses ``among`` put it: the medoid, so that a wrong one cannot pull it away.
    """
    seen = poses.H @ X @ poses.C
    turns = np.linalg.norm(seen[:, None, :3, :3] - seen[None, :, :3, :3], axis=(2, 3))
    shifts = np.linalg.norm(seen[:, None, :3, 3] - seen[None, :, :3, 3], axis=2)
    unit = np.median(turns[among][:, among]), np.median(shifts[among][:, among])
    total = turns / max(unit[0], 1e-300) + shifts / max(unit[1], 1e-300)
    central = int(np.flatnonzero(among)[np.argmin(np.median(total[among][:, among], axis=1))])
    near = among & (total[central] <= np.median(total[central][among]))
    R = Rotation.from_matrix(seen[near, :3, :3]).mean().as_matrix()
    Z = se3.compose(R, np.mean(seen[near, :3, 3], axis=0))
    predicted = se3.inverse(poses.H @ X) @ Z
    turn = Rotation.from_matrix(predicted[:, :3, :3] @ np.swapaxes(poses.C[:, :3, :3], 1, 2)).magnitude()
    return turn, np.linalg.norm(predicted[:, :3, 3] - poses.C[:, :3, 3], axis=1)


def _spread(poses: Chain, X: np.ndarray) -> float:
    turn, shift = _target_errors(poses, X, np.ones(len(poses.H), bool))
    return float(np.log(np.median(turn) + 1e-12) + np.log(np.median(shift) + 1e-12))


def _score(poses: Chain, X: np.ndarray, inlier: np.ndarray, first: bool) -> np.ndarray:
    turn, shift = _target_errors(poses, X, inlier)
    score = np.zeros(len(turn))
    for values in (turn, shift):
        # a first X from few poses has errors of its own: its scale is taken generously
        sigma = (1.5 if first else 1.0) * np.median(values[inlier]) / MEDIAN_LENGTH
        sigma *= 1.0 + (2.0 / max(int(inlier.sum()) - 4, 1))
        score += (values / max(sigma, 1e-12)) ** 2
    return score


def solve_robust(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "n 4 4"],
    method: str = "linear",
    loss: Loss = "huber",
    unknown_scale: bool = False,
    rounds: int = 20,
) -> tuple[Calibration, Float[np.ndarray, " n"]]:
    """Any method of ``solve`` under a robust loss: motions reweighted by their residuals until the weights rest.

    Returns the calibration and each motion's weight. Residuals are normalised by their medians; ``huber`` limits the
    pull of a wrong motion, ``tukey`` removes it but needs a start that is right already.
    """
    weights = np.ones(len(A))
    found = solve(A, B, method, unknown_scale)
    for _ in range(rounds):
        pull = np.zeros(len(A))
        for values in (found.rotation_residuals, found.translation_residuals):
            sigma = np.median(values) / MEDIAN_LENGTH
            pull += (values / max(float(sigma), 1e-300)) ** 2 / 6
        size = np.sqrt(pull)  # 1 for a usual motion
        renewed = np.minimum(1.0, 1.5 / np.maximum(size, 1e-300))
        if loss == "tukey":
            renewed = np.clip(1 - (size / 3.0) ** 2, 0.0, None) ** 2
        if not renewed.any():
            break
        done = np.abs(renewed - weights).max() < 1e-6
        weights = renewed
        found = solve(A, B, method, unknown_scale, weights)
        if done:
            break
    return found, weights
