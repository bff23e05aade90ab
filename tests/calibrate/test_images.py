"""Target poses from rendered images of known truth and from real ones; bad images get one sentence."""

import sys

import cv2
import numpy as np
import pytest
from rendered_targets import CHARUCO, CHESSBOARD, LENS, PINHOLE, SINGLE_TAG, TAGS, TARGETS, pose_errors, take, views
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import Outcome, Setup, calibrate_poses
from jaxmodel.calibrate.images import Target, target_poses
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.camera import load_camera
from jaxmodel.io.hand_eye import read_visp_poses
from jaxmodel.scan.camera import Camera

FINE_DEG, FINE_MM = 0.5, 2.0  # what the calibration from images is asked to reach


@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "lens"])
@pytest.mark.parametrize("name", TARGETS)
def test_poses_of_rendered_targets(tmp_path, name, camera):
    target = TARGETS[name]
    T_target_camera = views(target, 3)
    found = target_poses(take(tmp_path, target, T_target_camera, camera), target, camera)
    assert found.found.all() and not found.ambiguous.any()
    angle, distance = pose_errors(found.T_camera_target, se3.inverse(T_target_camera))
    assert angle.max() < FINE_DEG and 1e3 * distance.max() < FINE_MM
    # what is left is the noise of the corners: their mean square error is that of the reprojection and the pose's
    true = np.stack([camera.project(se3.apply(T, target.points)) for T in se3.inverse(T_target_camera)])
    assert np.sqrt(np.nanmean((found.corners - true) ** 2)) < 0.1
    assert found.reprojection_px.max() < 0.15
    assert found.camera is camera


@pytest.mark.parametrize(("noise", "blur"), [(0.0, 0.0), (8.0, 0.7), (2.0, 2.0)])
@pytest.mark.parametrize("target", [CHESSBOARD, CHARUCO, TAGS], ids=lambda target: target.kind)
def test_noise_and_blur(tmp_path, target, noise, blur):
    T_target_camera = views(target, 2, seed=1)
    found = target_poses(take(tmp_path, target, T_target_camera, noise=noise, blur=blur), target, PINHOLE)
    angle, distance = pose_errors(found.T_camera_target, se3.inverse(T_target_camera))
    assert angle.max() < FINE_DEG and 1e3 * distance.max() < FINE_MM


@pytest.mark.parametrize("target", [CHARUCO, TAGS], ids=lambda target: target.kind)
def test_a_part_of_a_board_with_markers_is_enough(tmp_path, target):
    T_target_camera = views(target, 3, seed=2)
    found = target_poses(take(tmp_path, target, T_target_camera, hide=0.45), target, PINHOLE)
    assert found.found.all()
    seen = np.isfinite(found.corners[..., 0]).sum(axis=1)
    assert (seen < len(target.points)).all() and (seen >= 4).all()
    angle, distance = pose_errors(found.T_camera_target, se3.inverse(T_target_camera))
    assert angle.max() < FINE_DEG and 1e3 * distance.max() < FINE_MM


def test_hidden_chessboards_and_empty_images_keep_their_places(tmp_path):
    T_target_camera = views(CHESSBOARD, 2, seed=3)
    whole = take(tmp_path / "whole", CHESSBOARD, T_target_camera)
    hidden = take(tmp_path / "hidden", CHESSBOARD, T_target_camera[:1], hide=0.5)
    empty = tmp_path / "empty.png"
    cv2.imwrite(str(empty), np.full((480, 640), 90, np.uint8))
    found = target_poses([whole[0], empty, hidden[0], whole[1]], CHESSBOARD, PINHOLE)
    np.testing.assert_array_equal(found.found, [True, False, False, True])
    for value in (found.T_camera_target, found.reprojection_px, found.corners):
        assert np.isnan(value[1:3]).all() and np.isfinite(value[[0, 3]]).all()
    alone = target_poses(whole, CHESSBOARD, PINHOLE)
    np.testing.assert_allclose(alone.T_camera_target, found.T_camera_target[[0, 3]], atol=1e-8)


@pytest.mark.parametrize("flip", [False, True])
def test_the_half_turn_of_a_chessboard_is_told_by_its_colours(tmp_path, flip):
    """A camera rolled by any angle, half a turn included, sees the same frame."""
    T_target_camera = np.repeat(views(CHESSBOARD, 1, seed=4), 5, axis=0)
    target = CHESSBOARD
    if flip:
        target = Target("chessboard", 6, 9, CHESSBOARD.square)
        T_target_camera = np.repeat(views(target, 1, seed=4), 5, axis=0)
    rolls = Rotation.from_rotvec(np.radians(np.linspace(0, 288, 5))[:, None] * [0, 0, 1]).as_matrix()
    T_target_camera[:, :3, :3] = T_target_camera[:, :3, :3] @ rolls
    found = target_poses(take(tmp_path, target, T_target_camera), target, PINHOLE)
    seen = found.found
    assert seen.sum() >= 3
    angle, distance = pose_errors(found.T_camera_target[seen], se3.inverse(T_target_camera)[seen])
    assert angle.max() < FINE_DEG and 1e3 * distance.max() < FINE_MM


def test_a_small_far_tag_is_ambiguous_and_a_near_one_is_not(tmp_path):
    near = target_poses(take(tmp_path / "near", SINGLE_TAG, views(SINGLE_TAG, 2)), SINGLE_TAG, PINHOLE)
    distant = views(SINGLE_TAG, 4, seed=5, distance=4.0, tilt_deg=12.0)
    far = target_poses(take(tmp_path / "far", SINGLE_TAG, distant, noise=8.0), SINGLE_TAG, PINHOLE)
    assert not near.ambiguous.any() and far.ambiguous.any()


def test_grey_and_colour_are_the_same(tmp_path):
    grey = take(tmp_path, CHARUCO, views(CHARUCO, 1))[0]
    colour = tmp_path / "colour.bmp"
    picture = cv2.imread(str(grey), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    cv2.imwrite(str(colour), cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    found = target_poses([grey, colour], CHARUCO, PINHOLE)
    np.testing.assert_allclose(found.T_camera_target[0], found.T_camera_target[1], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("camera", [PINHOLE, LENS], ids=["pinhole", "lens"])
def test_the_camera_is_estimated(tmp_path, camera):
    T_target_camera = views(CHARUCO, 12, seed=6, distance=0.4, tilt_deg=50.0)
    found = target_poses(take(tmp_path, CHARUCO, T_target_camera, camera), CHARUCO)
    focal = np.diag(found.camera.K)[:2] / np.diag(camera.K)[:2]
    np.testing.assert_allclose(focal, 1.0, atol=0.005)
    np.testing.assert_allclose(found.camera.K[:2, 2], camera.K[:2, 2], atol=3.0)
    assert (found.camera.distortion.size > 0) == (camera is LENS)
    angle, distance = pose_errors(found.T_camera_target, se3.inverse(T_target_camera))
    assert angle.max() < FINE_DEG and 1e3 * distance.max() < 2 * FINE_MM


@pytest.mark.slow
@pytest.mark.parametrize("setup", [Setup.EYE_IN_HAND, Setup.EYE_TO_HAND])
def test_hand_eye_from_rendered_images(tmp_path, setup):
    rng = np.random.default_rng(7)
    X, Z = (se3.compose(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * size) for size in (0.05, 0.5))
    T_target_camera = views(CHESSBOARD, 8, seed=7)
    # H X C = Z with H the hand in the base, or for a fixed camera the base in the hand
    H = Z @ T_target_camera @ se3.inverse(X)
    hand = H if setup is Setup.EYE_IN_HAND else se3.inverse(H)
    found = target_poses(take(tmp_path, CHESSBOARD, T_target_camera), CHESSBOARD, PINHOLE)
    answer = calibrate_poses(hand, found.T_camera_target, setup)
    assert answer.outcome is Outcome.SOLVED
    for one, true in ((answer.X, X), (answer.Z, Z)):
        angle, distance = pose_errors(one[None], true[None])
        assert angle[0] < FINE_DEG and 1e3 * distance[0] < FINE_MM


@pytest.fixture(scope="module")
def visp(data_dir):
    folder = data_dir / "handeye" / "visp_franka_eye_in_hand"
    images = [folder / f"franka_image-{k}.png" for k in range(1, 9)]
    target = Target("chessboard", 9, 6, 0.0236)
    return read_visp_poses(folder), target_poses(images, target, load_camera(folder / "franka_camera.xml"))


@pytest.mark.data
@pytest.mark.parametrize("method", ["joint", "linear", "nonlinear", "park", "tsai_lenz", "dual_quaternion"])
def test_visp_franka_from_its_images(visp, method):
    """Within 2 mm and 0.5 degrees of what ViSP's documentation prints for these files."""
    hand, found = visp
    assert found.found.all()
    X = calibrate_poses(np.stack(list(hand.values())), found.T_camera_target, method=method).X
    published = se3.compose(
        Rotation.from_rotvec([0.00178, 0.00917, 1.58178]).as_matrix(), np.array([0.05772, -0.03392, -0.04228])
    )
    angle, distance = pose_errors(X[None], published[None])
    assert angle[0] < 0.5 and 1e3 * distance[0] < 2.0


@pytest.mark.data
def test_the_corners_are_those_of_an_independent_detection(visp, data_dir):
    """Oracle: corners of the same images found with another version of OpenCV, up to a half turn of the board.

    Where the two lie more than a pixel apart (3 of the 432), ours must fit the board better.
    """
    table = np.genfromtxt(
        data_dir / "handeye" / "visp_franka_eye_in_hand" / "corners_opencv.csv", delimiter=",", dtype=str
    )
    differ = 0
    for k, corners in enumerate(visp[1].corners):
        other = table[table[:, 0] == f"franka_image-{k + 1}.png"][:, 2:].astype(float)
        apart, other = min(((np.abs(corners - one).max(axis=1), one) for one in (other, other[::-1])),
                           key=lambda pair: pair[0].max())  # fmt: skip
        theirs, ours = (off_the_board(one, visp[1].camera) for one in (other, corners))
        far = apart >= 1.0
        differ += np.count_nonzero(far)
        assert (ours[far] < theirs[far]).all()
    assert differ <= 4


def off_the_board(corners: np.ndarray, camera) -> np.ndarray:
    """How far, in pixels, each corner lies from the 9 x 6 board that fits all of them best."""
    board = np.append(np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), -1).reshape(-1, 2), np.zeros((54, 1)), 1)
    _, turn, place = cv2.solvePnP(board, corners, camera.K, camera.distortion)
    seen = cv2.projectPoints(board, turn, place, camera.K, camera.distortion)[0][:, 0]
    return np.linalg.norm(seen - corners, axis=1)


@pytest.mark.data
def test_a_real_stereo_pair_with_both_cameras_estimated(data_dir):
    """Both cameras estimated from their own images; the baseline is that of stereo calibrations of the same files."""
    folder, target = data_dir / "stereo" / "chessboard_pairs", Target("chessboard", 9, 6, 1.0)
    left, right = (
        target_poses([folder / f"{side}{k:02}.jpg" for k in range(1, 9)], target) for side in ("left", "right")
    )
    assert left.found.all() and right.found.all()
    assert max(left.reprojection_px.max(), right.reprojection_px.max()) < 0.5
    T_right_left = right.T_camera_target @ se3.inverse(left.T_camera_target)
    baseline = np.median(T_right_left[:, :3, 3], axis=0)
    assert np.abs(baseline - [-3.33, 0.04, -0.006]).max() < 0.1
    assert np.median(se3.rotation_angle_deg(T_right_left[:, :3, :3])) < 2.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("circles", 9, 6, 1.0), "must be one of chessboard, charuco, apriltag, not 'circles'"),
        (("chessboard", 8, 6, 1.0), "8 x 6 inner corners looks the same after half a turn"),
        (("chessboard", 9, 2, 1.0), "at least 3 x 3"),
        (("chessboard", 9, 6, 0.0), "square must be a length > 0"),
        (("chessboard", 9, 6, float("nan")), "square must be a length > 0"),
        (("charuco", 7, 5, 0.04, 0.05, "5X5_100"), "marker must be a length > 0, at most its square"),
        (("charuco", 7, 5, 0.04, 0.03, "5X5_99"), "dictionary must be one of 4X4_50"),
        (("charuco", 15, 15, 0.04, 0.03, "5X5_100"), "has 112 markers, but 5X5_100 holds only 100"),
        (("apriltag", 0, 1, 0.04, 0.03, "APRILTAG_36h11"), "at least 1 x 1"),
    ],
)
def test_a_target_that_cannot_be_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        Target(*values)


def test_bad_images_are_named(tmp_path):
    images = take(tmp_path, CHARUCO, views(CHARUCO, 2))
    broken, cut = tmp_path / "broken.png", tmp_path / "empty.png"
    broken.write_bytes(images[0].read_bytes()[:40])
    cut.write_bytes(b"")
    for path in (broken, cut):
        with pytest.raises(InputError, match=rf"{path.name} cannot be read as an image"):
            target_poses([images[0], path], CHARUCO, PINHOLE)
    with pytest.raises(InputError, match=r"There is no file .*none\.png"):
        target_poses([tmp_path / "none.png"], CHARUCO, PINHOLE)
    with pytest.raises(InputError, match="No images were given"):
        target_poses([], CHARUCO, PINHOLE)
    with pytest.raises(InputError, match=r"view_00\.png has 640 x 480 pixels, but the camera is for 1280 x 720"):
        target_poses(images, CHARUCO, Camera(PINHOLE.K, np.zeros(0), 1280, 720))
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((240, 320), np.uint8))
    with pytest.raises(InputError, match=r"small\.png has 320 x 240 pixels, but the first image has 640 x 480"):
        target_poses([images[0], small], CHARUCO)
    with pytest.raises(InputError, match=r"None of the 2 images shows the target \(chessboard of 9 x 6 inner corners"):
        target_poses(images, CHESSBOARD, PINHOLE)


def test_images_that_do_not_determine_the_camera_are_refused(tmp_path):
    images = take(tmp_path / "two", CHARUCO, views(CHARUCO, 2))
    with pytest.raises(InputError, match="found in 2 images; at least 3"):
        target_poses(images, CHARUCO)
    flat = np.repeat(views(CHARUCO, 1, tilt_deg=10.0), 4, axis=0)
    middle = CHARUCO.points.mean(axis=0)
    flat[:, :3, :3], flat[:, :3, 3] = np.eye(3), middle - [0, 0, 0.5]
    flat[:, 0, 3] += [-0.02, -0.01, 0.0, 0.02]
    with pytest.raises(InputError, match="do not determine the camera"):
        target_poses(take(tmp_path / "flat", CHARUCO, flat), CHARUCO)


def test_absent_opencv_is_said(tmp_path, monkeypatch):
    images = take(tmp_path, CHARUCO, views(CHARUCO, 1))
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=r"pip install 'jaxmodel\[images\]'"):
        target_poses(images, CHARUCO, PINHOLE)
