"""Resampled poses tell what the covariance tells, and each pose's pull is what leaving it out does."""

import jax
import numpy as np
import pytest
from calibration_cases import Simulation
from test_joint import exact

from jaxmodel.calibrate.poses import calibrate_poses
from jaxmodel.calibrate.resampling import bootstrap, leave_one_out, replicas
from jaxmodel.errors import InputError


def noisy_poses(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    s = Simulation(seed)
    hand, camera = exact(s, count, 1)
    return hand[0], s.noisy(camera[0], 0.005, 0.004)


def test_leaving_a_pose_out_is_solving_without_it_and_what_influence_says():
    hand, camera = noisy_poses(0, 12)
    without = leave_one_out(hand, camera)
    for i in (0, 7):
        rest = np.delete(np.arange(12), i)
        alone = calibrate_poses(hand[rest], camera[rest]).X
        np.testing.assert_allclose(without.X[i], alone, atol=1e-7)
    whole = calibrate_poses(hand, camera)
    np.testing.assert_allclose(without.reference, whole.X, atol=1e-9)
    assert whole.covariance is not None and whole.influence is not None
    d = without.differences()
    moved = np.sqrt(np.einsum("ni,ij,nj->n", d, np.linalg.inv(whole.covariance), d) / 6)
    assert np.corrcoef(moved, whole.influence)[0, 1] > 0.9


@pytest.mark.parametrize("method", ["joint", "linear"])
def test_bootstrap_and_jackknife_are_of_the_covariances_size(method):
    ratios = []
    for seed in range(3):
        hand, camera = noisy_poses(seed, 24)
        joint = calibrate_poses(hand, camera).covariance
        assert joint is not None
        for found in (bootstrap(hand, camera, jax.random.key(1), 100, method=method),
                      leave_one_out(hand, camera, method=method)):  # fmt: skip
            ratios.append(np.sqrt(np.diag(found.covariance) / np.diag(joint)))
    low, high = (0.7, 1.5) if method == "joint" else (0.8, 4.0)  # pair methods are less efficient
    assert low < np.median(ratios) < high


def test_draws_depend_on_their_number_alone():
    hand, camera = noisy_poses(1, 8)
    few, many = (bootstrap(hand, camera, jax.random.key(2), k, method="linear") for k in (5, 12))
    np.testing.assert_allclose(many.X[:5], few.X, atol=1e-10)


def test_bad_requests_are_named():
    hand, camera = noisy_poses(2, 4)
    with pytest.raises(InputError, match="4 poses are too few to resample"):
        bootstrap(hand, camera, jax.random.key(0))
    with pytest.raises(InputError, match="3 poses are too few to leave one out"):
        leave_one_out(hand[:3], camera[:3])
    with pytest.raises(InputError, match="method must be one of joint"):
        replicas(hand, camera, np.ones((2, 4)), method="tsai")
