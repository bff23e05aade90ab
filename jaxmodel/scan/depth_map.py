"""What one range image tells of the space in front of it: would a point there have hidden what was seen?

A scan knows more than its points: from each of them to the sensor nothing stands in the way, and where the sensor
looked and read nothing, mostly nothing is. Two scans put together wrongly break this where their surfaces do not meet.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.nearest import gather
from jaxmodel.scan.range_image import RangeImage, spacing

EDGE = 192
"""Cells along each side of the map."""
PIXELS = 1.5
"""Least edge of a cell, in pixels: no cell between two readings is empty."""


class Sight(NamedTuple):
    """Of points asked about: ``depth (n,)`` how far each lies in front of the nearest reading around its line of
    sight (negative: behind it), unit of the data; ``known (n,)`` whether there is such a reading; ``empty (n,)``
    whether the sensor looked there and read nothing.
    """

    depth: Float[jax.Array, " n"]
    known: Bool[jax.Array, " n"]
    empty: Bool[jax.Array, " n"]


class DepthMap(eqx.Module):
    """The nearest reading in each direction, of a pinhole or an orthographic sensor.

    ``axes (3, 3)`` rows right, down, forward; ``eye (3,)`` the sensor's place, or any point for an orthographic one
    (``at_infinity`` 1, else 0); ``corner (2,)`` of the map and ``cell``, its cells' edge, in the plane at depth 1;
    ``nearest (cells,)``, row by row, depth of the nearest reading within a cell of each, infinite where there is none;
    ``looked (cells,)`` whether the sensor's field covers the cell.
    """

    axes: Float[AnyArray, "3 3"]
    eye: Float[AnyArray, "3"]
    at_infinity: Float[AnyArray, ""]
    corner: Float[AnyArray, "2"]
    cell: Float[AnyArray, ""]
    nearest: Float[AnyArray, "cells"]
    looked: Bool[AnyArray, "cells"]

    def see(self, points: Float[jax.Array, "3 n"]) -> Sight:
        """Points (structure of arrays) of the map's frame against what the sensor read."""
        moved = points - self.eye[:, None]
        right, down, forward = (row[0] * moved[0] + row[1] * moved[1] + row[2] * moved[2] for row in self.axes)
        plane = jnp.where(self.at_infinity > 0, 1.0, jnp.maximum(forward, 1e-30))
        column, row = (
            jnp.floor((at / plane - low) / self.cell) for at, low in zip((right, down), self.corner, strict=True)
        )
        inside = (column >= 0) & (column < EDGE) & (row >= 0) & (row < EDGE) & ((self.at_infinity > 0) | (forward > 0))
        key = (jnp.clip(row, 0, EDGE - 1) * EDGE + jnp.clip(column, 0, EDGE - 1)).astype(jnp.uint32)
        nearest = gather(jnp.asarray(self.nearest), key)
        known = inside & jnp.isfinite(nearest)
        empty = inside & ~known & gather(jnp.asarray(self.looked), key)
        return Sight(jnp.where(known, nearest - forward, 0.0), known, empty)


def depth_map(image: RangeImage, origin: Float[np.ndarray, "3"]) -> DepthMap:
    """The map of a range image, for points of its frame less ``origin`` (float32 wants coordinates near 0)."""
    points = image.points[image.valid].astype(np.float64)
    at_infinity = image.eye[3] == 0
    eye = np.asarray(origin if at_infinity else image.eye[:3] / image.eye[3], np.float64)
    forward = -image.eye[:3] if at_infinity else points.mean(axis=0) - eye
    forward = forward / np.linalg.norm(forward)
    axes = np.stack([*_across(forward), forward])
    seen = (points - eye) @ axes.T
    plane = seen[:, :2] if at_infinity else seen[:, :2] / seen[:, 2:]
    low, high = _field(image, plane)
    cell = max(float((high - low).max()) / (EDGE - 2), PIXELS * spacing(image))
    corner = (low + high) / 2 - cell * EDGE / 2
    nearest = np.full((EDGE, EDGE), np.inf)
    column, row = np.clip(((plane - corner) / cell).astype(int), 0, EDGE - 1).T
    np.minimum.at(nearest, (row, column), seen[:, 2])
    centres = corner[:, None] + cell * (np.arange(EDGE) + 0.5)
    held = (centres >= low[:, None]) & (centres <= high[:, None])
    return DepthMap(
        axes=axes.astype(np.float32),
        eye=(eye - origin).astype(np.float32),
        at_infinity=np.asarray(at_infinity, np.float32),
        corner=corner.astype(np.float32),
        cell=np.asarray(cell, np.float32),
        nearest=_least_around(nearest).astype(np.float32).ravel(),
        looked=(held[1][:, None] & held[0][None, :]).ravel(),
    )


def no_depth_map() -> DepthMap:
    """Of a cloud without a known sensor: it knows of no direction."""
    none = np.zeros(EDGE * EDGE, bool)
    zero = np.zeros(3, np.float32)
    far = np.full(EDGE * EDGE, np.inf, np.float32)
    one = np.asarray(1, np.float32)
    return DepthMap(np.eye(3, dtype=np.float32), zero, one, zero[:2], one, far, none)


def _across(forward: Float[np.ndarray, "3"]) -> tuple[np.ndarray, np.ndarray]:
    side = np.cross(np.eye(3)[np.argmin(np.abs(forward))], forward)
    side /= np.linalg.norm(side)
    return side, np.cross(forward, side)


def _field(image: RangeImage, plane: Float[np.ndarray, "n 2"]) -> tuple[np.ndarray, np.ndarray]:
    """The corners of what the sensor looks at: pixels lie evenly in the plane, so the valid ones tell the others."""
    rows, columns = np.nonzero(image.valid)
    pixels = np.column_stack([np.ones(len(rows)), rows, columns])
    place, *_ = np.linalg.lstsq(pixels, plane, rcond=None)
    h, w = image.valid.shape
    corners = np.array([[1, r, c] for r in (0, h - 1) for c in (0, w - 1)]) @ place
    return np.minimum(corners.min(axis=0), plane.min(axis=0)), np.maximum(corners.max(axis=0), plane.max(axis=0))


def _least_around(depth: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    padded = np.pad(depth, 1, constant_values=np.inf)
    h, w = depth.shape
    return np.min([padded[i : i + h, j : j + w] for i in range(3) for j in range(3)], axis=0)
