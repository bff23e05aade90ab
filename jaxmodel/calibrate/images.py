"""Poses of a calibration target from images, and the camera itself where it is not known (OpenCV, CPU)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from jaxmodel.calibrate.intrinsics import FEWEST_CORNERS, estimate_camera, is_view, stray
from jaxmodel.calibrate.target import Target, TargetKind
from jaxmodel.calibrate.target_corners import find_corners
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.scan.camera import Camera

__all__ = ["Target", "TargetKind", "TargetPoses", "target_poses"]

FLATNESS = 0.05  # corners nearer than this share of their spread to one line give no pose
DOUBT = 5.0**2  # the mirrored pose is in the running while it is less than five standard deviations worse


@dataclass(frozen=True)
class TargetPoses:
    """The target's pose in each image, in the unit of the target.

    ``T_camera_target (n, 4, 4)``, ``reprojection_px (n,)`` (root mean square distance of the corners) and ``corners
    (n, m, 2)`` (pixels of ``target.points``) are NaN where the target, or a corner, was not found or not believed.
    ``ambiguous``: the pose mirrored in the image plane fits as well, as far as the corners' noise can tell (a small or
    distant target). ``dropped (n,)``: how many corners were seen but not believed, since they lie far from where all
    the others put them. ``misread``: so many corners were seen, but in an order or at places that no view of the
    target has; such an image counts as not found.
    ``camera``: the one given, or estimated from the same images.
    """

    T_camera_target: Float[np.ndarray, "n 4 4"]
    found: Bool[np.ndarray, " n"]
    reprojection_px: Float[np.ndarray, " n"]
    camera: Camera
    corners: Float[np.ndarray, "n m 2"]
    ambiguous: Bool[np.ndarray, " n"]
    dropped: Int[np.ndarray, " n"]
    misread: Bool[np.ndarray, " n"]


def target_poses(images: Sequence[Path], target: Target, camera: Camera | None = None) -> TargetPoses:
    """Find ``target`` in each image and its pose by least squares on the corners' pixels; poses keep the images' order.

    Corners are found to a fraction of a pixel. A flat target has two candidate poses: both are refined and the better
    is kept (Collins and Bartoli 2014). A chessboard must be seen whole; of ChArUco boards and tags a part is enough.
    Its half turn is settled by its colours. Without ``camera`` the intrinsic parameters are estimated first, with as
    many distortion terms as the images speak for (Bayesian information criterion); at least 3 tilted views are needed.
    Corners in the wrong place are left out of both.

    Images keep the sensor's own orientation. Raises :class:`InputError` for an unreadable image, images of another
    size than the camera's or each other's, a target seen in none of them, images that do not determine the camera, or
    absent OpenCV.
    """
    cv2 = _opencv()
    if not images:
        raise InputError("No images were given.")
    size = None if camera is None else (camera.width, camera.height)
    corners = []
    for path in images:
        grey = _grey(cv2, Path(path))
        seen = (grey.shape[1], grey.shape[0])
        if size is None:
            size = seen
        if seen != size:
            whose = "the first image has" if camera is None else "the camera is for"
            raise InputError(f"{path} has {seen[0]} x {seen[1]} pixels, but {whose} {size[0]} x {size[1]}.")
        corners.append(find_corners(cv2, grey, target))
    assert size is not None
    return poses_of_corners(np.stack(corners), target, camera, size)


def poses_of_corners(
    corners: Float[np.ndarray, "n m 2"], target: Target, camera: Camera | None, size: tuple[int, int]
) -> TargetPoses:
    """As ``target_poses``, from pixels of the target's corners (NaN: not seen) in images of ``size``."""
    cv2 = _opencv()
    corners, n = corners.copy(), len(corners)
    usable = np.array([_spread_out(target.points[np.isfinite(one[:, 0])]) for one in corners])
    seen = np.isfinite(corners[..., 0]).sum(axis=1)
    misread = np.zeros(n, bool)
    for k in np.flatnonzero(usable):
        misread[k] = not is_view(cv2, target.points, corners[k])
    usable &= ~misread
    corners[~usable] = np.nan
    if not usable.any():
        raise InputError(f"None of the {n} images shows the target ({target.sentence}).")
    if camera is None:
        camera, kept = estimate_camera(cv2, target.points, corners[usable], size)
        corners[usable] = np.where(kept[..., None], corners[usable], np.nan)
    poses, error, doubt = np.full((n, 4, 4), np.nan), np.full(n, np.nan), np.zeros(n, bool)
    for k in np.flatnonzero(usable):
        poses[k], error[k], doubt[k], kept = _pose(cv2, target.points, corners[k], camera)
        corners[k, ~kept] = np.nan
    dropped = np.where(usable, seen - np.isfinite(corners[..., 0]).sum(axis=1), 0)
    return TargetPoses(poses, usable, error, camera, corners, doubt, dropped, misread)


def _spread_out(points: Float[np.ndarray, "k 3"]) -> bool:
    """Whether corners are enough, and not all on one line."""
    if len(points) < FEWEST_CORNERS and len(points) != 4:
        return False
    values = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), compute_uv=False)
    return bool(values[1] > FLATNESS * values[0])


class _Pose(NamedTuple):
    T: Float[np.ndarray, "4 4"]
    error: float
    ambiguous: bool
    kept: Bool[np.ndarray, " m"]


def _pose(cv2: Any, points: np.ndarray, corners: np.ndarray, camera: Camera) -> _Pose:
    """The better of a flat target's two poses, without corners that lie far from where all the others put them.

    A tag that something covers in part can be read with a corner in the wrong place. The worst corner is left out, one
    at a time, while it is ``stray``.
    """
    kept = np.isfinite(corners[:, 0])
    while True:
        pose, distance = _two_poses(cv2, points[kept], np.ascontiguousarray(corners[kept]), camera)
        if kept.sum() <= FEWEST_CORNERS or not stray(distance):
            return pose._replace(kept=kept)
        kept[np.flatnonzero(kept)[int(np.argmax(distance))]] = False


def _two_poses(
    cv2: Any, points: np.ndarray, pixels: np.ndarray, camera: Camera
) -> tuple[_Pose, Float[np.ndarray, " k"]]:
    """The better of the two poses, and each corner's distance from its reprojection in pixels."""
    candidates = []
    _, turns, shifts, _ = cv2.solvePnPGeneric(points, pixels, camera.K, camera.distortion, flags=cv2.SOLVEPNP_IPPE)
    for turn, shift in zip(turns, shifts, strict=True):
        turn, shift = cv2.solvePnPRefineLM(points, pixels, camera.K, camera.distortion, turn, shift)
        reprojected = cv2.projectPoints(points, turn, shift, camera.K, camera.distortion)[0].reshape(-1, 2)
        distance = np.linalg.norm(reprojected - pixels, axis=1)
        candidates.append((float(distance @ distance), se3.compose(cv2.Rodrigues(turn)[0], shift.reshape(3)), distance))
    candidates.sort(key=lambda one: one[0])
    squares, T, distance = candidates[0]
    doubt = False
    if len(candidates) > 1 and se3.rotation_angle_deg(candidates[1][1][:3, :3] @ T[:3, :3].T) > 1e-2:
        variance = squares / max(2 * len(points) - 6, 1)
        doubt = candidates[1][0] - squares < DOUBT * variance
    return _Pose(T, float(np.sqrt(squares / len(points))), bool(doubt), np.ones(len(points), bool)), distance


def _grey(cv2: Any, path: Path) -> UInt8[np.ndarray, "h w"]:
    if not path.is_file():
        raise InputError(f"There is no file {path}.")
    data = np.fromfile(path, np.uint8)
    grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION) if len(data) else None
    if grey is None:
        raise InputError(f"{path} cannot be read as an image.")
    return grey


def _opencv() -> Any:
    try:
        import cv2
    except ImportError:
        raise InputError("Targets in images need OpenCV; install it with: pip install 'jaxmodel[images]'.") from None
    return cv2
