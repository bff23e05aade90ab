"""Delaunay triangulation of pixels in which given segments are edges (thesis §2.4.2, insertion of the 3D contours).

A segment that is no edge is cut at a reading near its middle until every piece is one: the triangulation stays
Delaunay, and a segment is a chain of edges through measured points that leaves its line by a pixel or so.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from jaxmodel.control_points.image_surfaces import Surfaces
from jaxmodel.control_points.pixel_triangulation import HORIZON, edges_of, triangulate
from jaxmodel.errors import InputError


class Pieces(NamedTuple):
    """What the segments have been cut into: ``ends (p, 2, 2)`` pixels, ``segment (p,)`` which segment each is of."""

    ends: Int[np.ndarray, "p 2 2"]
    segment: Int[np.ndarray, " p"]

    @classmethod
    def of(cls, segments: Int[np.ndarray, "s 2 2"]) -> "Pieces":
        """The segments before any cut."""
        return cls(segments, np.arange(len(segments)))


class Conforming(NamedTuple):
    """``pixels (n, 2)`` the given ones and those added, ``triangles (f, 3)`` of the horizon and them, the ``pieces``.

    ``lost``: how many pieces were left out as there is no reading to cut them at.
    """

    pixels: Int[np.ndarray, "n 2"]
    triangles: Int[np.ndarray, "f 3"]
    pieces: Pieces
    lost: int


def check_segments(surfaces: Surfaces, segments: Int[np.ndarray, "s 2 2"] | None) -> Pieces:
    """The segments that have a length; :class:`InputError` where an end is outside the image or has no reading."""
    ends = np.zeros((0, 2, 2), dtype=np.int64) if segments is None else np.asarray(segments)
    flat = ends.reshape(-1, 2)
    inside = np.clip(flat, 0, np.array(surfaces.valid.shape) - 1)
    read = surfaces.valid[inside[:, 0], inside[:, 1]] & np.all(inside == flat, axis=1)
    if not read.all():
        first = int(np.argmin(read))
        raise InputError(f"segment {first // 2}: its end {flat[first].tolist()} has no reading, expected a valid pixel")
    return Pieces.of(ends[(ends[:, 0] != ends[:, 1]).any(axis=1)].astype(np.int64))


def conform(surfaces: Surfaces, pixels: Int[np.ndarray, "n 2"], pieces: Pieces) -> Conforming:
    """Triangulate ``pixels``, which hold the ends of all pieces, cutting pieces until all are edges.

    It ends: a piece gets shorter each time, and two neighbouring pixels of a row or column always share an edge.
    """
    shape = (surfaces.valid.shape[0], surfaces.valid.shape[1])
    lost = 0
    while True:
        triangles = triangulate(shape, pixels)
        if len(pieces.ends) == 0:
            return Conforming(pixels, triangles, pieces, lost)
        number = np.full(surfaces.valid.size, -1)
        number[_flat(pixels, shape)] = np.arange(len(pixels)) + HORIZON
        count = len(pixels) + HORIZON
        low, high = np.sort(number[_flat(pieces.ends, shape)], axis=1).T
        broken = ~np.isin(low * count + high, edges_of(triangles, count))
        if not broken.any():
            return Conforming(pixels, triangles, pieces, lost)
        ends, segment = pieces.ends[broken], pieces.segment[broken]
        middle = _middles(surfaces, ends)
        found = middle[:, 0] >= 0
        lost += int(np.count_nonzero(~found))
        ends, segment, middle = ends[found], segment[found], middle[found]
        halves = np.stack([np.stack([ends[:, 0], middle], axis=1), np.stack([middle, ends[:, 1]], axis=1)], axis=1)
        pieces = Pieces(
            np.concatenate([pieces.ends[~broken], halves.reshape(-1, 2, 2)]),
            np.concatenate([pieces.segment[~broken], np.repeat(segment, 2)]),
        )
        new = np.unique(middle[number[_flat(middle, shape)] < 0], axis=0)
        pixels = np.concatenate([pixels, new])


def _middles(surfaces: Surfaces, ends: Int[np.ndarray, "p 2 2"]) -> Int[np.ndarray, "p 2"]:
    """A reading to cut each piece at, -1 where there is none: near its middle, and nearest to its line in space.

    Distance in space keeps a segment along a depth jump on its own side.
    """
    h, w = surfaces.valid.shape
    backwards = _flat(ends[:, 0], (h, w)) > _flat(ends[:, 1], (h, w))
    ends = np.where(backwards[:, None, None], ends[:, ::-1], ends)  # both directions are cut alike
    around = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    candidate = (ends.sum(axis=1) // 2)[:, None] + around
    row, column = np.clip(candidate, 0, [h - 1, w - 1]).transpose(2, 0, 1)
    length = np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1)
    away = np.sum((candidate[:, None] - ends[:, :, None]) ** 2, axis=-1)
    fits = (away < length[:, None, None]).all(axis=1) & surfaces.valid[row, column]
    fits &= (candidate >= 0).all(axis=2) & (candidate < [h, w]).all(axis=2)
    first, last = (surfaces.points[ends[:, k, 0], ends[:, k, 1]] for k in (0, 1))
    chord = np.linalg.norm(last - first, axis=1, keepdims=True)
    along = (last - first) / np.where(chord > 0, chord, 1.0)
    offset = surfaces.points[row, column] - first[:, None]
    off = offset - np.sum(offset * along[:, None], axis=2, keepdims=True) * along[:, None]
    cost = np.linalg.norm(off, axis=2) / surfaces.spacing[ends[:, 0, 0], ends[:, 0, 1]][:, None]
    cost += 0.1 * np.sqrt(away.sum(axis=1))  # of two equally near ones, the one nearer to the middle
    cost[~fits] = np.inf
    best = np.argmin(cost, axis=1)
    chosen = np.take_along_axis(candidate, best[:, None, None], axis=1)[:, 0]
    return np.where(fits.any(axis=1)[:, None], chosen, -1)


def _flat(pixels: Int[np.ndarray, "*n 2"], shape: tuple[int, int]) -> Int[np.ndarray, " *n"]:
    return pixels[..., 0] * shape[1] + pixels[..., 1]
