"""From absolute poses to named frames, on simulated and on the four real sets."""

import numpy as np
import pytest
from calibration_cases import Simulation, errors, motion
from scipy.spatial.transform import Rotation
from test_motions import streams

from jaxmodel.calibrate.conclude import pair_residuals
from jaxmodel.calibrate.motions import Setup, chain, motion_pairs
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.poses import HandEye, calibrate_poses, joint_many
from jaxmodel.calibrate.solve import METHODS
from jaxmodel.calibrate.synchronise import ordered, synchronise
from jaxmodel.errors import InputError
from jaxmodel.io.hand_eye import read_labelled_csv, read_pairs_storage, read_timed_csv


@pytest.mark.parametrize("setup", Setup)
@pytest.mark.parametrize("method", ["joint", "linear"])
def test_every_setup_returns_its_two_frames(setup, method):
    hand, camera, X, Z = streams(setup, Simulation(0))
    found = calibrate_poses(hand, camera, setup, method)
    assert found.outcome is Outcome.SOLVED
    assert max(*errors(found.X, X), *errors(found.Z, Z)) < 1e-9
    for name, T in found.transforms.items():
        to, of = name.removeprefix("T_").split("_")
        np.testing.assert_allclose(T @ found.transforms[f"T_{of}_{to}"], np.eye(4), atol=1e-12)
    assert len(found.transforms) == 4


@pytest.mark.parametrize("setup", Setup)
def test_an_unknown_scale_belongs_to_the_camera(setup):
    hand, camera, X, Z = streams(setup, Simulation(1))
    camera[:, :3, 3] /= 4.0
    for method in ("joint", "linear", "nonlinear"):
        found = calibrate_poses(hand, camera, setup, method, unknown_scale=True)
        assert max(*errors(found.X, X), *errors(found.Z, Z)) < 1e-8
        assert abs(found.scale / 4 - 1) < 1e-8


def test_partial_motions_give_a_partial_answer():
    s = Simulation(2)
    X, Z = s.X(), s.X()
    hand = np.stack([motion([0, 0, a], s.rng.normal(size=3)) for a in (0.0, 0.4, 1.0, -0.7)])
    found = calibrate_poses(hand, np.linalg.inv(hand @ X) @ Z)
    assert found.outcome is Outcome.TRANSLATION_ALONG_AXIS
    assert errors(found.X, X)[0] < 1e-9
    assert found.covariance is None


def test_bad_input_is_named():
    hand, camera, _, _ = streams(Setup.EYE_IN_HAND, Simulation(3))
    with pytest.raises(InputError, match="1 pose gives no motion"):
        calibrate_poses(hand[:1], camera[:1])
    with pytest.raises(InputError, match="hand has 8 rows and the camera 7"):
        calibrate_poses(hand, camera[:7])
    with pytest.raises(InputError, match="camera, row 2: expected a rigid motion"):
        calibrate_poses(hand, camera * np.where(np.arange(8) == 2, 1.1, 1.0)[:, None, None])
    with pytest.raises(InputError, match="method must be one of joint, linear"):
        calibrate_poses(hand, camera, method="tsai")
    with pytest.raises(InputError, match="weights must be 8"):
        calibrate_poses(hand, camera, weights=np.ones(3))


@pytest.mark.parametrize("method", ["joint", *sorted(METHODS)])
@pytest.mark.parametrize("pairs", ["all", "spread"])
def test_the_order_of_the_poses_does_not_matter(method, pairs):
    """Pairs are made in an order of their own, so a permutation of the rows is no other problem."""
    s = Simulation(4)
    hand, camera, _, _ = streams(Setup.EYE_IN_HAND, s)
    camera = s.noisy(camera, 0.01, 0.02)
    hand[3], camera[3] = hand[6], camera[6]  # a pose taken twice
    plain = calibrate_poses(hand, camera, method=method, pairs=pairs)
    for _ in range(3):
        order = s.rng.permutation(len(hand))
        again = calibrate_poses(hand[order], camera[order], method=method, pairs=pairs)
        np.testing.assert_allclose(again.X, plain.X, rtol=0, atol=1e-9)
        np.testing.assert_allclose(again.Z, plain.Z, rtol=0, atol=1e-9)


def test_a_thousand_orders_of_the_poses():
    """The pairs of every order are the same ones, and ``joint`` gives the same X (and Z) whatever the order."""
    s = Simulation(5)
    hand, camera, _, _ = streams(Setup.EYE_IN_HAND, s)
    camera = s.noisy(camera, 0.01, 0.02)
    reference = motion_pairs(chain(hand, camera, Setup.EYE_IN_HAND))
    orders = np.stack([s.rng.permutation(8) for _ in range(1000)])
    for order in orders:
        pairs = motion_pairs(chain(hand[order], camera[order], Setup.EYE_IN_HAND))
        np.testing.assert_array_equal(pairs.A, reference.A)
        np.testing.assert_array_equal(pairs.B, reference.B)
        np.testing.assert_array_equal(order[pairs.index], reference.index)
    found = joint_many(hand[orders], camera[orders])
    for T in (found.X, found.Z):
        assert max(np.ptp(T.R, axis=0).max(), np.ptp(T.t, axis=0).max()) < 1e-9


def residual_medians(found: HandEye, hand: np.ndarray, camera: np.ndarray, setup: Setup) -> tuple[float, float]:
    """Median angle (deg) and distance (mm) of A X - X B over all pairs, X the camera on the hand."""
    pairs = motion_pairs(chain(hand, camera, setup))
    angle, distance = pair_residuals(np.linalg.inv(pairs.B), np.linalg.inv(pairs.A), found.X)
    return float(np.degrees(np.median(angle))), 1e3 * float(np.median(distance))


def check_set(hand, camera, setup, limits, methods):
    """The best pair method has the residuals of the data's own description; joint agrees within its uncertainty."""
    found = {method: calibrate_poses(hand, camera, setup, method) for method in (*methods, "joint")}
    assert all(one.outcome is Outcome.SOLVED for one in found.values())
    medians = [residual_medians(found[method], hand, camera, setup) for method in methods]
    assert any(angle <= 1.03 * limits[0] and distance <= 1.03 * limits[1] for angle, distance in medians), medians
    joint = found["joint"]
    pairs = residual_medians(joint, hand, camera, setup)
    assert pairs[0] < 1.1 * limits[0] and pairs[1] < 1.2 * limits[1]
    return found


@pytest.mark.data
def test_lixiny(data_dir):
    poses = read_pairs_storage(data_dir / "handeye" / "lixiny_aruco" / "TransformPairsInput.yml")
    found = check_set(
        poses.hand, poses.camera, Setup.MOVING_FRAMES, (0.87, 14.0), ("linear", "dual_quaternion", "nonlinear")
    )
    assert Rotation.from_matrix(found["joint"].X[:3, :3]).magnitude() > 2.0


@pytest.mark.data
def test_aubo_where_x_is_nearly_a_half_turn(data_dir):
    poses = read_labelled_csv(data_dir / "handeye" / "fishros_aubo_i5" / "base_aubo_i5_data.csv", "deg")
    check_set(poses.hand, poses.camera, Setup.EYE_IN_HAND, (1.5, 10.0), ("linear", "nonlinear_b", "tsai_lenz"))


@pytest.mark.data
def test_eth_with_the_offset_of_its_clocks(data_dir):
    folder = data_dir / "handeye" / "ethz_robot_arm_sim"
    hand, camera = (read_timed_csv(folder / f"robot_arm_sim_{name}.csv") for name in ("hand", "camera"))
    both = synchronise(ordered(hand.times, hand.poses), ordered(camera.times, camera.poses))
    rows = np.linspace(0, len(both.hand) - 1, 40).astype(int)
    check_set(both.hand[rows], both.camera[rows], Setup.MOVING_FRAMES, (0.35, 5.0), ("linear", "nonlinear"))
