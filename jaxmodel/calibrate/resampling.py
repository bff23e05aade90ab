"""Uncertainty by resampling poses: bootstrap, leave-one-out, and what each pose does to the answer.

All replicas of a calibration run as one batch. Poses are resampled, not pairs: pairs of the same poses are correlated.
"""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.joint import Noise
from jaxmodel.calibrate.motions import Setup, chain, motion_pairs
from jaxmodel.calibrate.poses import joint_weighted
from jaxmodel.calibrate.solve import METHODS, solve_many
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3


@dataclass(frozen=True)
class Replicas:
    """X of each replica, X of all poses, and the covariance of (rotation, translation) errors about it (rad, unit)."""

    X: Float[np.ndarray, "k 4 4"]
    reference: Float[np.ndarray, "4 4"]
    covariance: Float[np.ndarray, "6 6"]

    def differences(self) -> Float[np.ndarray, "k 6"]:
        """(rotation vector, translation) from the reference to each replica."""
        return differences(self.X, self.reference)


def differences(X: Float[np.ndarray, "k 4 4"], reference: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "k 6"]:
    """(rotation vector, translation) by which each X differs: ``R = exp(d) R_ref``, ``t = t_ref + e``."""
    turn = Rotation.from_matrix(X[:, :3, :3] @ reference[:3, :3].T).as_rotvec()
    return np.concatenate([turn, X[:, :3, 3] - reference[:3, 3]], axis=1)


def replicas(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "n 4 4"],
    weights: Float[np.ndarray, "k n"],
    setup: Setup = Setup.EYE_IN_HAND,
    method: str = "joint",
    noise: Noise = "camera",
) -> Float[np.ndarray, "k 4 4"]:
    """X for each row of weights of the poses, all in one batch; a pair weighs the product of its poses."""
    if method == "joint":
        return joint_weighted(hand, camera, weights, setup, noise)
    if method not in METHODS:
        raise InputError(f"method must be one of joint, {', '.join(METHODS)}, not {method!r}.")
    pairs = motion_pairs(chain(hand, camera, setup))
    i, j = pairs.index.T
    shape = (len(weights), *pairs.A.shape)
    A, B = np.broadcast_to(pairs.A, shape), np.broadcast_to(pairs.B, shape)
    found = solve_many(A, B, None, method, weights=weights[:, i] * weights[:, j], verdict=False)
    return se3.inverse(found.X)


def bootstrap(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "n 4 4"],
    key: jax.Array,
    draws: int = 200,
    setup: Setup = Setup.EYE_IN_HAND,
    method: str = "joint",
    noise: Noise = "camera",
    weights: Float[np.ndarray, " n"] | None = None,
) -> Replicas:
    """Poses drawn with replacement, ``draws`` times; draw i comes from ``fold_in(key, i)``.

    ``weights``: of the poses, given or those that a robust loss ended with. Draws with fewer than 4 different poses are
    drawn again. Bootstrap covariances of few poses are somewhat wide.
    """
    n = len(hand)
    if n < 5:
        raise InputError(f"{n} poses are too few to resample; at least 5 are needed.")
    counts = np.stack([_counts(jax.random.fold_in(key, i), n) for i in range(draws)])
    counts = np.concatenate([np.ones((1, n)), counts]) * (1.0 if weights is None else weights)
    X = replicas(hand, camera, counts, setup, method, noise)
    d = differences(X[1:], X[0])
    d = d[np.isfinite(d).all(axis=1)]
    return Replicas(X[1:], X[0], d.T @ d / max(len(d), 1))


def _counts(key: jax.Array, n: int) -> Float[np.ndarray, " n"]:
    for attempt in range(100):
        rows = np.asarray(jax.random.randint(jax.random.fold_in(key, attempt), (n,), 0, n))
        counts = np.bincount(rows, minlength=n).astype(np.float64)
        if np.count_nonzero(counts) >= 4:
            return counts
    return np.ones(n)


def leave_one_out(
    hand: Float[np.ndarray, "n 4 4"],
    camera: Float[np.ndarray, "n 4 4"],
    setup: Setup = Setup.EYE_IN_HAND,
    method: str = "joint",
    noise: Noise = "camera",
    weights: Float[np.ndarray, " n"] | None = None,
) -> Replicas:
    """X without each pose in turn, and the jackknife covariance. Row i of ``differences`` is what pose i does.

    ``weights``: of the poses, given or those that a robust loss ended with.
    """
    n = len(hand)
    if n < 4:
        raise InputError(f"{n} poses are too few to leave one out; at least 4 are needed.")
    left = np.concatenate([np.ones((1, n)), 1.0 - np.eye(n)]) * (1.0 if weights is None else weights)
    X = replicas(hand, camera, left, setup, method, noise)
    d = differences(X[1:], X[0])
    d = d - d.mean(axis=0)
    return Replicas(X[1:], X[0], (n - 1) / n * d.T @ d)
