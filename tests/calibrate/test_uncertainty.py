"""Independent motions: the maximum-likelihood methods reach the bound, more motions never hurt, intervals hold X."""

from functools import cache

import numpy as np
import pytest
from calibration_cases import Simulation, conjugate
from scipy.spatial.transform import Rotation
from test_joint import errors_of, exact

from jaxmodel.calibrate import joint_many, solve, solve_many
from jaxmodel.calibrate.resampling import differences
from jaxmodel.calibrate.uncertainty import half_widths, motion_uncertainty
from jaxmodel.errors import InputError

NOISE = 0.005
BATCH, LONGEST = 400, 40
X = Simulation(77).X(1.0)


@cache
def motions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Exact A and B of ``BATCH`` sets of independent motions."""
    s = Simulation(count)
    B = np.stack([s.motions(count, (0.3, 1.5), 0.5) for _ in range(BATCH)])
    return X @ B @ np.linalg.inv(X), B


@cache
def solved(count: int, method: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Noisy A, B (noise in A, or in B for ``nonlinear_b``), the X found and its errors (rotation, translation)."""
    s = Simulation(1000 + count)
    A, B = motions(count)
    if method == "nonlinear_b":
        B = s.noisy(B, NOISE, NOISE)
    else:
        A = s.noisy(A, NOISE, NOISE)
    rest = np.broadcast_to(np.eye(4), (BATCH, LONGEST - count, 4, 4))
    mask = np.broadcast_to(np.arange(LONGEST) < count, (BATCH, LONGEST))
    padded = [np.concatenate([motions, rest], axis=1) for motions in (A, B)]
    found = solve_many(padded[0], padded[1], mask, method, verdict=False).X
    return A, B, found, differences(found, X)


def bound(B: np.ndarray) -> np.ndarray:
    """The Cramer-Rao bound with noise in A, from numerical derivatives of ``X B X^-1``."""

    def predicted(x: np.ndarray) -> np.ndarray:
        moved = X.copy()
        moved[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix() @ X[:3, :3]
        moved[:3, 3] += x[3:]
        return conjugate(moved, B)

    start = predicted(np.zeros(6))

    def scaled(x: np.ndarray) -> np.ndarray:
        seen = predicted(x)
        turn = Rotation.from_matrix(seen[:, :3, :3] @ start[:, :3, :3].swapaxes(1, 2)).as_rotvec()
        return np.concatenate([turn.reshape(-1), (seen - start)[:, :3, 3].reshape(-1)]) / NOISE

    J = np.stack([(scaled(d) - scaled(-d)) / 2e-5 for d in 1e-5 * np.eye(6)], axis=1)
    return np.linalg.inv(J.T @ J)


@pytest.mark.slow
@pytest.mark.parametrize("count", [15, 40])
def test_nonlinear_comes_within_15_percent_of_the_bound(count):
    _, B = motions(count)
    C = np.mean([bound(one) for one in B[::4]], axis=0)
    e = solved(count, "nonlinear")[3]
    rms = np.sqrt([(e[:, :3] ** 2).sum(1).mean(), (e[:, 3:] ** 2).sum(1).mean()])
    ratio = rms / np.sqrt([np.trace(C[:3, :3]), np.trace(C[3:, 3:])])
    assert (ratio < 1.15).all() and (ratio > 0.9).all(), ratio


@pytest.mark.slow
@pytest.mark.parametrize("method", ["nonlinear", "linear", "park", "dual_quaternion"])
def test_more_motions_do_no_harm(method):
    medians = np.array(
        [
            [np.median(np.linalg.norm(solved(count, method)[3][:, part], axis=1)) for part in (slice(3), slice(3, 6))]
            for count in (5, 10, 20, 40)
        ]
    )
    assert (np.diff(medians, axis=0) < 0).all(), medians


@pytest.mark.slow
@pytest.mark.parametrize(("method", "stream"), [("nonlinear", "A"), ("nonlinear_b", "B")])
def test_the_covariance_is_that_of_the_errors_and_intervals_hold_x(method, stream):
    """Normalised squared error within 10 % of 6 at 20 motions; with 5, Student's intervals hold, normal ones do not."""
    A, B, found, e = solved(20, method)
    told = [motion_uncertainty(*one, noise_in=stream) for one in zip(A, B, found, strict=True)]
    # a variance of nu degrees of freedom: the mean of the squares is nu / (nu - 2) times that of chi-squared
    squared = [d @ np.linalg.solve(u.covariance, d) * (u.freedom - 2) / u.freedom for d, u in zip(e, told, strict=True)]
    assert 0.9 < np.mean(squared) / 6 < 1.1
    np.testing.assert_allclose(np.mean([u.rotation_noise for u in told]), NOISE, rtol=0.02)
    np.testing.assert_allclose(np.mean([u.translation_noise for u in told]), NOISE, rtol=0.02)
    A, B, found, e = solved(5, method)
    told = [motion_uncertainty(*one, noise_in=stream) for one in zip(A, B, found, strict=True)]
    held = np.mean([np.abs(d) < half_widths(u.covariance, u.freedom) for d, u in zip(e, told, strict=True)])
    normal = np.mean([np.abs(d) < half_widths(u.covariance, np.inf) for d, u in zip(e, told, strict=True)])
    # 2400 intervals of 95 %: three standard deviations of the share are 1.4 %, and six of each set are correlated
    assert 0.93 < held < 0.985 and normal < held - 0.01, (held, normal)


@pytest.mark.slow
def test_intervals_of_few_poses_hold_x():
    s = Simulation(5)
    hand, camera = exact(s, 20, 800)
    mask = np.broadcast_to(np.arange(20) < 6, (800, 20))
    found = joint_many(hand, s.noisy(camera, NOISE, NOISE), mask)
    assert (found.freedom < 3 * 6 - 5).all()
    e = errors_of(found.X.R, found.X.t)
    widths = [half_widths(C[:6, :6], nu) for C, nu in zip(found.covariance, found.freedom, strict=True)]
    held = np.mean(np.abs(e) < widths)
    assert 0.93 < held < 0.985, held


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 4])
def test_the_fewest_poses_do_not_pretend_to_be_exact(count):
    """Nine translations or twelve can be met exactly by turning X and Z: no variance may vanish for that."""
    s = Simulation(6)
    hand, camera = exact(s, 8, 800)
    mask = np.broadcast_to(np.arange(8) < count, (800, 8))
    found = joint_many(hand, s.noisy(camera, NOISE, NOISE), mask)
    e = errors_of(found.X.R, found.X.t)
    widths = [half_widths(C[:6, :6], nu) for C, nu in zip(found.covariance, found.freedom, strict=True)]
    held = np.mean(np.abs(e) < widths)
    # of 95 %, with a ratio of the variances that only the start tells
    assert 0.9 < held < 0.985, held


def test_exact_motions_have_no_uncertainty_and_two_tell_none():
    A, B = motions(5)
    told = motion_uncertainty(A[0], B[0], X)
    assert told.covariance.max() < 1e-25 and told.freedom > 8
    with pytest.raises(InputError, match="2 motions show nothing of the noise"):
        motion_uncertainty(A[0, :2], B[0, :2], X)


def test_the_unit_of_length_goes_into_the_translation_only():
    s = Simulation(9)
    A, B = (T[0].copy() for T in motions(5))
    A = s.noisy(A, NOISE, NOISE)
    found = solve(A, B, "nonlinear").X
    metre = motion_uncertainty(A, B, found)
    for T in (A, B, found):
        T[..., :3, 3] *= 1000
    millimetre = motion_uncertainty(A, B, found)
    unit = np.diag([1, 1, 1, 1000, 1000, 1000])
    np.testing.assert_allclose(millimetre.covariance, unit @ metre.covariance @ unit, rtol=1e-6, atol=1e-12)
