"""Which triangles of a split range image stand for a surface: the three filters of thesis §2.4.2."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jaxmodel.control_points.image_surfaces import Surfaces
from jaxmodel.control_points.pixel_triangulation import HORIZON, Pixels, doubled_areas
from jaxmodel.scan.range_image import JUMP

_NEAR = 0.25  # of a triangle's size: readings farther from its plane than that are not on it
_DOUBT = 3.0  # standard deviations of the noise, on top


class Filtered(NamedTuple):
    """``kept (f,)`` the triangles left, and how many each filter removed, in the order they are applied."""

    kept: Bool[np.ndarray, " f"]
    horizon: int
    density: int
    shape: int


def filter_triangles(
    surfaces: Surfaces,
    places: Int[np.ndarray, "v 2"],
    triangles: Int[np.ndarray, "f 3"],
    pixels: Pixels,
    density: float,
    shape: float,
) -> Filtered:
    """Take out what is no surface: triangles at the horizon, over gaps, and across depth jumps.

    Horizon: a corner is a virtual vertex. Density: the triangle holds too few readings for what it covers. The rays
    through it give one each, dropouts apart, and at least the share ``density`` of them must lie near its plane; and
    seen so much at a slant that it gets fewer than one reading for ``JUMP`` square pixel spacings of its area, it is
    what :func:`jaxmodel.scan.range_image.grid_triangles` takes for a depth jump. Shape: area / perimeter² in space is
    below ``shape``; an equilateral triangle has 0.048, one eleven times as long as wide 0.01.

    Args:
        surfaces: of the range image.
        places: doubled places of the vertices, those at the horizon first.
        triangles: unfiltered.
        pixels: which pixels each covers.
        density, shape: dimensionless thresholds.
    """
    count = len(triangles)
    horizon = triangles.min(axis=1) < HORIZON
    flat = places[triangles[~horizon]] // 2 @ np.array([surfaces.valid.shape[1], 1])
    corner = surfaces.points.reshape(-1, 3)[flat]
    spacing = surfaces.spacing.ravel()[flat].min(axis=1)
    pixel_area = doubled_areas(places, triangles[~horizon]) / 8
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    twice_area = np.linalg.norm(normal, axis=1)
    normal /= np.where(twice_area > 0, twice_area, 1.0)[:, None]
    perimeter = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2).sum(axis=1)

    inside = np.flatnonzero(~horizon[pixels.triangle] & surfaces.valid.ravel()[pixels.pixel])
    number = (np.cumsum(~horizon) - 1)[pixels.triangle[inside]]
    offset = surfaces.points.reshape(-1, 3)[pixels.pixel[inside]] - corner[number, 0]
    near = np.maximum(JUMP, _NEAR * np.sqrt(pixel_area)) * spacing + _DOUBT * surfaces.noise
    on = np.abs(np.einsum("ij,ij->i", offset, normal[number])) <= near[number]
    # one more, for the corners: readings on it, whichever triangle their pixels went to
    held = np.bincount(number[on], minlength=len(flat)) + 1
    gaps = np.bincount(pixels.triangle[surfaces.gap.ravel()[pixels.pixel]], minlength=count)[~horizon]
    expected = np.bincount(number, minlength=len(flat)) + gaps + 1

    slanted = JUMP * pixel_area * spacing**2 < 0.5 * twice_area
    sparse = slanted | (held < density * expected)
    degenerate = ~sparse & (0.5 * twice_area < shape * perimeter**2)
    kept = np.zeros(count, dtype=bool)
    kept[~horizon] = ~sparse & ~degenerate
    return Filtered(kept, int(horizon.sum()), int(sparse.sum()), int(degenerate.sum()))
