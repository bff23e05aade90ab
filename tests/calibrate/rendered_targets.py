"""Pictures of calibration targets with known camera and poses."""

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.images import Target
from jaxmodel.geometry import se3
from jaxmodel.scan.camera import Camera
from jaxmodel.scan.textured_scene import Face, photograph
from jaxmodel.scan.virtual_scanner import look_at

CHESSBOARD = Target("chessboard", 9, 6, 0.03)
CHARUCO = Target("charuco", 7, 5, 0.04, 0.03, "DICT_5X5_100")
TAGS = Target("apriltag", 4, 3, 0.06, 0.048, "APRILTAG_36h11")
SINGLE_TAG = Target("apriltag", 1, 1, 0.16, 0.16, "APRILTAG_36h11")
TARGETS = {"chessboard": CHESSBOARD, "charuco": CHARUCO, "tags": TAGS, "single tag": SINGLE_TAG}

PINHOLE = Camera(np.array([[620.0, 0, 324.5], [0, 615.0, 236.0], [0, 0, 1]]), np.zeros(0), 640, 480)
LENS = Camera(PINHOLE.K, np.array([-0.12, 0.05, 1e-3, -5e-4]), 640, 480)
PIXELS_A_CELL = 40


def printed(target: Target) -> Face:
    """The printed sheet in the target's frame, a white margin around it."""
    if target.kind == "chessboard":
        squares = np.add.outer(np.arange(target.rows + 1), np.arange(target.columns + 1)) % 2
        # the square inside the first corner is black, and so is the one across that corner
        picture = np.kron(np.where(squares == 0, 0, 255), np.ones((PIXELS_A_CELL, PIXELS_A_CELL)))
        pixel, start = target.square / PIXELS_A_CELL, -target.square
    else:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{target.dictionary_name}"))
        start = 0.0
        if target.kind == "charuco":
            board = cv2.aruco.CharucoBoard((target.columns, target.rows), target.square, target.marker, dictionary)
            picture = board.generateImage((PIXELS_A_CELL * target.columns, PIXELS_A_CELL * target.rows))
            pixel = target.square / PIXELS_A_CELL
        else:
            side = 64
            pixel = target.marker / side
            pitch = round(target.square / pixel)
            picture = np.full(((target.rows - 1) * pitch + side, (target.columns - 1) * pitch + side), 255)
            for k in range(target.columns * target.rows):
                row, column = k // target.columns * pitch, k % target.columns * pitch
                picture[row : row + side, column : column + side] = cv2.aruco.generateImageMarker(dictionary, k, side)
    margin = 20
    picture = np.pad(10.0 + 235.0 / 255.0 * picture, margin, constant_values=245.0)
    origin = se3.compose(np.eye(3), np.array([start - margin * pixel, start - margin * pixel, 0.0]))
    return Face(origin, (picture.shape[1] * pixel, picture.shape[0] * pixel), picture)


def views(target: Target, count: int, seed: int = 0, distance: float = 0.5, tilt_deg: float = 35.0) -> np.ndarray:
    """T_target_camera of cameras in front of the target (its -z side), tilted and rolled, all of it in the picture."""
    rng = np.random.default_rng(seed)
    middle = target.points.mean(axis=0)
    poses = []
    for _ in range(count):
        tilt, turn = np.radians(rng.uniform(10, tilt_deg)), rng.uniform(0, 2 * np.pi)
        away = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)])
        T = look_at(middle + distance * rng.uniform(0.95, 1.2) * away, middle + 0.01 * rng.normal(size=3) * [1, 1, 0],
                    up=np.array([0.0, -1.0, 0.0]))  # fmt: skip
        T[:3, :3] = T[:3, :3] @ Rotation.from_euler("z", rng.uniform(-0.7, 0.7)).as_matrix()
        poses.append(T)
    return np.stack(poses)


def take(
    folder: Path,
    target: Target,
    poses: np.ndarray,
    camera: Camera = PINHOLE,
    noise: float = 2.0,
    blur: float = 0.7,
    hide: float = 0.0,
) -> list[Path]:
    """PNG files of the target from poses T_target_camera; ``hide``: share of the picture's width covered in grey."""
    rng, sheet, paths = np.random.default_rng(1), printed(target), []
    folder.mkdir(parents=True, exist_ok=True)
    for k, T in enumerate(poses):
        picture = photograph([sheet], camera, T, samples=2)
        if hide:
            picture[:, : int(hide * camera.width)] = 128.0
        if blur:
            picture = cv2.GaussianBlur(picture, (0, 0), blur)
        picture = picture + noise * rng.normal(size=picture.shape)
        paths.append(folder / f"view_{k:02}.png")
        cv2.imwrite(str(paths[-1]), np.clip(np.round(picture), 0, 255).astype(np.uint8))
    return paths


def pose_errors(found: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles (deg) and distances between two lists of poses."""
    turn = se3.rotation_angle_deg(np.swapaxes(found[:, :3, :3], 1, 2) @ true[:, :3, :3])
    return np.atleast_1d(turn), np.linalg.norm(found[:, :3, 3] - true[:, :3, 3], axis=1)
