"""Wrong poses are named, the answer is that of the right ones, and order does not matter."""

import jax
import numpy as np
import pytest
from calibration_cases import Simulation, conjugate, errors
from scipy.spatial.transform import Rotation
from test_joint import X, exact

from jaxmodel.calibrate.outliers import consensus, solve_robust
from jaxmodel.calibrate.poses import calibrate_poses
from jaxmodel.calibrate.resampling import differences
from jaxmodel.calibrate.solve import solve
from jaxmodel.errors import InputError

NOISE = 0.003


def spoiled(seed: int, count: int, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses of which a share is wrong by at least 5 standard deviations in rotation and in translation."""
    s = Simulation(seed)
    hand, camera = exact(s, count, 1)
    camera = s.noisy(camera[0], NOISE, NOISE)
    wrong = np.zeros(count, bool)
    wrong[s.rng.choice(count, max(1, round(share * count)), replace=False)] = True
    for k in np.flatnonzero(wrong):
        turn = np.sqrt(3) * NOISE * s.rng.uniform(5, 30) * s.unit()
        camera[k, :3, :3] = Rotation.from_rotvec(turn).as_matrix() @ camera[k, :3, :3]
        camera[k, :3, 3] += np.sqrt(3) * NOISE * s.rng.uniform(5, 30) * s.unit()
    return hand[0], camera, wrong


@pytest.mark.slow
def test_wrong_poses_are_named_and_cost_nothing():
    """Pooled F1 of at least 0.95, and errors of at most 1.5 times those of the right poses alone."""
    right = missed = false = 0
    squares = np.zeros(2)
    for seed, (count, share) in enumerate([(16, 0.1), (16, 0.3), (24, 0.2), (24, 0.3)] * 5):
        hand, camera, wrong = spoiled(seed, count, share)
        found = consensus(hand, camera, jax.random.key(0))
        right += int((~found.inlier & wrong).sum())
        missed += int((found.inlier & wrong).sum())
        false += int((~found.inlier & ~wrong).sum())
        alone = calibrate_poses(hand[~wrong], camera[~wrong])
        squares += [float(np.sum(differences(one.X[None], X) ** 2)) for one in (found.calibration, alone)]
    assert 2 * right / (2 * right + missed + false) >= 0.95
    assert np.sqrt(squares[0] / squares[1]) < 1.5


def test_clean_poses_are_kept_and_order_does_not_matter():
    hand, camera, wrong = spoiled(3, 16, 0.2)
    found = consensus(hand, camera, jax.random.key(4))
    order = np.random.default_rng(0).permutation(16)
    again = consensus(hand[order], camera[order], jax.random.key(4))
    np.testing.assert_array_equal(again.inlier, found.inlier[order])
    np.testing.assert_allclose(again.calibration.X, found.calibration.X, atol=1e-9)
    clean = consensus(hand[~wrong], camera[~wrong], jax.random.key(4))
    assert clean.inlier.sum() >= len(clean.inlier) - 1


def test_exact_poses_with_one_mispaired():
    hand, camera = exact(Simulation(6), 10, 1)
    hand, camera = hand[0], camera[0].copy()
    camera[[2, 7]] = camera[[7, 2]]
    found = consensus(hand, camera, jax.random.key(0))
    np.testing.assert_array_equal(np.flatnonzero(~found.inlier), [2, 7])
    assert max(errors(found.calibration.X, X)) < 1e-9


def test_too_few_poses_are_refused():
    hand, camera, _ = spoiled(5, 12, 0.1)
    with pytest.raises(InputError, match="5 poses are too few"):
        consensus(hand[:5], camera[:5], jax.random.key(0))


@pytest.mark.parametrize("loss", ["huber", "tukey"])
@pytest.mark.parametrize("method", ["linear", "nonlinear"])
def test_a_robust_loss_tames_wrong_motions(loss, method):
    s = Simulation(7)
    true, B = s.X(), s.motions(16)
    A = s.noisy(conjugate(true, B), 0.003, 0.003)
    A[[1, 8]] = s.noisy(A[[1, 8]], 0.3, 0.3)
    robust, weights = solve_robust(A, B, method, loss)
    plain = solve(A, B, method)
    assert sum(errors(robust.X, true)) < 0.5 * sum(errors(plain.X, true))
    assert set(np.argsort(weights)[:2]) == {1, 8}
