"""Where a range image shows one surface: links between neighbouring pixels, gaps without readings, and outlines."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_opening, distance_transform_edt

from jaxmodel.control_points.scan_lines import line_view, noise
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import JUMP, RangeImage, Scan, pixel_spacings

_DOUBT = 6.0  # standard deviations two readings of one surface may differ by


class Surfaces(NamedTuple):
    """What the grid tells about the readings' neighbourhood.

    ``points (h, w, 3)`` the readings, elsewhere the nearest one, whose flat pixel is ``nearest``; ``valid``: where a
    reading is; ``gap``: places without reading at least three pixels wide (narrower ones are dropouts, which surfaces
    reach across). ``down`` and ``right``: the pixel and its neighbour lie on one surface. ``jump``: readings whose
    neighbour lies on another surface. ``outline``: readings beside a jump, a gap or the image's edge. ``depth``:
    distance in pixels to the nearest outline, or from inside a gap to its edge. ``spacing``: distance between
    neighbouring pixels on a surface that faces the sensor; ``noise`` the standard deviation of a reading; both in the
    unit of the data.
    """

    points: Float[np.ndarray, "h w 3"]
    nearest: Int[np.ndarray, "h w"]
    valid: Bool[np.ndarray, "h w"]
    gap: Bool[np.ndarray, "h w"]
    down: Bool[np.ndarray, "h w"]
    right: Bool[np.ndarray, "h w"]
    jump: Bool[np.ndarray, "h w"]
    outline: Bool[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    spacing: Float[np.ndarray, "h w"]
    noise: float


def as_range_image(scan: Scan) -> RangeImage:
    """The scan, if it is a range image; :class:`InputError` for any other."""
    if not isinstance(scan, RangeImage):
        raise InputError("a split mesh needs a range image, and this scan has no grid of pixels")
    return scan


def surfaces_of(image: RangeImage) -> Surfaces:
    """The surfaces of a range image.

    Raises :class:`InputError` for fewer than two rows or columns, no valid pixel, or no two neighbouring ones apart.
    """
    h, w = image.valid.shape
    if h < 2 or w < 2:
        raise InputError(f"the range image has {h} x {w} pixels, expected at least two rows and two columns")
    view = line_view(image)
    valid = np.isfinite(view.distance)  # neither missing nor at the sensor itself
    if not valid.any():
        raise InputError("the range image has no valid pixel, expected readings to make a mesh of")
    points = np.where(valid[..., None], image.points, np.nan).astype(np.float64)
    spacings = pixel_spacings(RangeImage(points=points, valid=valid, eye=image.eye))
    if not (spacings > 0).any():
        raise InputError("no two readings of the range image are neighbours, expected a surface to make a mesh of")
    sigma = noise(view)
    missing = np.pad(~valid, 1, constant_values=True)
    gap = np.asarray(binary_opening(missing, np.ones((3, 3))), dtype=bool)[1:-1, 1:-1]
    nearest = _nearest(valid)
    points = points.reshape(-1, 3)[nearest]
    spacings = spacings.ravel()[nearest]
    limit = JUMP * spacings + _DOUBT * sigma
    down, torn_down = _links(points, limit, ~gap)
    right, torn_right = (np.swapaxes(a, 0, 1) for a in _links(*(np.swapaxes(a, 0, 1) for a in (points, limit, ~gap))))
    jump = torn_down | torn_right
    linked = down.astype(np.int64) + right
    linked[1:] += down[:-1]
    linked[:, 1:] += right[:, :-1]
    outline = ~gap & (linked < 4)
    depth = np.where(gap, _depth(gap), _depth(~gap & ~outline))
    return Surfaces(points, nearest, valid, gap, down, right, jump & valid, outline & valid, depth, spacings, sigma)


def _links(
    points: Float[np.ndarray, "h w 3"], limit: Float[np.ndarray, "h w"], covered: Bool[np.ndarray, "h w"]
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Along the first axis: which pixels lie on one surface with the next one, and which are beside a jump."""
    both = covered[:-1] & covered[1:]
    near = both & (np.sum((points[1:] - points[:-1]) ** 2, axis=-1) <= limit[:-1] ** 2)
    linked, torn = np.zeros_like(covered), np.zeros_like(covered)
    linked[:-1] = near
    torn[:-1] |= both & ~near
    torn[1:] |= both & ~near
    return linked, torn


def _nearest(valid: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "h w"]:
    """The flat pixel of the nearest reading."""
    found = np.asarray(distance_transform_edt(~valid, return_distances=False, return_indices=True), dtype=np.int64)
    return found[0] * valid.shape[1] + found[1]


def _depth(inside: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Distance in pixels to the nearest pixel that is not inside."""
    return np.asarray(distance_transform_edt(inside), dtype=np.float64)
