"""Naming wrong poses: consensus over random subsets first, then a refined fit of what agrees.

A mispaired or slipped pose spoils every pair that it is in, so poses are judged, not pairs: each subset's X says where
the fixed target is, and a pose that puts the target elsewhere is wrong.
"""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from jaxmodel.calibrate.joint import Noise
from jaxmodel.calibrate.loss import MEDIAN_LENGTH, Loss
from jaxmodel.calibrate.motions import Chain, Setup, chain, order_by_content
from jaxmodel.calibrate.pose_residuals import CameraErrors, camera_errors
from jaxmodel.calibrate.poses import HandEye, calibrate_poses
from jaxmodel.calibrate.rigid import checked_motions
from jaxmodel.calibrate.solve import Calibration, solve, solve_many
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3

SUBSET = 4  # poses; their six pairs determine X with something left to check
CONFIDENCE = 0.999


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
    errors = [camera_errors(poses, one, _target(poses, one)) for one in X]
    best = errors[int(np.argmin([_spread(one) for one in errors]))]
    inlier = _score(best, np.ones(n, bool), True) < chi2.ppf(CONFIDENCE, 6)
    found, score = None, np.zeros(n)
    for _ in range(rounds):
        found = calibrate_poses(hand[inlier], camera[inlier], setup, "joint", noise=noise)
        score = _score(camera_errors(poses, found.X, found.Z), inlier, False)
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


def _target(poses: Chain, X: np.ndarray) -> np.ndarray:
    """Where the poses put the target: near the medoid, so that a wrong one cannot pull it away."""
    seen = poses.H @ X @ poses.C
    turns = np.linalg.norm(seen[:, None, :3, :3] - seen[None, :, :3, :3], axis=(2, 3))
    shifts = np.linalg.norm(seen[:, None, :3, 3] - seen[None, :, :3, 3], axis=2)
    total = turns / max(np.median(turns), 1e-300) + shifts / max(np.median(shifts), 1e-300)
    central = int(np.argmin(np.median(total, axis=1)))
    near = total[central] <= np.median(total[central])
    R = Rotation.from_matrix(seen[near, :3, :3]).mean().as_matrix()
    return se3.compose(R, np.mean(seen[near, :3, 3], axis=0))


def _spread(errors: CameraErrors) -> float:
    turn, across, along = (float(np.log(np.median(values) + 1e-12)) for values, _ in errors.kinds)
    return turn + (2 * across + along) / 3


def _score(errors: CameraErrors, inlier: np.ndarray, first: bool) -> np.ndarray:
    """Squares of the errors in their own standard deviations: a camera sees depth far worse than direction."""
    score = np.zeros(len(inlier))
    for values, dimensions in errors.kinds:
        # a first X from few poses has errors of its own: its scale is taken generously
        sigma = (1.5 if first else 1.0) * np.median(values[inlier]) / MEDIAN_LENGTH[dimensions]
        sigma *= 1.0 + (2.0 / max(int(inlier.sum()) - 4, 1))
        score += (values / max(sigma, 1e-12)) ** 2
    return score


def solve_robust(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "n 4 4"],
    method: str = "linear",
    loss: Loss = "huber",
    unknown_scale: bool = False,
) -> tuple[Calibration, Float[np.ndarray, " n"]]:
    """``solve`` under a robust loss, and each motion's weight in it: those near 0 contradict the others."""
    found = solve(A, B, method, unknown_scale, loss=loss)
    return found, found.weights
