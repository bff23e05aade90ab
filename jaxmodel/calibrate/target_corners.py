"""Where a target's corners are in an image, to a fraction of a pixel; OpenCV comes as an argument from images.py."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from jaxmodel.calibrate.target import Target

BENT_EDGE_PX = 40.0
FARTHEST_PX = 3.0  # a refined corner of a tag that moves further is not believed


def find_corners(cv2: Any, grey: UInt8[np.ndarray, "h w"], target: Target) -> Float[np.ndarray, "m 2"]:
    """Pixels of the target's corners, NaN where not seen."""
    corners = np.full((len(target.points), 2), np.nan)
    if target.kind == "chessboard":
        found = _chessboard(cv2, grey, target.columns, target.rows)
        return corners if found is None else found
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{target.dictionary_name}"))
    if target.kind == "charuco":
        board = cv2.aruco.CharucoBoard((target.columns, target.rows), target.square, target.marker, dictionary)
        pixels, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        if numbers is not None:
            pixels, numbers = pixels.reshape(-1, 2).astype(np.float32), numbers.reshape(-1)
            shift = target.points[numbers[:, None], :2] - target.points[None, numbers, :2]
            # the window stops short of the markers' own edges
            reach = 0.45 * (1 - target.marker / target.square)
            corners[numbers] = _refined(cv2, grey, pixels, np.linalg.norm(shift, axis=2) / target.square, reach)
        return corners
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    tags, numbers, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(grey)
    cells = dictionary.markerSize + 2
    for tag, number in zip(tags, [] if numbers is None else numbers.reshape(-1), strict=True):
        if number < target.columns * target.rows:
            corners[4 * number : 4 * number + 4] = _tag_corners(cv2, grey, tag.reshape(4, 2), cells)
    return corners


def _chessboard(cv2: Any, grey: UInt8[np.ndarray, "h w"], columns: int, rows: int) -> Float[np.ndarray, "m 2"] | None:
    """Inner corners, the first with a black inner square, the rows running clockwise of the columns; or None."""
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, pixels = cv2.findChessboardCornersSB(grey, (columns, rows), flags=flags)
    if not found:
        found, pixels = cv2.findChessboardCorners(grey, (columns, rows))
        if not found:
            return None
    lattice = pixels.reshape(rows, columns, 2).astype(np.float32)
    (ax, ay), (bx, by) = lattice[0, -1] - lattice[0, 0], lattice[-1, 0] - lattice[0, 0]
    if ax * by - ay * bx < 0:
        lattice = lattice[:, ::-1]
    middle = (lattice[1:, 1:] + lattice[1:, :-1] + lattice[:-1, 1:] + lattice[:-1, :-1]) / 4
    shade = cv2.remap(grey, np.ascontiguousarray(middle), None, cv2.INTER_LINEAR).astype(np.float64)
    even = np.add.outer(np.arange(rows - 1), np.arange(columns - 1)) % 2 == 0
    if shade[even].mean() > shade[~even].mean():
        lattice = lattice[::-1, ::-1]
    pixels = np.ascontiguousarray(lattice.reshape(-1, 2))
    k = np.arange(rows * columns)
    cells = np.stack([k % columns, k // columns], axis=1).astype(float)
    return _refined(cv2, grey, pixels, np.linalg.norm(cells[:, None] - cells[None], axis=2), 1 / 3)


def _refined(
    cv2: Any, grey: UInt8[np.ndarray, "h w"], pixels: np.ndarray, apart: Float[np.ndarray, "k k"], reach: float
) -> Float[np.ndarray, "k 2"]:
    """Saddle points refined in a window of half-size ``reach`` times the side of the smallest square seen.

    ``apart``: distances between the corners on the board, in squares. Where no two neighbours are seen: 2 pixels.
    """
    distance = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    beside = (apart > 0) & (apart < 1.2)
    nearest = float(distance[beside].min()) if beside.any() else 0.0
    half = int(np.clip(reach * nearest, 2, 12))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    return cv2.cornerSubPix(grey, pixels.copy().reshape(-1, 1, 2), (half, half), (-1, -1), criteria).reshape(-1, 2)


def _tag_corners(
    cv2: Any, grey: UInt8[np.ndarray, "h w"], corners: Float[np.ndarray, "4 2"], cells: int
) -> Float[np.ndarray, "4 2"]:
    """Corners of a tag as the crossings of curves fitted to its edges: blur moves a corner inwards, but no edge.

    Each edge is read along profiles across it, no further than its black border is wide, and lies at the centroid of
    their grey steps. A parabola (short edges: a line) follows it, since lenses bend it. ``cells``: width of the tag in
    bits, border included.
    """
    ends = []  # the tangents at both ends of each edge
    for k in range(4):
        a, b = corners[k].astype(np.float64), corners[(k + 1) % 4].astype(np.float64)
        length = float(np.linalg.norm(b - a))
        along = (b - a) / max(length, 1e-9)
        across = np.array([along[1], -along[0]])
        reach = float(np.clip(0.7 * length / cells, 1.5, 6.0))
        offsets = np.linspace(-reach, reach, 2 * int(np.ceil(2 * reach)) + 1)
        place = np.linspace(0.12, 0.88, max(int(length), 8)) * length
        pixels = (a + place[:, None] * along)[:, None] + offsets[:, None] * across
        profiles = cv2.remap(grey, pixels.astype(np.float32), None, cv2.INTER_LINEAR).astype(np.float64)
        steps = np.maximum(np.diff(profiles, axis=1), 0.0)  # from black to the white outside
        weight = steps.sum(axis=1)
        clear = (weight > 0) & (weight > 0.5 * np.median(weight))
        if clear.sum() < 5:
            return corners
        offset = (steps[clear] @ ((offsets[1:] + offsets[:-1]) / 2)) / weight[clear]
        curve = np.polynomial.Polynomial.fit(place[clear], offset, 2 if length > BENT_EDGE_PX else 1)
        for s in (0.0, length):
            ends.append((a + s * along + curve(s) * across, along + curve.deriv()(s) * across))
    found = []
    for k in range(4):
        (p, u), (q, v) = ends[2 * k - 1], ends[2 * k]
        if abs(u[0] * v[1] - u[1] * v[0]) < 0.1:
            return corners
        found.append(p + np.linalg.solve(np.stack([u, -v], axis=1), q - p)[0] * u)
    moved = np.linalg.norm(np.stack(found) - corners, axis=1)
    return np.stack(found) if moved.max() < FARTHEST_PX else corners
