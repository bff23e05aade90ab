"""The means of RR-3507 §3.3: each finds the truth, wherever its angles wrap, and the robust ones forget outliers."""

from typing import Any

import numpy as np
import pytest
from calibration_cases import Simulation, errors, motion
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.averaging import average, average_angle, huber, locate, mean_on_group

LOCATIONS = ("mean", "median", "huber_residuals", "huber_weights")
REPRESENTATIONS = ("roll_pitch_yaw", "axis_angle", "group")


@pytest.mark.parametrize("centre", [0.0, np.pi, -np.pi, 1.0, -3.1])
@pytest.mark.parametrize("location", LOCATIONS)
def test_an_angle_is_averaged_wherever_it_wraps(centre, location):
    """Fig. 3.1: a distribution about 0 on [0, 2 pi[, or about pi on ]-pi, pi]."""
    angles = centre + 0.05 * np.random.default_rng(0).normal(size=200)
    wrapped = np.angle(np.exp(1j * angles))
    error = np.angle(np.exp(1j * (average_angle(wrapped, location) - centre)))
    assert abs(error) < 0.015
    # and the same whatever whole turns the angles carry
    turned = average_angle(wrapped + 2 * np.pi, location)
    np.testing.assert_allclose(turned, average_angle(wrapped, location), atol=1e-12)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
@pytest.mark.parametrize("location", LOCATIONS)
@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi])
def test_every_mean_finds_the_truth(representation, location, angle):
    s = Simulation(1)
    axis = np.array([0.36, 0.48, -0.8])
    X = motion(angle * axis, [1.0, -2.0, 0.5])
    found = average(s.noisy(np.tile(X, (400, 1, 1)), 0.02, 0.05), representation, location)
    turn, shift = errors(found, X)
    # angles are folded at 0 and at pi: there the report's axis / angle mean is off by the spread of the estimates
    folded = representation == "axis_angle" and angle != 1.0
    assert turn < (0.06 if folded else 0.01) and shift < 0.01
    np.testing.assert_allclose(average(np.tile(X, (5, 1, 1)), representation, location), X, atol=1e-12)


@pytest.mark.parametrize("representation", REPRESENTATIONS)
@pytest.mark.parametrize("location", LOCATIONS[1:])
def test_robust_means_forget_one_wrong_estimate_in_five(representation, location):
    s = Simulation(2)
    X = motion([0.3, 0.4, -0.5], [1.0, -2.0, 0.5])
    samples = s.noisy(np.tile(X, (200, 1, 1)), 0.01, 0.01)
    samples[::5] = s.noisy(np.tile(motion([0.9, 0.1, 0.4], [3.0, 0, 0]), (40, 1, 1)), 0.01, 0.01)
    robust, plain = average(samples, representation, location), average(samples, representation)
    assert errors(robust, X)[0] < 0.3 * errors(plain, X)[0]
    assert errors(robust, X)[1] < 0.3 * errors(plain, X)[1]


def test_both_ways_to_hubers_estimate_end_at_its_minimum():  # oracle: scipy.optimize.minimize_scalar
    values = np.append(np.random.default_rng(3).normal(2.0, 0.5, size=50), [30.0, -10.0, 14.0])
    S = 1.483 * np.median(np.abs(values - np.median(values)))

    def cost(T: float) -> float:
        r = np.abs(values - T) / S
        return float(np.sum(np.where(r <= 1.345, r**2 / 2, 1.345 * (r - 1.345 / 2))))

    best: Any = minimize_scalar(cost, bounds=(0, 4), method="bounded", options={"xatol": 1e-10})
    for by in ("residuals", "weights"):
        np.testing.assert_allclose(huber(values, by), best.x, atol=1e-6)
    np.testing.assert_allclose(huber(values, "residuals"), huber(values, "weights"), atol=1e-12)


def test_half_of_the_values_tied_is_no_division_by_zero():
    values = np.array([1.0, 1.0, 1.0, 1.0, 5.0, 9.0])
    assert locate(values, "huber_residuals") == locate(values, "huber_weights") == 1.0


def test_the_mean_on_the_group_is_the_least_sum_of_squares_and_moves_along():
    s = Simulation(4)
    R = s.noisy(np.tile(s.X(), (30, 1, 1)), 0.5, 0.0)[:, :3, :3]
    mean = mean_on_group(R)
    residual = (Rotation.from_matrix(R) * Rotation.from_matrix(mean).inv()).as_rotvec()
    np.testing.assert_allclose(residual.mean(axis=0), 0, atol=1e-13)
    P, Q = s.X()[:3, :3], s.X()[:3, :3]
    np.testing.assert_allclose(mean_on_group(P @ R @ Q), P @ mean @ Q, atol=1e-12)


def test_no_transformation_has_no_mean():
    with pytest.raises(ValueError, match="no transformations"):
        average(np.zeros((0, 4, 4)))
