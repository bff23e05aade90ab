"""Pairs of motions from absolute poses: every set-up closes its loop, and the spread choice excites best."""

import numpy as np
import pytest
from calibration_cases import Simulation, motion

from jaxmodel.calibrate.motions import PairChoice, Setup, chain, excitation, motion_pairs
from jaxmodel.errors import InputError


def streams(setup: Setup, s: Simulation, n: int = 8) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """T_base_hand and the camera's poses of a set-up, from frames named one by one."""
    X, Z, hand = s.X(), s.X(), s.motions(n)
    if setup is Setup.EYE_TO_HAND:  # T_camera_target = T_camera_base T_base_hand T_hand_target
        return hand, np.linalg.inv(X) @ hand @ Z, X, Z
    seen = np.linalg.inv(hand @ X) @ Z  # T_camera_target = T_camera_hand T_hand_base T_base_target
    return hand, np.linalg.inv(seen) if setup is Setup.MOVING_FRAMES else seen, X, Z


@pytest.mark.parametrize("setup", Setup)
def test_the_chain_closes_and_the_pairs_satisfy_their_equation(setup):
    hand, camera, X, Z = streams(setup, Simulation(0))
    poses = chain(hand, camera, setup)
    np.testing.assert_allclose(poses.H @ X @ poses.C, np.broadcast_to(Z, hand.shape), atol=1e-12)
    Y = np.linalg.inv(X)
    choices: tuple[tuple[PairChoice, int], ...] = (("all", 28), ("consecutive", 7), ("spread", 8))
    for choice, count in choices:
        pairs = motion_pairs(poses, choice)
        assert len(pairs.A) == len(pairs.index) == count
        np.testing.assert_allclose(pairs.A @ Y, Y @ pairs.B, atol=1e-12)
        i, j = pairs.index.T
        np.testing.assert_allclose(poses.H[j] @ pairs.B, poses.H[i], atol=1e-12)
        np.testing.assert_allclose(pairs.A @ poses.C[i], poses.C[j], atol=1e-12)


def test_the_spread_choice_is_the_best_of_its_size_by_excitation():
    s = Simulation(1)
    # most poses turn about z, two about x: a good choice takes those
    hand = np.stack([motion([0, 0, 0.1 * k], s.rng.normal(size=3)) for k in range(10)] + [motion([1, 0, 0], [0, 0, 0])])
    poses = chain(hand, hand, Setup.EYE_IN_HAND)
    spread, consecutive = motion_pairs(poses, "spread", 4), motion_pairs(poses, "consecutive")
    assert len(spread.A) == 4
    assert excitation(spread.B).axis_spread > 5 * excitation(consecutive.B[:4]).axis_spread
    assert np.median(excitation(spread.B).angles_deg) > np.median(excitation(consecutive.B).angles_deg)
    assert len(motion_pairs(poses, "spread", 10_000).A) == 55


def test_excitation_of_known_motions():
    parallel = excitation(np.stack([motion([0, 0, a], [a, 0, 0]) for a in (0.1, 0.2, 0.4)]))
    np.testing.assert_allclose(parallel.angles_deg, np.degrees([0.1, 0.2, 0.4]))
    np.testing.assert_allclose(parallel.lengths, [0.1, 0.2, 0.4])
    assert parallel.axis_spread < 1e-15
    even = excitation(np.stack([motion(0.3 * axis, np.zeros(3)) for axis in np.eye(3)]))
    np.testing.assert_allclose(even.axis_spread, 1.0)
    assert excitation(np.zeros((0, 4, 4))).axis_spread == 0.0


def test_few_poses_and_unequal_lengths():
    one = chain(np.eye(4)[None], np.eye(4)[None], Setup.EYE_IN_HAND)
    assert motion_pairs(one).A.shape == (0, 4, 4)
    assert motion_pairs(one, "consecutive").A.shape == (0, 4, 4)
    assert motion_pairs(one, "spread").A.shape == (0, 4, 4)
    with pytest.raises(InputError, match="hand has 2 rows and the camera 3"):
        chain(np.stack([np.eye(4)] * 2), np.stack([np.eye(4)] * 3), Setup.EYE_IN_HAND)


def test_every_setup_says_what_it_is():
    assert len({setup.sentence for setup in Setup}) == len(Setup)
    assert {setup.x_name for setup in Setup} == {"T_hand_camera", "T_base_camera"}
