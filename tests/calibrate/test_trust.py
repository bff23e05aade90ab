"""What the data show beyond the noise widens the stated covariance; sound poses leave it as it is."""

import jax
import numpy as np
import pytest
from calibration_cases import Simulation
from scipy.stats import chi2
from test_joint import X, errors_of, exact

from jaxmodel.calibrate.joint import Noise
from jaxmodel.calibrate.motions import Setup, chain
from jaxmodel.calibrate.pose_residuals import camera_errors, depth_stands_out
from jaxmodel.calibrate.poses import calibrate_poses, joint_many
from jaxmodel.calibrate.resampling import differences
from jaxmodel.calibrate.trust import Trust, trust
from jaxmodel.errors import InputError

ROTATION, ACROSS, ALONG = 0.005, 0.001, 0.006


def seen_deep(s: Simulation, camera: np.ndarray) -> np.ndarray:
    """Camera poses with six times the error along the line of sight that they have across it."""
    noisy = s.noisy(camera, ROTATION, 0.0)
    sight = camera[..., :3, 3] / np.linalg.norm(camera[..., :3, 3], axis=-1, keepdims=True)
    shift = ACROSS * s.rng.normal(size=sight.shape)
    shift += (ALONG * s.rng.normal(size=sight.shape[:-1])[..., None] - np.sum(shift * sight, -1, keepdims=True)) * sight
    noisy[..., :3, 3] += shift
    return noisy


def look(hand: np.ndarray, camera: np.ndarray, noise: Noise = "camera") -> Trust:
    found = calibrate_poses(hand, camera, noise=noise)
    return trust(hand, camera, found, jax.random.key(0), noise)


def normalised(found: np.ndarray, covariance: np.ndarray) -> float:
    d = differences(found[None], X)[0]
    return float(d @ np.linalg.solve(covariance, d))


@pytest.mark.slow
def test_depth_apart_reaches_its_covariance_where_one_variance_does_not():
    """400 runs of 20 poses: normalised squared errors within 10 % of 6, and errors a good part smaller."""
    s = Simulation(0)
    hand, camera = exact(s, 20, 400)
    camera = seen_deep(s, camera)
    squares, spread = {}, {}
    for noise in ("camera", "depth"):
        found = joint_many(hand, camera, noise=noise)
        e = errors_of(found.X.R, found.X.t)
        squares[noise] = np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.covariance[:, :6, :6]), e).mean() / 6
        spread[noise] = np.sqrt((e[:, 3:] ** 2).sum(axis=1).mean())
        if noise == "depth":
            np.testing.assert_allclose(found.depth_noise.mean(), ALONG, rtol=0.05)
    assert 0.9 < squares["depth"] < 1.1, squares
    assert spread["depth"] < 0.8 * spread["camera"], spread


def test_depth_is_told_from_the_residuals():
    s = Simulation(1)
    told = []
    for deep in (False, True):
        for _ in range(10):
            hand, camera = (T[0] for T in exact(s, 16, 1))
            camera = seen_deep(s, camera) if deep else s.noisy(camera, ROTATION, ACROSS)
            found = calibrate_poses(hand, camera)
            told.append(depth_stands_out(camera_errors(chain(hand, camera, Setup.EYE_IN_HAND), found.X, found.Z)))
    assert not any(told[:10]) and sum(told[10:]) >= 9


@pytest.mark.slow
def test_sound_poses_keep_the_covariance_of_their_noise():
    """Each of three looks errs once in a thousand times."""
    s = Simulation(2)
    for k in range(8):
        hand, camera = (T[0] for T in exact(s, 20, 1))
        noise: Noise = "depth" if k % 2 else "camera"
        camera = seen_deep(s, camera) if k % 2 else s.noisy(camera, ROTATION, 0.004)
        seen = look(hand, camera, noise)
        assert seen.findings == () and np.array_equal(seen.covariance, seen.model)


def test_a_target_of_the_wrong_size_is_found_and_the_truth_covered():
    s = Simulation(3)
    hand, camera = (T[0] for T in exact(s, 30, 1))
    camera = s.noisy(camera, 0.002, 0.002)
    camera[:, :3, 3] *= 0.96
    seen = look(hand, camera)
    scale = {one.cause: one.size for one in seen.findings}["scale"]
    assert abs(scale * 0.96 - 1) < 0.01
    found = calibrate_poses(hand, camera).X
    assert normalised(found, seen.covariance) < chi2.ppf(0.999, 6)
    assert np.linalg.eigvalsh(seen.covariance - seen.model).min() > -1e-12


def test_depth_of_the_wrong_scale_is_found_and_widens_the_covariance():
    """A focal length 4 % off: no look is made for just that, and what the others see of it covers a good part."""
    seen, before, after = [], 0.0, 0.0
    for seed in range(5):
        s = Simulation(40 + seed)
        hand, camera = (T[0] for T in exact(s, 30, 1))
        camera = s.noisy(camera, 0.002, 0.002)
        camera[:, 2, 3] *= 0.96
        seen.append(look(hand, camera))
        found = calibrate_poses(hand, camera).X
        before, after = before + normalised(found, seen[-1].model), after + normalised(found, seen[-1].covariance)
    assert sum(bool(one.findings) for one in seen) >= 4
    assert after < before


def test_the_order_of_the_poses_does_not_matter():
    s = Simulation(5)
    hand, camera = (T[0] for T in exact(s, 14, 1))
    camera = s.noisy(camera, 0.004, 0.004)
    camera[:, :3, 3] *= 0.97
    order = s.rng.permutation(14)
    plain, again = look(hand, camera), look(hand[order], camera[order])
    np.testing.assert_allclose(again.covariance, plain.covariance, rtol=1e-6)
    assert [one.cause for one in again.findings] == [one.cause for one in plain.findings] != []


def test_few_poses_tell_nothing():
    hand, camera = (T[0] for T in exact(Simulation(6), 9, 1))
    with pytest.raises(InputError, match="9 poses by joint tell nothing of their spread; 10 by joint are needed"):
        look(hand, camera)
