"""Images of textured flat faces with known camera poses: calibration targets and scenes of boxes (ray casting)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.scan.camera import Camera


@dataclass(frozen=True)
class Face:
    """A rectangle in the plane z = 0 of its own frame, from its origin along x and y, with a grey picture on it.

    ``size``: its sides along x (columns of the picture) and y (rows), in the scene's unit. Both sides show the picture.
    Raises :class:`InputError` for a pose that is not rigid, sides that are no lengths, or a picture of one line.
    """

    T_world_face: Float[np.ndarray, "4 4"]
    size: tuple[float, float]
    texture: Float[np.ndarray, "h w"]

    def __post_init__(self) -> None:
        if not se3.is_rigid(self.T_world_face):
            raise InputError("A face's pose T_world_face must be rigid.")
        if not (np.isfinite(self.size).all() and min(self.size) > 0):
            raise InputError(f"A face's sides must be lengths > 0, not {self.size}.")
        if self.texture.ndim != 2 or min(self.texture.shape) < 2 or not np.isfinite(self.texture).all():
            raise InputError(f"A face's picture must be at least 2 x 2 finite numbers, not {self.texture.shape}.")


def speckle(
    rng: np.random.Generator, shape: tuple[int, int], octaves: Sequence[int] = (4, 8, 16, 32, 64)
) -> Float[np.ndarray, "h w"]:
    """A picture of smooth random blobs of many sizes (``octaves``: pixels a blob), grey values 20 to 235."""
    height, width = shape
    if height < 1 or width < 1:
        raise InputError(f"A picture must have at least 1 x 1 pixel, not {shape}.")
    picture = np.zeros(shape)
    for cell in octaves:
        grid = rng.uniform(-1.0, 1.0, (height // cell + 3, width // cell + 3))
        rows, columns = np.meshgrid(np.arange(height) / cell, np.arange(width) / cell, indexing="ij")
        picture += _interpolate(grid, columns, rows, smooth=True)
    low, high = picture.min(), picture.max()
    return 20.0 + 215.0 * (picture - low) / (high - low)


def box_faces(
    T_world_box: Float[np.ndarray, "4 4"], size: tuple[float, float, float], textures: Sequence[np.ndarray]
) -> list[Face]:
    """The six faces of a box from the origin of its frame to ``size``, a picture each."""
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0, 1):
            T = np.eye(4)
            T[:3, :3] = np.eye(3)[:, [u, v, axis]]
            T[axis, 3] = end * size[axis]
            faces.append(Face(T_world_box @ T, (size[u], size[v]), textures[2 * axis + end]))
    return faces


def photograph(
    faces: Sequence[Face],
    camera: Camera,
    T_world_camera: Float[np.ndarray, "4 4"],
    background: float = 110.0,
    samples: int = 3,
) -> Float[np.ndarray, "h w"]:
    """The grey picture (0 to 255, not rounded) that a camera takes: ``samples x samples`` rays a pixel, nearest face.

    Pictures are read bilinearly: a pixel of theirs should cover about a ray's width. Pixels without a ray (beyond the
    fold of a lens) show the background.
    """
    if samples < 1:
        raise InputError(f"A pixel needs at least one ray, not samples={samples}.")
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    columns, rows = ((np.arange(n)[:, None] + offsets).reshape(-1) for n in (camera.width, camera.height))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
    rays = np.ones((*pixels.shape[:2], 3), np.float32)
    rays[..., :2] = camera.undistort(pixels.reshape(-1, 2)).reshape(pixels.shape)
    nearest = np.full(rays.shape[:2], np.inf, np.float32)
    grey = np.full(rays.shape[:2], background, np.float32)
    for face in faces:
        T_face_camera = se3.inverse(face.T_world_face) @ T_world_camera
        window = _window(face, camera, T_face_camera, samples)
        R, t = T_face_camera[:3, :3].astype(np.float32), T_face_camera[:3, 3].astype(np.float32)
        directions = rays[window] @ R.T
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            depth = -t[2] / directions[..., 2]
            x, y = (depth * directions[..., k] + t[k] for k in (0, 1))
            inside = (depth > 0) & (depth < nearest[window]) & (x >= 0) & (x <= face.size[0]) & (y >= 0)
            inside &= y <= face.size[1]
        height, width = face.texture.shape
        column, row = x[inside] * (width / face.size[0]) - 0.5, y[inside] * (height / face.size[1]) - 0.5
        grey[window][inside] = _interpolate(face.texture, column, row)
        nearest[window][inside] = depth[inside]
    return grey.reshape(camera.height, samples, camera.width, samples).mean(axis=(1, 3), dtype=np.float64)


def _window(face: Face, camera: Camera, T_face_camera: np.ndarray, samples: int) -> tuple[slice, slice]:
    """Rows and columns of the rays that may hit a face: around its corners, or all where one is behind the camera."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]) * [*face.size, 0]
    seen = se3.apply(se3.inverse(T_face_camera), corners)
    if seen[:, 2].min() <= 0 or camera.distortion.any():
        return slice(None), slice(None)
    corner_pixels = camera.project(seen)
    low = np.clip(np.floor(corner_pixels.min(axis=0)) - 1, 0, [camera.width, camera.height]).astype(int) * samples
    high = np.clip(np.ceil(corner_pixels.max(axis=0)) + 2, 0, [camera.width, camera.height]).astype(int) * samples
    return slice(low[1], high[1]), slice(low[0], high[0])


def _interpolate(picture: np.ndarray, x: np.ndarray, y: np.ndarray, smooth: bool = False) -> np.ndarray:
    """Bilinear values at columns x and rows y; beyond the picture its border. ``smooth``: without creases."""
    height, width = picture.shape
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    i, j = np.minimum(x.astype(np.int32), width - 2), np.minimum(y.astype(np.int32), height - 2)
    a, b = x - i, y - j
    if smooth:
        a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
    top = picture[j, i] * (1 - a) + picture[j, i + 1] * a
    bottom = picture[j + 1, i] * (1 - a) + picture[j + 1, i + 1] * a
    return top * (1 - b) + bottom * b
