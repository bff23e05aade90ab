"""A scene of boxes, a camera that looks at it from nine places, and the pictures it takes."""

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3
from jaxmodel.scan.camera import Camera
from jaxmodel.scan.textured_scene import Face, box_faces, photograph, speckle
from jaxmodel.scan.virtual_scanner import look_at

CAMERA = Camera(np.array([[465.0, 0, 242.0], [0, 463.0, 181.0], [0, 0, 1]]), np.array([-0.08, 0.02]), 480, 360)
T_HAND_CAMERA = se3.compose(Rotation.from_rotvec([0.4, -1.2, 0.7]).as_matrix(), np.array([0.08, -0.05, 0.12]))


def boxes(rng: np.random.Generator) -> list[Face]:
    """Six boxes on a floor, metres, a picture on each face."""
    floor = se3.compose(np.eye(3), np.array([-1.0, -1.0, 0.0]))
    faces = [Face(floor, (2.0, 2.0), speckle(rng, (800, 800)))]
    for k in range(6):
        place = np.array([0.28 * np.cos(1.05 * k) - 0.08, 0.28 * np.sin(1.05 * k) - 0.08, 0.0])
        turn = Rotation.from_euler("z", rng.uniform(0, 6)).as_matrix()
        size = tuple(rng.uniform([0.1, 0.1, 0.06], [0.2, 0.2, 0.3]).tolist())
        faces += box_faces(se3.compose(turn, place), size, [speckle(rng, (160, 160), (4, 8, 16, 32)) for _ in range(6)])
    return faces


def nine_views(rng: np.random.Generator, step_deg: float) -> np.ndarray:
    """T_world_camera on a 3 x 3 grid of directions, ``step_deg`` apart, at unequal distances and rolls."""
    poses = []
    for i, j in np.ndindex(3, 3):
        around, up = np.radians([40 + (j - 1) * step_deg, 50 + (i - 1) * step_deg])
        direction = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
        middle = np.array([0, 0, 0.08]) + 0.05 * rng.normal(size=3)
        T = look_at(1.1 * direction + 0.05 * rng.normal(size=3), middle)
        T[:3, :3] = T[:3, :3] @ Rotation.from_euler("z", np.radians(step_deg * rng.uniform(-1, 1))).as_matrix()
        poses.append(T)
    return np.stack(poses)


def photographs(
    folder: Path, faces: list[Face], poses: np.ndarray, rng: np.random.Generator, blur: float = 0.0, light: float = 0.0
) -> list[Path]:
    """PNG files scene_1, scene_2 .. with noise; ``light``: share by which each picture's brightness varies."""
    paths = []
    for k, T in enumerate(poses, start=1):
        picture = photograph(faces, CAMERA, T, samples=2)
        if blur:
            picture = cv2.GaussianBlur(picture, (0, 0), blur)
        if light:
            picture = picture * rng.uniform(1 - light, 1 + light / 2) + 50 * light * rng.uniform(-1, 1)
        picture = picture + 2.0 * rng.normal(size=picture.shape)
        paths.append(folder / f"scene_{k}.png")
        cv2.imwrite(str(paths[-1]), np.clip(np.round(picture), 0, 255).astype(np.uint8))
    return paths
