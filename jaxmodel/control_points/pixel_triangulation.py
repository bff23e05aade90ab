"""Delaunay triangulations of chosen pixels in the image plane, and which pixels lie in which triangle.

Four virtual vertices at the horizon belong to every triangulation (thesis §2.4.2). The thesis has them at the image's
corners; here they are far beyond these, in the image plane too: a Delaunay triangulation would else connect them with
inner vertices, across the readings at the image's edge. Pixels are integer places and often lie on one circle: fixed
offsets, too small to turn a triangle over, decide these ties, and everything after the triangulation itself is
integer arithmetic.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import Delaunay

HORIZON = 4  # the first vertices of every triangulation are those at the horizon
FAR = 8  # times the image's longer side they are away from its corners
_NUDGE = 1e-5  # pixels; turns three places in a line into a circle far larger than an image


class Pixels(NamedTuple):
    """The pixels of each triangle: those of triangle i are ``pixel[start[i] : start[i + 1]]``, flat, row-major.

    ``triangle (n,)`` the triangle of each. Every pixel of the image is in exactly one.
    """

    pixel: Int[np.ndarray, " n"]
    triangle: Int[np.ndarray, " n"]
    start: Int[np.ndarray, " f1"]


def doubled_places(shape: tuple[int, int], pixels: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "v 2"]:
    """Twice the (row, column) of every vertex: the four at the horizon, then ``pixels``."""
    away = 2 * FAR * max(shape)
    bottom, right = 2 * (shape[0] - 1) + away, 2 * (shape[1] - 1) + away
    corners = np.array([[-away, -away], [-away, right], [bottom, right], [bottom, -away]])
    return np.concatenate([corners, 2 * np.asarray(pixels, dtype=np.int64).reshape(-1, 2)])


def triangulate(shape: tuple[int, int], pixels: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "f 3"]:
    """Delaunay triangles of the horizon (vertices 0 to 3) and distinct ``pixels`` (from 4 on).

    All turn from rows to columns: ``cross(b - a, c - a) > 0`` in (row, column).
    """
    places = 0.5 * doubled_places(shape, pixels)
    row, column = np.asarray(pixels, dtype=np.int64).reshape(-1, 2).T
    places[HORIZON:] += _NUDGE * np.stack(
        [_scattered(row, column, 83492791), _scattered(row, column, 50331653)], axis=1
    )
    triangles = Delaunay(places - places.mean(axis=0)).simplices.astype(np.int64)
    triangles = triangles[np.lexsort(np.sort(triangles, axis=1).T)]  # an order that does not depend on the library's
    turned = doubled_areas(doubled_places(shape, pixels), triangles) < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return triangles


def _scattered(row: Int[np.ndarray, " n"], column: Int[np.ndarray, " n"], factor: int) -> Float[np.ndarray, " n"]:
    """Numbers in [-0.5, 0.5] without order, always the same for a pixel."""
    mixed = row * 73856093 ^ column * 19349663
    mixed = (mixed ^ mixed >> 13) * factor & 0xFFFFFFFF
    return (mixed ^ mixed >> 16) % 65537 / 65536 - 0.5


def doubled_areas(places: Int[np.ndarray, "v 2"], triangles: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, " f"]:
    """Eight times the signed area, in pixels, of each triangle (``places`` being doubled)."""
    a, b, c = (places[triangles[:, k]] for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def pixels_of(shape: tuple[int, int], places: Int[np.ndarray, "v 2"], triangles: Int[np.ndarray, "f 3"]) -> Pixels:
    """Every pixel of the image with the triangle it lies in; on an edge, in the one to its right or below.

    ``places`` are :func:`doubled_places`. Each row of each triangle is a run of pixels between two edges; an edge's
    crossing is computed alike for both of its triangles, exactly, so no pixel is lost or taken twice.
    """
    count = len(triangles)
    corner = places[triangles]
    corner = np.take_along_axis(corner, np.argsort(corner[..., 0], axis=1, kind="stable")[..., None], axis=1)
    # upper and lower half of each triangle: the edge that ends there, beside the long one
    first, last = corner[:, [0, 1]].reshape(-1, 2), corner[:, [1, 2]].reshape(-1, 2)
    top = np.clip(-(-first[:, 0] // 2), 0, shape[0])
    rows = np.clip(-(-last[:, 0] // 2), 0, shape[0]) - top
    half = np.repeat(np.arange(2 * count), rows)
    row = np.arange(half.size) - np.repeat(np.cumsum(rows) - rows, rows) + top[half]
    short = _crossing(first[half], last[half], row)
    long = _crossing(corner[half // 2, 0], corner[half // 2, 2], row)
    left, right = (np.clip(end, 0, shape[1]) for end in (np.minimum(short, long), np.maximum(short, long)))
    length = right - left
    run = np.repeat(np.arange(half.size), length)
    pixel = np.arange(run.size) + np.repeat(row * shape[1] + left - (np.cumsum(length) - length), length)
    triangle = (half // 2)[run]
    start = np.searchsorted(triangle, np.arange(count + 1))
    return Pixels(pixel, triangle, start)


def _crossing(
    first: Int[np.ndarray, "n 2"], last: Int[np.ndarray, "n 2"], row: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " n"]:
    """The first column at or right of the line between two doubled places, in a row strictly above ``last``."""
    height = last[:, 0] - first[:, 0]
    across = first[:, 1] * height + (2 * row - first[:, 0]) * (last[:, 1] - first[:, 1])
    return -(-across // (2 * np.maximum(height, 1)))


def edges_of(triangles: Int[np.ndarray, "f 3"], count: int) -> Int[np.ndarray, " e"]:
    """The edges of some triangles over ``count`` vertices, each once, as sorted keys ``low * count + high``."""
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return np.unique(ends.min(axis=1) * count + ends.max(axis=1))
