"""Corners in the wrong place, and whole images misread, change neither the camera nor the poses; they are named."""

import jax
import numpy as np
import pytest
from rendered_targets import CHARUCO, CHESSBOARD, LENS, PINHOLE, TAGS, pose_errors, take, views

from jaxmodel.calibrate import Setup, calibrate_poses
from jaxmodel.calibrate.images import Target, TargetPoses, poses_of_corners, target_poses
from jaxmodel.calibrate.outliers import consensus
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.camera import load_camera
from jaxmodel.io.hand_eye import read_visp_poses

SIZE = (640, 480)
NOISE_PX = 0.1


def projected(target, count=10, seed=0) -> tuple[np.ndarray, np.ndarray]:
    """T_target_camera, and the pixels of a lens with noise."""
    T = views(target, count, seed=seed, distance=0.4, tilt_deg=50.0)
    pixels = np.stack([LENS.project(se3.apply(se3.inverse(one), target.points)) for one in T])
    return T, pixels + NOISE_PX * np.random.default_rng(seed).normal(size=pixels.shape)


def spoiled(corners: np.ndarray, count: int, reach: tuple[float, float], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The corners with ``count`` of them moved by ``reach`` pixels any way, and which."""
    rng = np.random.default_rng(seed)
    moved, wrong = corners.copy(), np.zeros(corners.shape[:2], bool)
    seen = np.argwhere(np.isfinite(corners[..., 0]))
    for k, j in seen[rng.choice(len(seen), count, replace=False)]:
        angle = rng.uniform(0, 2 * np.pi)
        moved[k, j] += rng.uniform(*reach) * np.array([np.cos(angle), np.sin(angle)])
        wrong[k, j] = True
    return moved, wrong


def assert_as_without(found: TargetPoses, corners: np.ndarray, wrong: np.ndarray, target, camera) -> None:
    """``found`` is what the corners give when the wrong ones were never seen."""
    clean = poses_of_corners(np.where(wrong[..., None], np.nan, corners), target, camera, SIZE)
    assert not clean.dropped.any() and not clean.misread.any()
    np.testing.assert_array_equal(found.dropped, wrong.sum(axis=1))
    np.testing.assert_array_equal(np.isnan(found.corners[..., 0]), np.isnan(clean.corners[..., 0]))
    np.testing.assert_allclose(found.camera.K, clean.camera.K, rtol=1e-6)
    # the last coefficients are known to a few 1e-6 where the optimiser stops; one wrong corner moves them by far more
    np.testing.assert_allclose(found.camera.distortion, clean.camera.distortion, atol=1e-5)
    np.testing.assert_allclose(found.T_camera_target, clean.T_camera_target, atol=1e-6)


@pytest.mark.parametrize("target", [CHESSBOARD, CHARUCO, TAGS], ids=lambda target: target.kind)
@pytest.mark.parametrize("known", [False, True], ids=["camera estimated", "camera given"])
@pytest.mark.parametrize("count", [1, 8])
def test_moved_corners_are_left_out(target, known, count):
    camera = LENS if known else None
    for seed, reach in enumerate([(5.0, 6.0), (29.0, 30.0), (5.0, 30.0)]):
        _, corners = projected(target, seed=seed)
        moved, wrong = spoiled(corners, count, reach, seed)
        assert_as_without(poses_of_corners(moved, target, camera, SIZE), corners, wrong, target, camera)


def test_nothing_is_left_out_of_noise_alone():
    """1 080 corners of 20 boards' views: beyond seven standard deviations is one in 10^10."""
    for seed in range(4):
        found = poses_of_corners(projected(CHESSBOARD, 5, seed=10 + seed)[1], CHESSBOARD, None, SIZE)
        assert not found.dropped.any() and not found.misread.any() and found.found.all()


@pytest.mark.parametrize("known", [False, True], ids=["camera estimated", "camera given"])
@pytest.mark.parametrize("order", ["mirrored", "transposed", "random"])
def test_an_image_with_its_corners_in_another_order_is_left_out(order, known):
    """None of these orders is a view of the board's front, whatever the camera."""
    camera = LENS if known else None
    _, corners = projected(CHESSBOARD)
    lattice = np.arange(54).reshape(6, 9)
    numbers = {
        "mirrored": lattice[:, ::-1].reshape(-1),
        "transposed": lattice.T.reshape(-1),
        "random": np.random.default_rng(0).permutation(54),
    }[order]
    misread = corners.copy()
    misread[3] = corners[3, numbers]
    found = poses_of_corners(misread, CHESSBOARD, camera, SIZE)
    np.testing.assert_array_equal(found.misread, np.arange(10) == 3)
    np.testing.assert_array_equal(found.found, np.arange(10) != 3)
    others = np.delete(np.arange(10), 3)
    alone = poses_of_corners(corners[others], CHESSBOARD, camera, SIZE)
    np.testing.assert_allclose(found.camera.K, alone.camera.K, rtol=1e-9)
    np.testing.assert_allclose(found.T_camera_target[others], alone.T_camera_target, atol=1e-9)
    assert np.isnan(found.T_camera_target[3]).all() and np.isnan(found.corners[3]).all()


def test_a_board_read_half_a_turn_off_is_a_view_that_the_robot_contradicts():
    """The grid is its own image under half a turn: only the hand's poses tell."""
    T_target_camera, corners = projected(CHESSBOARD, 12)
    corners[5] = corners[5, ::-1]
    found = poses_of_corners(corners, CHESSBOARD, None, SIZE)
    assert found.found.all() and not found.misread.any()
    T_hand_camera = se3.compose(np.diag([-1.0, -1.0, 1.0]), np.array([0.05, -0.03, 0.1]))
    hand = T_target_camera @ se3.inverse(T_hand_camera)
    agreed = consensus(hand, found.T_camera_target, jax.random.key(0), Setup.EYE_IN_HAND)
    np.testing.assert_array_equal(agreed.inlier, np.arange(12) != 5)


def test_images_that_are_all_misread_show_no_target():
    _, corners = projected(CHESSBOARD, 3)
    with pytest.raises(InputError, match="None of the 3 images shows the target"):
        poses_of_corners(corners[:, np.random.default_rng(0).permutation(54)], CHESSBOARD, None, SIZE)


@pytest.mark.slow
@pytest.mark.parametrize("target", [CHESSBOARD, TAGS], ids=lambda target: target.kind)
def test_stray_corners_of_rendered_images(tmp_path, target):
    T_target_camera = views(target, 8, seed=6, distance=0.4, tilt_deg=50.0)
    corners = target_poses(take(tmp_path, target, T_target_camera), target).corners
    moved, wrong = spoiled(corners, 5, (5.0, 30.0), 0)
    found = poses_of_corners(moved, target, None, SIZE)
    assert_as_without(found, corners, wrong, target, None)
    angle, distance = pose_errors(found.T_camera_target, se3.inverse(T_target_camera))
    assert angle.max() < 0.5 and 1e3 * distance.max() < 4.0
    np.testing.assert_allclose(np.diag(found.camera.K)[:2] / np.diag(PINHOLE.K)[:2], 1.0, atol=0.01)


@pytest.mark.data
def test_stray_corners_of_visps_images(data_dir):
    """A corner of each image moved: the camera, estimated from these images, and the answer stay what they were."""
    folder, board = data_dir / "handeye" / "visp_franka_eye_in_hand", Target("chessboard", 9, 6, 0.0236)
    camera = load_camera(folder / "franka_camera.xml")
    corners = target_poses([folder / f"franka_image-{k}.png" for k in range(1, 9)], board, camera).corners
    hand = np.stack(list(read_visp_poses(folder).values()))
    moved, wrong = corners.copy(), np.zeros((8, 54), bool)
    for k, length in enumerate(np.linspace(5.0, 30.0, 8)):
        wrong[k, 7 * k] = True
        moved[k, 7 * k] += length * np.array([np.cos(k), np.sin(k)])
    for given in (camera, None):
        assert_as_without(poses_of_corners(moved, board, given, SIZE), corners, wrong, board, given)
    found = poses_of_corners(moved, board, camera, SIZE)
    whole = poses_of_corners(corners, board, camera, SIZE)
    X, expected = (calibrate_poses(hand, one.T_camera_target).X for one in (found, whole))
    angle, distance = pose_errors(X[None], expected[None])
    assert angle[0] < 0.5 and 1e3 * distance[0] < 2.0
