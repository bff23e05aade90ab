"""The joint estimator is exact without noise, efficient with it, and its covariance is that of its errors."""

from typing import Any

import jax
import numpy as np
import pytest
from calibration_cases import Simulation, motion
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.joint import JointSolution
from jaxmodel.calibrate.motions import Setup
from jaxmodel.calibrate.poses import joint_many

X = motion([0.3, -0.2, 1.0], [0.05, 0.1, -0.03])
Z = motion([1.0, 0.5, 0.2], [0.8, 0.1, 0.2])


def exact(s: Simulation, count: int, batch: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a hand that turns by up to 70 degrees within half a metre."""
    flat = [motion(s.rng.uniform(0.2, 1.2) * s.unit(), 0.5 * s.rng.normal(size=3)) for _ in range(count * batch)]
    hand = np.stack(flat).reshape(batch, count, 4, 4)
    return hand, np.linalg.inv(X) @ np.linalg.inv(hand) @ Z


def solved(hand: np.ndarray, camera: np.ndarray, mask: np.ndarray | None = None, **how: Any) -> JointSolution:
    """``joint_many`` of up to 16 sets of up to 14 poses in one shape, so that each variant compiles once."""
    b, n = hand.shape[:2]
    rows = np.arange(16) % b
    mask = np.ones((b, n), bool) if mask is None else mask
    rest = np.broadcast_to(np.eye(4), (16, 14 - n, 4, 4))
    hand, camera = (np.concatenate([poses[rows], rest], axis=1) for poses in (hand, camera))
    found = joint_many(hand, camera, np.concatenate([mask[rows], np.zeros((16, 14 - n), bool)], axis=1), **how)
    return jax.tree.map(lambda leaf: leaf[:b], found)


def errors_of(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.concatenate([Rotation.from_matrix(R @ X[:3, :3].T).as_rotvec(), t - X[:3, 3]], axis=1)


def bound(hand: np.ndarray, rotation: float, translation: float) -> np.ndarray:
    """The Cramer-Rao bound of (rotation, translation) of X, from numerical derivatives of the predicted camera."""

    def predicted(x: np.ndarray) -> np.ndarray:
        moved = []
        for T, d in ((X, x[:6]), (Z, x[6:])):
            M = T.copy()
            M[:3, :3] = Rotation.from_rotvec(d[:3]).as_matrix() @ T[:3, :3]
            M[:3, 3] += d[3:]
            moved.append(M)
        return np.linalg.inv(moved[0]) @ np.linalg.inv(hand) @ moved[1]

    start = predicted(np.zeros(12))

    def scaled(x: np.ndarray) -> np.ndarray:
        seen = predicted(x)
        turn = Rotation.from_matrix(seen[:, :3, :3] @ start[:, :3, :3].swapaxes(1, 2)).as_rotvec()
        return np.concatenate([turn.reshape(-1) / rotation, (seen - start)[:, :3, 3].reshape(-1) / translation])

    step = 1e-5
    J = np.stack([(scaled(d) - scaled(-d)) / (2 * step) for d in step * np.eye(12)], axis=1)
    return np.linalg.inv(J.T @ J)[:6, :6]


@pytest.mark.parametrize("noise", ["camera", "hand"])
@pytest.mark.parametrize("unknown_scale", [False, True])
def test_exact_poses_give_both_unknowns(noise, unknown_scale):
    hand, camera = exact(Simulation(0), 6, 3)
    if unknown_scale:
        camera[..., :3, 3] /= 3.0
    found = solved(hand, camera, noise=noise, unknown_scale=unknown_scale)
    assert found.converged.all()
    np.testing.assert_allclose(found.X.R, np.broadcast_to(X[:3, :3], (3, 3, 3)), atol=1e-11)
    np.testing.assert_allclose(found.X.t, np.broadcast_to(X[:3, 3], (3, 3)), atol=1e-11)
    np.testing.assert_allclose(found.Z.R, np.broadcast_to(Z[:3, :3], (3, 3, 3)), atol=1e-11)
    np.testing.assert_allclose(found.Z.t, np.broadcast_to(Z[:3, 3], (3, 3)), atol=1e-11)
    np.testing.assert_allclose(found.scale, 3.0 if unknown_scale else 1.0, rtol=1e-11)


def test_order_padding_and_neighbours_change_nothing():
    s = Simulation(1)
    hand, camera = exact(s, 9, 1)
    camera = s.noisy(camera, 0.005, 0.01)
    orders = np.stack([np.arange(9), *(s.rng.permutation(9) for _ in range(15))])
    found = joint_many(hand[0][orders], camera[0][orders])
    assert np.abs(found.X.R - found.X.R[:1]).max() < 1e-9
    assert np.abs(found.X.t - found.X.t[:1]).max() < 1e-9
    padded = solved(hand[0][orders], camera[0][orders])
    np.testing.assert_allclose(padded.X.t, found.X.t, atol=1e-9)
    np.testing.assert_allclose(padded.covariance, found.covariance, rtol=1e-6, atol=1e-12)


def test_the_unit_of_length_does_not_matter():
    s = Simulation(2)
    hand, camera = exact(s, 10, 1)
    camera = s.noisy(camera, 0.005, 0.01)
    metre = solved(hand, camera)
    for T in (hand, camera):
        T[..., :3, 3] *= 1000
    millimetre = solved(hand, camera)
    np.testing.assert_allclose(millimetre.X.R, metre.X.R, atol=1e-9)
    apart = np.linalg.norm(np.asarray(millimetre.X.t) / 1000 - metre.X.t, axis=1)
    assert (apart < 1e-9 * np.linalg.norm(X[:3, 3])).all()
    np.testing.assert_allclose(millimetre.translation_noise, 1000 * metre.translation_noise, rtol=1e-6)


def test_change_of_the_worlds_frame():
    """Base and target may be named anew: X stays, Z follows."""
    s = Simulation(3)
    hand, camera = exact(s, 10, 1)
    camera = s.noisy(camera, 0.005, 0.01)
    P, Q = motion([0.5, 1.0, 0.1], [1, 2, 3]), motion([-0.5, 0.2, 0.4], np.zeros(3))
    plain, moved = solved(hand, camera), solved(P @ hand, camera @ Q)
    np.testing.assert_allclose(moved.X.R, plain.X.R, atol=1e-9)
    np.testing.assert_allclose(moved.X.t, plain.X.t, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["camera", "hand"])
def test_it_reaches_the_bound_and_knows_its_covariance(noise):
    """800 runs of 20 poses: rms within 5 % of the Cramer-Rao bound, normalised squared error within 10 % of 6."""
    s = Simulation(4)
    hand, camera = exact(s, 20, 800)
    if noise == "camera":
        noisy = joint_many(hand, s.noisy(camera, 0.005, 0.004), noise=noise)
    else:
        noisy = joint_many(s.noisy(hand, 0.005, 0.004), camera, noise=noise)
    e = errors_of(noisy.X.R, noisy.X.t)
    squared = np.einsum("ni,nij,nj->n", e, np.linalg.inv(noisy.covariance[:, :6, :6]), e)
    assert 0.9 < squared.mean() / 6 < 1.1
    np.testing.assert_allclose(noisy.rotation_noise.mean(), 0.005, rtol=0.02)
    np.testing.assert_allclose(noisy.translation_noise.mean(), 0.004, rtol=0.02)
    if noise == "camera":
        C = np.mean([bound(h, 0.005, 0.004) for h in hand[:40]], axis=0)
        rms = np.sqrt([(e[:, :3] ** 2).sum(1).mean(), (e[:, 3:] ** 2).sum(1).mean()])
        ratio = rms / np.sqrt([np.trace(C[:3, :3]), np.trace(C[3:, 3:])])
        assert (ratio > 0.95).all() and (ratio < 1.05).all(), ratio


def test_the_influence_names_the_pose_that_pulls():
    s = Simulation(5)
    hand, camera = exact(s, 14, 1)
    camera = s.noisy(camera, 0.002, 0.002)
    camera[0, 6] = s.noisy(camera[0, 6:7], 0.1, 0.1)[0]
    found = solved(hand, camera)
    assert np.argmax(found.influence[0]) == 6
    # the first-order influence against leaving the pose out for real
    mask = np.ones((1, 14), bool)
    mask[0, 6] = False
    without = solved(hand, camera, mask)
    assert np.linalg.norm(errors_of(without.X.R, without.X.t)) < np.linalg.norm(errors_of(found.X.R, found.X.t))


def test_the_setup_is_applied():
    hand, camera = exact(Simulation(6), 5, 2)
    found = solved(hand, np.linalg.inv(camera), setup=Setup.MOVING_FRAMES)
    np.testing.assert_allclose(found.X.t, np.broadcast_to(X[:3, 3], (2, 3)), atol=1e-11)
