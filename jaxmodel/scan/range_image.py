"""A range image: one measured point a pixel, in the sensor's frame, and what the grid tells about the surface.

Neighbouring pixels lie on one surface unless a depth jump parts them. The jump threshold is ``jump`` times the
image's own pixel spacing (for a pinhole image, the spacing at the pixel's range), so no length is absolute.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.scan.cloud import Cloud

JUMP = 4.0  # a neighbour further than this many pixel spacings is on another surface (slopes beyond about 76 degrees)


class RangeImage(eqx.Module):
    """What a range sensor gives in one shot.

    ``points (h, w, 3)`` in the sensor's frame and the unit of the data, NaN where not valid; ``valid (h, w)``;
    ``eye (4,)`` the sensor in homogeneous coordinates of its own frame: ``(0, 0, 0, 1)``, the default, is a
    pinhole at the origin; ``(0, 0, 1, 0)`` an orthographic sensor at infinity on +z (Stanford's scanner).
    """

    points: Float[np.ndarray, "h w 3"]
    valid: Bool[np.ndarray, "h w"]
    eye: Float[np.ndarray, "4"] = eqx.field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))


Scan = RangeImage | Cloud


def spacing(image: RangeImage) -> float:
    """The image's pixel spacing: the larger of the two median distances, between row and column neighbours.

    Unit of the data for an orthographic image; for a pinhole image the spacing at range 1 (an angle in radian).
    NaN where no two valid pixels are neighbours.
    """
    reach = _reach(image)
    medians = []
    for axis in (0, 1):
        first, second = _shifted_pair(image.points, axis)
        distance = np.linalg.norm(second - first, axis=-1) / _shifted_pair(reach, axis)[0]
        finite = distance[np.isfinite(distance)]
        if finite.size:
            medians.append(float(np.median(finite)))
    return max(medians) if medians else float("nan")


def pixel_spacings(image: RangeImage) -> Float[np.ndarray, "h w"]:
    """The distance, at each pixel, between neighbours on a surface that faces the sensor; NaN where not valid.

    Unit of the data: :func:`spacing`, for a pinhole image times the pixel's range.
    """
    return np.where(image.valid, spacing(image) * _reach(image), np.nan)


def borders(image: RangeImage, jump: float = JUMP) -> Bool[np.ndarray, "h w"]:
    """Valid pixels one of whose four neighbours is outside the image, without reading, or across a depth jump.

    ``jump`` is in pixel spacings. These are the points the border filter keeps out of pairs (thesis §2.5.3).
    """
    limit = _jump_limit(image, jump)
    joined = np.zeros(image.valid.shape, dtype=np.int64)
    for axis in (0, 1):
        first, second = _shifted_pair(image.points, axis)
        near = np.linalg.norm(second - first, axis=-1) <= _shifted_pair(limit, axis)[0]  # NaN compares False
        low, high = _shifted_pair(joined, axis)
        low += near
        high += near
    return image.valid & (joined < 4)


def normals(image: RangeImage, radius: int = 2, jump: float = JUMP) -> Float[np.ndarray, "h w 3"]:
    """Unit normals facing the sensor, by a least-squares plane through the ``(2 radius + 1)²`` window.

    Pixels of the window across a depth jump (``jump`` spacings a pixel step) do not count. Exact on a plane. Where
    fewer than three points or a line remain, the direction to the sensor stands in, so every valid pixel has a finite
    unit normal; NaN where not valid. The window may be made larger for noisy images.
    """
    rows, columns = np.nonzero(image.valid)
    out = np.full(image.points.shape, np.nan)
    if rows.size == 0:
        return out
    h, w = image.valid.shape
    centre = image.points[rows, columns].astype(np.float64)
    limit = _jump_limit(image, jump)[rows, columns]
    count = np.zeros(rows.size)
    first = np.zeros((rows.size, 3))
    second = np.zeros((rows.size, 3, 3))
    for i in range(-radius, radius + 1):
        for j in range(-radius, radius + 1):
            r, c = rows + i, columns + j
            inside = (r >= 0) & (r < h) & (c >= 0) & (c < w)
            offset = image.points[np.clip(r, 0, h - 1), np.clip(c, 0, w - 1)] - centre
            near = inside & (np.linalg.norm(offset, axis=1) <= limit * max(abs(i), abs(j), 1))
            offset = np.where(near[:, None], offset, 0.0)
            count += near
            first += offset
            second += offset[:, :, None] * offset[:, None, :]
    mean = first / np.maximum(count, 1.0)[:, None]
    covariance = second / np.maximum(count, 1.0)[:, None, None] - mean[:, :, None] * mean[:, None, :]
    eigenvalues, eigenvectors = np.linalg.eigh(covariance)
    normal = eigenvectors[:, :, 0]
    towards = to_sensor(image, centre)
    flat = (count >= 3) & (eigenvalues[:, 1] > 1e-9 * eigenvalues[:, 2])
    normal = np.where(flat[:, None], normal, towards)
    normal = normal * np.where(np.sum(normal * towards, axis=1) < 0, -1.0, 1.0)[:, None]
    out[rows, columns] = normal
    return out


def to_sensor(image: RangeImage, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit directions from ``points`` (sensor frame) towards the sensor."""
    direction = image.eye[:3] - image.eye[3] * points
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return direction / np.where(length > 0, length, 1.0)


def to_cloud(image: RangeImage, radius: int = 2, jump: float = JUMP) -> Cloud:
    """The valid pixels in row-major order, with normals and border flags, in the sensor's frame."""
    return Cloud(
        points=image.points[image.valid],
        normals=normals(image, radius=radius, jump=jump)[image.valid],
        border=borders(image, jump=jump)[image.valid],
    )


def grid_triangles(image: RangeImage, jump: float = JUMP) -> Int[np.ndarray, "m 3"]:
    """Triangles over the grid, as rows of :func:`to_cloud`'s points, all facing the sensor.

    A 2 x 2 cell of valid pixels gives two triangles, split along its shorter diagonal; a cell with three valid
    pixels gives one. Triangles with an edge across a depth jump (``jump`` spacings a pixel step) are left out.
    """
    h, w = image.valid.shape
    if h < 2 or w < 2:
        return np.zeros((0, 3), dtype=np.int64)
    number = np.arange(h * w).reshape(h, w)
    a, b, c, d = (x.ravel() for x in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    flat_points = image.points.reshape(-1, 3)
    flat_valid = image.valid.ravel()
    ac = np.linalg.norm(flat_points[a] - flat_points[c], axis=1)
    bd = np.linalg.norm(flat_points[b] - flat_points[d], axis=1)
    # NaN where a corner has no reading: the diagonal is then the one whose ends both exist.
    along_ac = np.where(np.isnan(ac) | np.isnan(bd), np.isnan(bd), ac <= bd)
    lower = np.where(along_ac[:, None], np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    upper = np.where(along_ac[:, None], np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    faces = np.stack([lower, upper], axis=1).reshape(-1, 3)
    faces = faces[flat_valid[faces].all(axis=1)]
    limit = _jump_limit(image, jump).ravel()
    corners = flat_points[faces]
    edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    # A diagonal spans a step in each direction; sqrt(2) spacings keep it on the same footing as the sides.
    faces = faces[(edges.max(axis=1) <= np.sqrt(2.0) * limit[faces].min(axis=1))]
    corners = flat_points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = np.sum(normal * to_sensor(image, corners.mean(axis=1)))
    if facing < 0:  # the grid is a chart of what the sensor sees: one sign for the whole image
        faces = faces[:, ::-1]
    row_of_pixel = np.cumsum(flat_valid) - 1
    return row_of_pixel[faces]


def _reach(image: RangeImage) -> Float[np.ndarray, "h w"]:
    """What one pixel spacing is measured in: the range for a pinhole image, 1 for an orthographic one."""
    if image.eye[3] == 0:
        return np.ones(image.valid.shape)
    return np.linalg.norm(image.points - image.eye[:3] / image.eye[3], axis=-1)


def _jump_limit(image: RangeImage, jump: float) -> Float[np.ndarray, "h w"]:
    """The largest distance, at each pixel, that still counts as the same surface."""
    return jump * pixel_spacings(image)


def _shifted_pair(array: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Views of ``array`` without its last and without its first row (axis 0) or column (axis 1)."""
    return (array[:-1], array[1:]) if axis == 0 else (array[:, :-1], array[:, 1:])
