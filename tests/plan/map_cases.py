"""Random range images of random surfaces, and label maps of random labels, for the tests of planning."""

import numpy as np

from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays

SENSOR = Sensor(13, 11, field_of_view_deg=70.0)
GRIDS = (
    VoxelGrid(np.array([-1.0, 0.5, 2.0]), 0.25, (12, 12, 12)),
    VoxelGrid(np.array([3.0, -2.0, 0.0]), 0.5, (11, 15, 8)),
)


def random_rotation(rng) -> np.ndarray:
    turned, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turned * np.linalg.det(turned)


def random_pose(rng, grid, inside: bool) -> np.ndarray:
    """From within the grid anyhow, or from around it looking about its middle."""
    T = np.eye(4)
    T[:3, :3] = random_rotation(rng)
    size = np.asarray(grid.shape) * grid.cell
    if inside:
        T[:3, 3] = grid.origin + rng.random(3) * size
    else:
        T[:3, 3] = grid.origin + size / 2 - T[:3, 2] * size.max() * rng.uniform(0.8, 1.6)
    return T


def axis_pose(grid, axis: int, place) -> np.ndarray:
    """Looking along an axis of the grid from ``place`` (cells): rays in planes between voxels, and along them."""
    T = np.eye(4)
    T[:3, :3] = np.roll(np.eye(3), axis + 1, axis=0)
    T[:3, 3] = grid.origin + np.asarray(place, float) * grid.cell
    return T


def random_image(rng, grid, sensor: Sensor = SENSOR) -> RangeImage:
    """A wavy surface with jumps and holes, some of it beyond the grid."""
    v, u = np.mgrid[: sensor.height, : sensor.width]
    size = max(grid.shape) * grid.cell
    depth = size * (rng.uniform(0.3, 1.2) + 0.05 * np.sin(u * rng.uniform(0, 1)) + 0.02 * rng.random(u.shape))
    depth = np.where((u > rng.uniform(2, sensor.width)) & (v > 4), depth * rng.uniform(0.4, 1.5), depth)
    depth = np.where(rng.random(u.shape) < 0.05, np.round(depth / grid.cell) * grid.cell, depth)
    valid = rng.random(u.shape) < 0.9
    valid[:, : rng.integers(0, sensor.width // 2)] = False
    points = np.where(valid[..., None], depth[..., None] * pixel_rays(sensor).directions, np.nan)
    return RangeImage(points, valid)
