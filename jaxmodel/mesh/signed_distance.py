"""Signed distance of a voxel grid's nodes from oriented points (Hoppe et al. 1992), where points are near."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.mesh.prepare import Prepared

NEIGHBOURS = 8
BLOCK = 1 << 18  # nodes asked at a time: bounds the memory


class DistanceField(NamedTuple):
    """``value`` at the centres of a grid's cells, positive outside; ``known`` where points are near enough to tell."""

    grid: VoxelGrid
    value: Float[np.ndarray, "i j k"]
    known: Bool[np.ndarray, "i j k"]


def grid_of(points: Float[np.ndarray, "n 3"], cell: float) -> VoxelGrid:
    """A grid around a cloud with three cells of margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    shape = np.ceil((high - low) / cell).astype(int) + 6
    return VoxelGrid((low + high) / 2 - cell * shape / 2, float(cell), (int(shape[0]), int(shape[1]), int(shape[2])))


def signed_distance(cloud: Prepared, grid: VoxelGrid, reach: float) -> DistanceField:
    """Mean distance of each node from its nearest points' tangent planes, near ones weighing more.

    Known within ``reach`` of a point: beyond, the surface stays open, as it does where nothing was measured.
    """
    points, normals, tree = cloud.points, cloud.normals, cloud.tree
    count = int(np.prod(grid.shape))
    value, known = np.zeros(count), np.zeros(count, bool)
    neighbours = min(NEIGHBOURS, len(points))
    for first in range(0, count, BLOCK):
        keys = np.arange(first, min(first + BLOCK, count))
        nodes = grid.centres(keys)
        distance, index = tree.query(nodes, k=neighbours, distance_upper_bound=reach, workers=-1)
        distance, index = distance.reshape(len(keys), -1), index.reshape(len(keys), -1)
        near = np.isfinite(distance[:, 0])
        nodes, distance, index = nodes[near], distance[near], index[near]
        there = np.isfinite(distance)
        index = np.where(there, index, 0)
        scale = np.maximum(distance[:, :1], 1e-3 * reach)
        weight = np.where(there, np.exp(-(np.where(there, distance / scale, 0.0) ** 2)), 0.0)
        height = np.einsum("nka,nka->nk", nodes[:, None] - points[index], normals[index])
        value[keys[near]] = (weight * height).sum(axis=1) / weight.sum(axis=1)
        known[keys[near]] = True
    return DistanceField(grid, value.reshape(grid.shape), known.reshape(grid.shape))
