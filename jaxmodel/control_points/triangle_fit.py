"""How well the triangles of a triangulated range image stand for the readings in them (thesis §2.4.2)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from jaxmodel.control_points.image_surfaces import Surfaces
from jaxmodel.control_points.pixel_triangulation import HORIZON, Pixels

_MOMENTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


class TriangleFit(NamedTuple):
    """One row a triangle.

    ``error`` root mean square distance of its surface's readings, corners included, to their plane, unit of the data;
    ``readings`` how many these are; ``spacing`` pixel spacing there. ``misplaced``: how many pixels an outline is off
    in it, see :func:`fit_triangles`.
    """

    error: Float[np.ndarray, " f"]
    readings: Int[np.ndarray, " f"]
    spacing: Float[np.ndarray, " f"]
    misplaced: Float[np.ndarray, " f"]


def fit_triangles(
    surfaces: Surfaces,
    places: Int[np.ndarray, "v 2"],
    triangles: Int[np.ndarray, "f 3"],
    pixels: Pixels,
    kept: Bool[np.ndarray, " f"],
) -> TriangleFit:
    """Fit a plane to the largest connected surface seen through each triangle.

    A triangle that is not ``kept`` stands for no surface: all its readings are misplaced. In the others, gap pixels
    and readings of a smaller surface are. An outline is off by the distance of a misplaced pixel from the nearest one
    or, where a strip of them is all outline, by its width: their number for each pixel of the triangle's length.
    """
    count, w = len(triangles), surfaces.valid.shape[1]
    own = ~surfaces.gap.ravel()[pixels.pixel] & kept[pixels.triangle]
    own &= _largest(surfaces, pixels, own, count)
    read = surfaces.valid.ravel()[pixels.pixel]
    misplaced = _misplaced(surfaces, places, triangles, pixels, np.where(kept[pixels.triangle], ~own, read))

    mine = own & read
    of = np.append(pixels.triangle[mine], np.repeat(np.flatnonzero(kept), 3))
    at = np.append(pixels.pixel[mine], (places[triangles[kept]] // 2 @ np.array([w, 1])).ravel())
    readings = np.bincount(of, minlength=count)
    share = 1.0 / np.maximum(readings, 1)
    points = surfaces.points.reshape(-1, 3)[at]
    mean = np.stack([np.bincount(of, axis, minlength=count) for axis in points.T], axis=1) * share[:, None]
    offset = (points - mean[of]).T
    spread = np.empty((count, 3, 3))
    for i, j in _MOMENTS:
        spread[:, i, j] = spread[:, j, i] = np.bincount(of, offset[i] * offset[j], minlength=count) * share
    error = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, 0], 0.0))
    spacing = np.bincount(of, surfaces.spacing.ravel()[at], minlength=count) * share
    spacing[readings == 0] = 1.0  # not used: the error is 0
    return TriangleFit(error, readings, spacing, misplaced)


def _misplaced(
    surfaces: Surfaces,
    places: Int[np.ndarray, "v 2"],
    triangles: Int[np.ndarray, "f 3"],
    pixels: Pixels,
    off: Bool[np.ndarray, " n"],
) -> Float[np.ndarray, " f"]:
    """Pixels by which the outline is off in each triangle, ``off (n,)`` marking the pixels on the wrong side."""
    triangle = pixels.triangle[off]
    deepest = np.zeros(len(triangles))
    np.maximum.at(deepest, triangle, surfaces.depth.ravel()[pixels.pixel[off]])
    side = np.linalg.norm(np.diff(places[triangles[:, [0, 1, 2, 0]]], axis=1), axis=2) / 2
    side[np.minimum(triangles, triangles[:, [1, 2, 0]]) < HORIZON] = 0.0  # a side to the horizon is no outline
    length = side.max(axis=1)
    width = np.bincount(triangle, minlength=len(triangles)) / np.where(length > 0, length, np.inf)
    return np.maximum(deepest, width)


def _largest(surfaces: Surfaces, pixels: Pixels, wanted: Bool[np.ndarray, " n"], count: int) -> Bool[np.ndarray, " n"]:
    """Which pixels belong to the largest surface in their triangle: connected, inside it, by links of ``wanted`` ones.

    Only triangles with a jump are looked into; in the others all pixels do.
    """
    torn = np.zeros(count, dtype=bool)
    torn[pixels.triangle[surfaces.jump.ravel()[pixels.pixel]]] = True
    row = np.flatnonzero(wanted & torn[pixels.triangle])
    if len(row) == 0:
        return np.ones(len(wanted), dtype=bool)
    pixel, triangle = pixels.pixel[row], pixels.triangle[row]
    number = np.full(surfaces.valid.size + surfaces.valid.shape[1], -1)
    number[pixel] = np.arange(len(row))
    ends = []
    for link, step in ((surfaces.down, surfaces.valid.shape[1]), (surfaces.right, 1)):
        first = np.flatnonzero(link.ravel()[pixel])
        second = number[pixel[first] + step]
        same = (second >= 0) & (triangle[second] == triangle[first])
        ends.append(np.stack([first[same], second[same]]))
    first, second = np.concatenate(ends, axis=1)
    graph = coo_matrix((np.ones(len(first), dtype=np.int8), (first, second)), shape=(len(row), len(row)))
    parts, part = connected_components(graph, directed=False)
    size = np.bincount(part, minlength=parts)
    triangle_of = np.empty(parts, dtype=np.int64)
    triangle_of[part] = triangle
    order = np.lexsort((np.arange(parts), -size, triangle_of))
    is_largest = np.zeros(parts, dtype=bool)
    is_largest[order[np.append(True, np.diff(triangle_of[order]) != 0)]] = True
    out = np.ones(len(wanted), dtype=bool)
    out[row] = is_largest[part]
    return out
