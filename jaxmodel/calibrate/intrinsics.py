"""A camera's intrinsic parameters from views of a flat target, without its stray corners; OpenCV comes from images.py.

One corner in the wrong place bends the whole estimate, so estimation and doubt take turns: fit, leave out the worst
corner of each view that lies far from where all the others put it, fit again. Once none is left, corners that were only
bent away by the worse ones return.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.scan.camera import Camera

FEWEST_CORNERS = 6
FEWEST_VIEWS = 3
FOCAL_UNCERTAINTY = 0.05
LEAST_TILT_DEG = 5.0
STRAY, LEAST_STRAY_PX = 6.0, 0.02  # the median of a plane's Gaussian errors is 1.18 sigma: beyond seven sigma
SHAPELESS = 0.05  # corners this share of their spread off every view of a plane are no view of the target
ROUNDS = 30


class Fitted(NamedTuple):
    """``kept``: the corners that are believed, one row for each view."""

    camera: Camera
    kept: Bool[np.ndarray, "v m"]


def stray(distance: Float[np.ndarray, " k"], typical: float | None = None) -> bool:
    """Whether the largest of these distances (px) from the fit is beyond what noise does; ``typical``: their median."""
    typical = float(np.median(distance)) if typical is None else typical
    return bool(distance.max() > STRAY * max(typical, LEAST_STRAY_PX))


def is_view(cv2: Any, points: Float[np.ndarray, "m 3"], corners: Float[np.ndarray, "m 2"]) -> bool:
    """Whether corners can be the target's, seen from its front, a few strays among them.

    A plane's view is a homography that keeps the sense of rotation, up to what a lens bends: corners numbered in a
    mirrored, transposed or random order have none.
    """
    seen = np.isfinite(corners[:, 0])
    pixels, plane = corners[seen], points[seen, :2]
    H, _ = cv2.findHomography(plane, pixels, cv2.LMEDS if len(plane) > 4 else 0)
    if H is None:
        return False
    homogeneous = np.append(plane, np.ones((len(plane), 1)), axis=1) @ H.T
    depth = homogeneous[:, 2]
    if (depth * depth[0] <= 0).any() or np.linalg.det(H) * depth[0] <= 0:
        return False
    off = np.linalg.norm(homogeneous[:, :2] / depth[:, None] - pixels, axis=1)
    spread = np.sqrt(np.mean(np.sum((pixels - np.median(pixels, axis=0)) ** 2, axis=1)))
    return bool(np.median(off) < SHAPELESS * spread)


def estimate_camera(
    cv2: Any, points: Float[np.ndarray, "m 3"], corners: Float[np.ndarray, "v m 2"], size: tuple[int, int]
) -> Fitted:
    """Intrinsic parameters (Zhang 2000), the number of distortion terms by the Bayesian information criterion.

    Stray corners are left out first, with two radial terms. Raises :class:`InputError` for fewer than three views, or
    views that do not determine the camera.
    """
    if len(corners) < FEWEST_VIEWS:
        raise InputError(
            f"The target was found in {len(corners)} images; at least {FEWEST_VIEWS} are needed to estimate the camera "
            "too: give more, or a camera file."
        )
    seen = np.isfinite(corners[..., 0])
    kept, returned = seen, False
    radial = (cv2.CALIB_FIX_K1, cv2.CALIB_FIX_K2, cv2.CALIB_FIX_K3)
    level = cv2.CALIB_ZERO_TANGENT_DIST
    models = ((0, level | sum(radial)), (1, level | radial[1] | radial[2]), (2, level | radial[2]), (5, 0))
    for _ in range(ROUNDS):
        solved = _solve(cv2, points, corners, kept, size, models[2][1])
        if solved is None:
            break
        distance = _distances(cv2, points, corners, solved)
        typical = float(np.median(distance[kept]))
        worst = _worst(np.where(kept, distance, np.nan), typical)
        if worst.any():
            kept = kept & ~worst
            continue
        innocent = seen & ~kept & (distance <= STRAY * max(typical, LEAST_STRAY_PX))
        if returned or not innocent.any():
            break
        kept, returned = kept | innocent, True
    best, lowest = None, np.inf
    count = 2 * int(kept.sum())
    for terms, flags in models:
        solved = _solve(cv2, points, corners, kept, size, flags)
        if solved is None:
            continue
        squares = count / 2 * solved[0] ** 2
        criterion = count * np.log(max(squares / count, 1e-12)) + (4 + terms) * np.log(count)
        if np.isfinite(criterion) and criterion < lowest:
            best, lowest = solved, criterion
    if best is None or not _determined(cv2, best):
        raise InputError(
            f"The {len(corners)} images that show the target do not determine the camera: show it tilted in several "
            "directions, or give a camera file."
        )
    return Fitted(Camera(np.asarray(best[1]), np.asarray(best[2]).reshape(-1), *size), kept)


def _solve(cv2: Any, points: np.ndarray, corners: np.ndarray, kept: np.ndarray, size: tuple[int, int], flags: int):
    """OpenCV's root mean square error, K, distortion, turns and shifts of the views, deviations; or None."""
    known = [points[one].astype(np.float32) for one in kept]
    pixels = [view[one].astype(np.float32) for view, one in zip(corners, kept, strict=True)]
    try:
        return cv2.calibrateCameraExtended(known, pixels, size, None, None, flags=flags)
    except cv2.error:
        return None


def _distances(cv2: Any, points: np.ndarray, corners: np.ndarray, solved: Any) -> Float[np.ndarray, "v m"]:
    """How far each corner lies from its reprojection (px); NaN where it is not seen."""
    distance = np.full(corners.shape[:2], np.nan)
    for k, (turn, shift) in enumerate(zip(solved[3], solved[4], strict=True)):
        seen = cv2.projectPoints(points, turn, shift, solved[1], solved[2])[0].reshape(-1, 2)
        distance[k] = np.linalg.norm(seen - corners[k], axis=1)
    return distance


def _worst(distance: Float[np.ndarray, "v m"], typical: float) -> Bool[np.ndarray, "v m"]:
    """The worst corner of each view, where it is stray by the ``typical`` distance and corners are left to spare."""
    found = np.zeros(distance.shape, bool)
    for k, one in enumerate(distance):
        if np.isfinite(one).sum() > FEWEST_CORNERS and stray(one[np.isfinite(one)], typical):
            found[k, int(np.nanargmax(one))] = True
    return found


def _determined(cv2: Any, solved: Any) -> bool:
    """Whether the focal lengths are known: by their deviations, and since parallel planes say nothing new (Zhang)."""
    unsure = float(np.max(solved[5][:2, 0] / np.diag(solved[1])[:2]))
    normals = np.stack([cv2.Rodrigues(turn)[0][:, 2] for turn in solved[3]])
    cosine = float((normals @ normals.T).min())
    return bool(unsure < FOCAL_UNCERTAINTY and cosine < np.cos(np.radians(LEAST_TILT_DEG)))
