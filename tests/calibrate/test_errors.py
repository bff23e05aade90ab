"""RR-3507's error measures: its Table 3.2 to the digits printed, and errors at a distance against sampling."""

import numpy as np
from calibration_cases import Simulation, motion

from jaxmodel.calibrate.errors import (
    calibration_error,
    expected_error,
    quaternion_error,
    quaternion_error_angle_deg,
    reach_covariance,
    root_mean_square,
)
from jaxmodel.geometry import se3


def test_table_3_2_of_the_report():
    angles = quaternion_error_angle_deg(np.array([1e-5, 1e-4, 1e-3, 1e-2]))
    np.testing.assert_allclose(angles, [0.3624, 1.1459, 3.6239, 11.4639], atol=5e-5)
    errors = quaternion_error(np.array([5.0, 10.0, 15.0, 20.0]))
    np.testing.assert_allclose(errors, [1.9036e-3, 7.6106e-3, 1.7110e-2, 3.0384e-2], rtol=5e-5)


def test_the_measure_is_the_squared_distance_of_quaternions():
    for seed in range(5):
        s = Simulation(seed)
        X, reference = s.X(), s.X()
        a, b = se3.rotation_to_quaternion(X[:3, :3]), se3.rotation_to_quaternion(reference[:3, :3])
        found = calibration_error(X, reference)
        np.testing.assert_allclose(found.quaternion_squared, se3.quaternion_distance(a, b) ** 2, atol=1e-12)
        np.testing.assert_allclose(found.distance, np.linalg.norm(X[:3, 3] - reference[:3, 3]))
        np.testing.assert_allclose(found.relative_translation, found.distance / np.linalg.norm(reference[:3, 3]))


def test_round_trip_small_angles_and_no_translation():
    angles = np.array([1e-7, 1e-3, 90.0, 180.0])
    np.testing.assert_allclose(quaternion_error_angle_deg(quaternion_error(angles)), angles, rtol=1e-9)
    nothing = calibration_error(motion([0.1, 0, 0], [0, 0, 0]), motion([0, 0, 0], [0, 0, 0]))
    assert np.isnan(nothing.relative_translation) and nothing.distance == 0
    np.testing.assert_allclose(root_mean_square(np.array([[3.0, 4.0]])), [np.sqrt(12.5)])


def test_the_error_at_a_distance_is_that_of_samples():
    s = Simulation(1)
    X = s.X()
    rows = s.rng.normal(size=(8, 6)) * [1e-3, 1e-3, 1e-3, 1e-2, 1e-2, 1e-2]
    covariance = rows.T @ rows
    draws = s.rng.multivariate_normal(np.zeros(6), covariance, size=20000)
    point = np.array([0.2, -0.1, 1.5])
    moved = np.cross(draws[:, :3], X[:3, :3] @ point) + draws[:, 3:]
    expected = reach_covariance(covariance, X, point)
    np.testing.assert_allclose(np.cov(moved.T), expected, rtol=0, atol=0.05 * expected.max())
    assert expected_error(covariance, X, 2.0) > expected_error(covariance, X, 0.0)
    few, many = expected_error(covariance, X, 1.0, 6.0), expected_error(covariance, X, 1.0)
    np.testing.assert_allclose(few**2, 1.5 * many**2)
