"""Residuals of poses and motions: zero for exact answers, and exactly the error that was put in."""

import numpy as np
import pytest
from calibration_cases import Simulation, motion
from test_motions import streams

from jaxmodel.calibrate.motions import Setup, chain, motion_pairs
from jaxmodel.calibrate.pose_residuals import motion_residuals, pose_residuals


@pytest.mark.parametrize("setup", Setup)
@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_exact_answers_leave_nothing_over(setup, scale):
    hand, camera, X, Z = streams(setup, Simulation(0))
    camera[:, :3, 3] /= scale
    for residual in pose_residuals(hand, camera, setup, X, Z, scale):
        np.testing.assert_allclose(residual, 0, atol=1e-7)  # of an angle from its cosine
    for residual in motion_residuals(motion_pairs(chain(hand, camera, setup)), X, scale):
        np.testing.assert_allclose(residual, 0, atol=1e-12)


@pytest.mark.parametrize("setup", [Setup.EYE_IN_HAND, Setup.EYE_TO_HAND])
def test_a_wrong_pose_has_the_error_that_was_put_in(setup):
    hand, camera, X, Z = streams(setup, Simulation(1))
    camera[3] = motion([0.0, 0.02, 0.0], np.zeros(3)) @ camera[3]
    shift = camera[3, :3, 3].copy()
    camera[5, :3, 3] += [0.003, 0.0, -0.004]
    angle, distance = pose_residuals(hand, camera, setup, X, Z)
    expected = np.zeros((2, len(hand)))
    expected[0, 3], expected[1, 5] = 0.02, 0.005
    expected[1, 3] = np.linalg.norm(shift - np.linalg.inv(motion([0.0, 0.02, 0.0], np.zeros(3)))[:3, :3] @ shift)
    np.testing.assert_allclose(angle, expected[0], atol=1e-7)
    np.testing.assert_allclose(distance, expected[1], atol=1e-9)


def test_each_motion_may_have_a_scale_of_its_own():
    hand, camera, X, _ = streams(Setup.EYE_IN_HAND, Simulation(2))
    motions = motion_pairs(chain(hand, camera, Setup.EYE_IN_HAND), "consecutive")
    scale = np.linspace(0.5, 2.0, len(motions.A))
    motions.A[:, :3, 3] /= scale[:, None]
    assert motion_residuals(motions, X, scale)[1].max() < 1e-12
    assert motion_residuals(motions, X)[1].max() > 1e-3


def test_motions_are_measured_as_hand_first():
    """``A X - X B`` with A the hand's motion: by hand for one pair."""
    hand, camera, X, _ = streams(Setup.EYE_IN_HAND, Simulation(3))
    wrong = X @ motion([0.01, 0.0, 0.02], [0.1, -0.2, 0.3])
    motions = motion_pairs(chain(hand, camera, Setup.EYE_IN_HAND))
    distance = motion_residuals(motions, wrong)[1]
    for k in (0, 7, 20):
        i, j = motions.index[k]
        A, B = np.linalg.inv(hand[i]) @ hand[j], camera[i] @ np.linalg.inv(camera[j])
        assert abs(distance[k] - np.linalg.norm((A @ wrong - wrong @ B)[:3, 3])) < 1e-12
