"""A slow reference of the label map and the march, written from the thesis's text and the order of crossings alone.

Plain Python over NumPy scalars: a ray crosses the planes between voxels one after the other, in the order of the time
(float32: a difference and a product) and, at equal times, of the axis. Nothing of ``jaxmodel.plan`` is used.
"""

from collections import defaultdict
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from jaxmodel.scan.range_image import normals

UNKNOWN, EMPTY, OCCUPIED, OCCLUDED, PLANE, BORDER = range(6)
F = np.float32


def walk(origin, direction, shape) -> Iterator[tuple[tuple[int, int, int], np.float32, np.float32]]:
    """Voxels of the grid along a ray (in cells), each with the times it is entered and left."""
    size = np.asarray(shape)
    origin, direction = np.asarray(origin, F), np.asarray(direction, F)
    falls = direction < 0
    start = np.where(falls, size.astype(F) - origin, origin).astype(F)
    speed = np.abs(direction)
    inverse = [F(1) / s if s > F(1e-30) else F(1e30) for s in speed]

    def when(axis: int, boundary: int) -> np.float32:
        return F(F(F(boundary) - start[axis]) * inverse[axis])

    index = [int(np.floor(start[axis])) for axis in range(3)]
    for axis in range(3):
        # every plane crossed by the time 0 lies behind, every later one ahead
        while when(axis, index[axis] + 1) <= 0:
            index[axis] += 1
        while when(axis, index[axis]) > 0:
            index[axis] -= 1
    time = F(0)
    while all(index[axis] < size[axis] for axis in range(3)):
        ahead = [when(axis, index[axis] + 1) for axis in range(3)]
        axis = int(np.argmin(ahead))
        if min(index) >= 0:
            voxel = [int(size[a] - 1 - index[a]) if falls[a] else index[a] for a in range(3)]
            yield (voxel[0], voxel[1], voxel[2]), time, ahead[axis]
        elif ahead[axis] > 1e20:
            return
        time = ahead[axis]
        index[axis] += 1


class Met(NamedTuple):
    """The voxel that stops a ray, None where none does, and when it is entered."""

    voxel: tuple[int, int, int] | None
    entered: float


def first_met(origin, direction, labels, nearest: Any = 0.0, farthest: Any = np.inf) -> Met:
    """First voxel that is not empty, if it is entered between the nearest and the farthest time."""
    for voxel, enters, _ in walk(origin, direction, labels.shape):
        if enters > farthest:
            break
        if labels[voxel] != EMPTY:
            return Met(voxel, float(enters)) if enters >= nearest else Met(None, np.nan)
    return Met(None, np.nan)


class Evidence:
    """What range images told, voxel by voxel, in dictionaries."""

    def __init__(self, shape):
        self.shape = shape
        self.points = np.zeros(shape, int)
        self.nearest = np.full(shape, np.inf, F)
        self.normals = defaultdict(list)
        self.crossed = np.zeros(shape, bool)
        self.eyes = defaultdict(list)
        self.outside = 0

    def add(self, grid, image, T, free_rays=(), reaches=()):
        """A pinhole image from ``T`` (sensor to world); directions (sensor) that met nothing, and their reach."""
        R, t = T[:3, :3], T[:3, 3]
        behind = set()
        normal = normals(image)
        lower, cell = np.asarray(grid.origin), grid.cell
        points = image.points[image.valid]
        lengths = np.linalg.norm(points, axis=1)
        directions = (points / lengths[:, None]) @ R.T
        for point, length, direction, facing in zip(points, lengths, directions, normal[image.valid], strict=True):
            at = tuple(int(v) for v in np.floor((R @ point + t - lower) / cell))
            held = all(0 <= at[a] < self.shape[a] for a in range(3))
            reading = F(length / cell)
            if held:
                self.points[at] += 1
                self.nearest[at] = min(self.nearest[at], F(reading * F(cell)))
                self.normals[at].append(R @ facing)
            else:
                self.outside += 1
            for voxel, enters, leaves in walk((t - lower) / cell, direction, self.shape):
                if voxel == at and held:
                    continue
                if leaves <= reading:
                    self.crossed[voxel] = True
                elif enters >= reading:
                    behind.add(voxel)
        for direction, reach in zip(np.reshape(free_rays, (-1, 3)) @ R.T, reaches, strict=True):
            for voxel, _, leaves in walk((t - lower) / cell, direction, self.shape):
                if leaves <= F(reach / cell):
                    self.crossed[voxel] = True
        for voxel in behind:
            self.eyes[voxel].append(t)

    def neighbours(self, voxel, open_outside):
        """Direction and voxel of the six beside one; None for one beyond the map, where that is open."""
        for axis in range(3):
            for way in (1, -1):
                beside = tuple(voxel[a] + way * (a == axis) for a in range(3))
                if all(0 <= beside[a] < self.shape[a] for a in range(3)):
                    yield axis, way, beside
                elif open_outside:
                    yield axis, way, None

    def labels(self, open_outside):
        """The six labels by their definitions."""
        known = np.full(self.shape, UNKNOWN)
        for voxel in np.ndindex(self.shape):
            if self.points[voxel]:
                known[voxel] = OCCUPIED
            elif self.crossed[voxel]:
                known[voxel] = EMPTY
            elif self.eyes[voxel]:
                known[voxel] = OCCLUDED
        found = known.copy()
        for voxel in np.ndindex(self.shape):
            beside = [EMPTY if b is None else known[b] for _, _, b in self.neighbours(voxel, open_outside)]
            if known[voxel] == OCCLUDED and EMPTY in beside:
                found[voxel] = PLANE
            if known[voxel] == OCCUPIED and UNKNOWN in beside:
                found[voxel] = BORDER
        return found

    def mean_normal(self, voxel):
        """Of the points; before normalising."""
        return np.sum(self.normals[voxel], axis=0)

    def plane_normal(self, grid, voxel, labels, open_outside):
        """Towards the empty neighbours, less what of it lies along the rays, summed over the views; not normalised."""
        towards = np.zeros(3)
        for axis, way, beside in self.neighbours(voxel, open_outside):
            towards[axis] += way * (beside is None or labels[beside] == EMPTY)
        total = np.zeros(3)
        for eye in self.eyes[voxel]:
            ray = np.asarray(grid.origin) + (np.asarray(voxel) + 0.5) * grid.cell - eye
            ray = ray / np.linalg.norm(ray)
            total += towards - (towards @ ray) * ray
        return total
