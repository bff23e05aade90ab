"""Weights and robust losses go through every solver alike; wrong samples then cost little, right ones nothing."""

import numpy as np
import pytest
from calibration_cases import Simulation, conjugate
from scipy.spatial.transform import Rotation
from test_joint import X, errors_of, exact

from jaxmodel.calibrate import calibrate_poses, joint_many, solve, solve_many
from jaxmodel.calibrate.loss import contradicts
from jaxmodel.calibrate.resampling import differences
from jaxmodel.calibrate.solve import METHODS
from jaxmodel.errors import InputError

NOISE = 0.003
BATCH = 60
LOSSES = ("huber", "tukey")


def spoil(s: Simulation, T: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """T with a share of each set's rows wrong by 5 to 30 standard deviations in rotation and in translation."""
    batch, n = T.shape[:2]
    wrong = np.zeros((batch, n), bool)
    for row in wrong:
        row[s.rng.choice(n, round(share * n), replace=False)] = True
    turns = np.stack([s.rng.uniform(5, 30) * s.unit() for _ in range(batch * n)])
    shifts = np.stack([s.rng.uniform(5, 30) * s.unit() for _ in range(batch * n)]).reshape(batch, n, 3)
    size = np.sqrt(3) * NOISE
    moved = T.copy()
    moved[..., :3, :3] = Rotation.from_rotvec(size * turns).as_matrix().reshape(batch, n, 3, 3) @ T[..., :3, :3]
    moved[..., :3, 3] += size * shifts
    return np.where(wrong[..., None, None], moved, T), wrong


def rms(d: np.ndarray) -> np.ndarray:
    return np.sqrt([np.mean(np.sum(d[:, part] ** 2, axis=1)) for part in (slice(3), slice(3, 6))])


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1, 0.2, 0.3])
def test_wrong_poses_cost_joint_little(share):
    """At most 1.5 times the error of the right poses alone, and the weights tell which they are."""
    s = Simulation(1)
    hand, camera = exact(s, 20, BATCH)
    camera, wrong = spoil(s, s.noisy(camera, NOISE, NOISE), share)
    alone = joint_many(hand, camera, ~wrong)
    least = rms(errors_of(alone.X.R, alone.X.t))
    for loss in LOSSES:
        found = joint_many(hand, camera, loss=loss)
        assert (rms(errors_of(found.X.R, found.X.t)) <= 1.5 * least).all(), loss
        low = contradicts(found.weight, loss)
        right, missed, false = (low & wrong).sum(), (~low & wrong).sum(), (low & ~wrong).sum()
        assert 2 * right / (2 * right + missed + false) >= 0.95, loss


@pytest.mark.slow
@pytest.mark.parametrize("method", sorted(METHODS))
def test_wrong_motions_cost_the_solvers_little(method):
    """A tenth and three tenths of 20 motions wrong; the noise and the wrong motions in the stream that carries them.

    Huber's loss never lets go of a wrong motion, and with three in ten it pays a little more than Tukey's.
    """
    for share in (0.1, 0.3):
        s = Simulation(2)
        true = s.X(1.0)
        B = np.stack([s.motions(20, (0.3, 1.5), 0.5) for _ in range(BATCH)])
        A = conjugate(true, B)
        if method == "nonlinear_b":
            B, wrong = spoil(s, s.noisy(B, NOISE, NOISE), share)
        else:
            A, wrong = spoil(s, s.noisy(A, NOISE, NOISE), share)
        least = rms(differences(solve_many(A, B, ~wrong, method, verdict=False).X, true))
        for loss in LOSSES:
            found = solve_many(A, B, None, method, verdict=False, loss=loss)
            most = 1.7 if loss == "huber" and share == 0.3 else 1.5
            assert (rms(differences(found.X, true)) <= most * least).all(), (share, loss)
            assert found.weights[wrong].mean() < 0.5 < found.weights[~wrong].mean()


@pytest.mark.parametrize("method", ["joint", *sorted(METHODS)])
def test_every_method_takes_weights_and_a_loss_from_poses(method):
    """A weight of 0 leaves a pose out; under Tukey's loss wrong poses weigh nothing, in each pair that they are in."""
    s = Simulation(3)
    hand, camera = (T[0] for T in exact(s, 14, 1))
    camera = s.noisy(camera, NOISE, NOISE)
    camera[[2, 9]] = s.noisy(camera[[2, 9]], 0.3, 0.3)
    right = np.ones(14, bool)
    right[[2, 9]] = False
    alone = calibrate_poses(hand[right], camera[right], method=method).X
    np.testing.assert_allclose(calibrate_poses(hand, camera, method=method, weights=right * 1.0).X, alone, atol=1e-7)
    robust = calibrate_poses(hand, camera, method=method, loss="tukey")
    assert robust.weights is not None and robust.weights[[2, 9]].max() == 0 and robust.weights[right].min() > 0.05
    least = differences(alone[None], X)
    assert (rms(differences(robust.X[None], X)) <= 1.5 * rms(least) + NOISE / 3).all()


@pytest.mark.parametrize("loss", LOSSES)
def test_exact_samples_keep_their_answer(loss):
    hand, camera = exact(Simulation(4), 8, 2)
    found = joint_many(hand, camera, loss=loss)
    assert np.abs(errors_of(found.X.R, found.X.t)).max() < 1e-9
    s = Simulation(5)
    true, B = s.X(), s.motions(8)
    assert np.abs(differences(solve(conjugate(true, B), B, loss=loss).X[None], true)).max() < 1e-9


@pytest.mark.parametrize("loss", LOSSES)
def test_the_order_of_the_poses_does_not_matter(loss):
    s = Simulation(6)
    hand, camera = exact(s, 14, 1)
    camera, _ = spoil(s, s.noisy(camera, NOISE, NOISE), 0.2)
    orders = np.stack([s.rng.permutation(14) for _ in range(30)])
    found = joint_many(hand[0][orders], camera[0][orders], loss=loss)
    assert max(np.ptp(found.X.R, axis=0).max(), np.ptp(found.X.t, axis=0).max()) < 1e-9


def test_an_unknown_loss_is_named():
    hand, camera = exact(Simulation(7), 6, 1)
    with pytest.raises(InputError, match="loss must be one of none, huber, tukey, not 'cauchy'"):
        calibrate_poses(hand[0], camera[0], loss="cauchy")
    with pytest.raises(InputError, match="loss must be one of none, huber, tukey"):
        solve(hand[0], camera[0], loss="l1")
