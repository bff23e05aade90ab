"""Closest points of a static cloud: a voxel table (fast path) and brute force (reference).

The table holds, for each cell of a cube around the cloud, the indices of the points nearest to the cell's centre. A
query looks its cell up and ranks that cell's candidates by their true distance. With one index per cell the answer is
exact up to the cell; with more candidates than neighbours asked for it is exact nearly everywhere near the cloud
(``tests/geometry/test_nearest.py`` holds the figures). Outside the cube a query is answered by the nearest cell.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt
from scipy.spatial import KDTree

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.voxel_grid import VoxelGrid, cube_around

# The squared distance that stands for "no such neighbour". Finite on purpose: the kernels let the compiler reorder
# sums, and sentinels must survive that whatever it assumes of infinities. A power of two: ``candidate_stack`` clears
# the lowest bits of squared distances, and "below FAR" must mean "a neighbour" before and after.
FAR = np.float32(2.0**100)


class Neighbours(eqx.Module):
    """The ``k`` nearest points of each query, nearest first; structure of arrays, as the kernels want them."""

    index: Int[jax.Array, "k n"]
    squared_distance: Float[jax.Array, "k n"]


class VoxelTable(eqx.Module):
    """``index[cell, rank]`` with flat row-major cells; int16 up to 32 767 points, int32 beyond."""

    index: Int[AnyArray, "cells candidates"]
    origin: Float[AnyArray, "3"]
    inverse_cell: Float[AnyArray, ""]
    distinct: UInt[AnyArray, ""]  # columns that hold different points: all, but for tiny clouds
    cells_per_edge: int = eqx.field(static=True)

    @property
    def candidates(self) -> int:
        return self.index.shape[1]

    @property
    def cell(self) -> float:
        """Edge of a cell in the unit of the data (host only)."""
        return float(1.0 / self.inverse_cell)


def build_table(
    points: Float[np.ndarray, "n 3"], cells: int = 128, candidates: int = 1, margin: float | None = None
) -> VoxelTable:
    """Build the table on the host.

    ``margin`` grows the cloud's box on every side (unit of the data; default three cells). Rows are ordered by distance
    to the cell's centre. With fewer points than candidates, the last index is repeated. With several candidates, cells
    further than four cells from the cloud hold the neighbours of the point nearest to them, found on a grid of half
    the resolution: nothing closer is told apart there, and the table is built several times faster.
    """
    if margin is None:
        margin = 3.0 / max(cells - 6, 1) * float(np.ptp(points, axis=0).max())
    grid = cube_around(points, cells, margin)
    tree = KDTree(points, balanced_tree=False, compact_nodes=False)
    found = min(candidates, len(points))
    dtype = np.int16 if len(points) <= np.iinfo(np.int16).max else np.int32
    if found == 1 or cells % 2:
        index = _query(tree, grid, np.arange(cells**3), found, dtype)
    else:
        index = _near_and_far(tree, points, grid, found, dtype)
    index = np.concatenate([index, np.repeat(index[:, -1:], candidates - found, axis=1)], axis=1)
    inverse_cell = np.asarray(1.0 / grid.cell, np.float32)
    return VoxelTable(index, grid.origin.astype(np.float32), inverse_cell, np.asarray(found, np.uint32), cells)


def _query(tree: KDTree, grid: VoxelGrid, keys: np.ndarray, found: int, dtype: type) -> np.ndarray:
    """The ``found`` points nearest to the centres of some cells, in slabs that keep the tree's answer small."""
    index = np.empty((len(keys), found), dtype)
    for first in range(0, len(keys), 1 << 18):
        part = slice(first, first + (1 << 18))
        _, nearest = tree.query(grid.centres(keys[part]), k=found, workers=-1)
        index[part] = np.asarray(nearest).reshape(-1, found)
    return index


def _near_and_far(tree: KDTree, points: np.ndarray, grid: VoxelGrid, found: int, dtype: type) -> np.ndarray:
    cells = grid.shape[0]
    half = VoxelGrid(grid.origin, 2 * grid.cell, (cells // 2, cells // 2, cells // 2))
    distance, nearest = tree.query(half.centres(np.arange((cells // 2) ** 3)), workers=-1)
    # four cells, plus half the diagonal of the coarse cell whose centre was asked
    near = (np.asarray(distance) <= (4.0 + np.sqrt(3.0)) * grid.cell).reshape(half.shape)
    _, neighbours = tree.query(points, k=found, workers=-1)
    index = np.asarray(neighbours, dtype).reshape(-1, found)[np.asarray(nearest).reshape(half.shape)]
    for axis in range(3):
        near, index = near.repeat(2, axis=axis), index.repeat(2, axis=axis)
    index = index.reshape(-1, found)
    keys = np.flatnonzero(near)
    index[keys] = _query(tree, grid, keys, found, dtype)
    return index


def cell_keys(table: VoxelTable, queries: Float[jax.Array, "3 n"]) -> UInt[jax.Array, " n"]:
    """Flat cell of each query, clamped into the table; unsigned, so that no wrap-around of negatives is emitted."""
    cells = table.cells_per_edge
    scaled = (queries - jnp.asarray(table.origin)[:, None]) * table.inverse_cell
    i, j, k = jnp.clip(scaled, 0.0, cells - 1.0).astype(jnp.uint32)
    return (i * jnp.uint32(cells) + j) * jnp.uint32(cells) + k


def gather(values: jax.Array, index: jax.Array) -> jax.Array:
    """``values[index]`` without bounds checks; the caller guarantees 0 <= index < len(values)."""
    return values.at[index.astype(jnp.uint32)].get(mode="promise_in_bounds")


def nearest_one(table: VoxelTable, queries: Float[jax.Array, "3 n"]) -> Int[jax.Array, " n"]:
    """Index of the point nearest to the centre of each query's cell: one gather per query, exact up to the cell."""
    flat = jnp.asarray(table.index).reshape(-1)
    return gather(flat, cell_keys(table, queries) * jnp.uint32(table.candidates)).astype(jnp.int32)


def nearest_table(
    table: VoxelTable, points: Float[jax.Array, "3 m"], queries: Float[jax.Array, "3 n"], k: int
) -> Neighbours:
    """The k nearest among each cell's candidates, ranked by true distance; ``FAR`` where fewer than k exist."""
    return candidate_stack(table, points, queries, k)


def candidate_stack(
    table: VoxelTable,
    points: Float[jax.Array, "3 m"],
    queries: Float[jax.Array, "3 n"],
    k: int,
    accept: Callable[[list[jax.Array]], Bool[jax.Array, " n"]] | None = None,
) -> Neighbours:
    """As ``nearest_table``; candidates whose coordinates ``accept`` refuses do not enter the stack.

    The bits of a non-negative float order like an integer, so a candidate's squared distance and its column make one
    key: the lowest bits of the distance give way to the column (a relative 2e-6 with 16 candidates). The next nearest
    is then the smallest key above the last one, which needs neither swaps nor masks.
    """
    if k > table.candidates:
        raise ValueError(f"a table with {table.candidates} candidates per cell cannot give {k} neighbours")
    flat = jnp.asarray(table.index).reshape(-1)
    first = cell_keys(table, queries) * jnp.uint32(table.candidates)
    low_bits = (1 << max(table.candidates - 1, 1).bit_length()) - 1

    # Both loops are there for what they return: a loop's result is stored once, where the compiler would fold plain
    # array code into each of its uses and look every candidate up again and again.
    def column_keys(column: jax.Array) -> Int[jax.Array, " n"]:
        index = gather(flat, first + column)
        point = [gather(points[axis], index) for axis in range(3)]
        squared = sum((point[axis] - queries[axis]) ** 2 for axis in range(3))
        # with fewer points than candidates the last index is repeated
        squared = jnp.where(column < table.distinct, squared, FAR)
        if accept is not None:
            squared = jnp.where(accept(point), squared, FAR)
        bits = jax.lax.bitcast_convert_type(squared, jnp.int32)
        return (bits & ~low_bits) | column.astype(jnp.int32)

    keys = jax.lax.map(column_keys, jnp.arange(table.candidates, dtype=jnp.uint32))

    def next_nearest(last: jax.Array, _: object) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        last = jnp.min(jnp.where(keys > last, keys, jnp.iinfo(jnp.int32).max), axis=0)
        index = gather(flat, first + (last & low_bits).astype(jnp.uint32)).astype(jnp.int32)
        return last, (index, jax.lax.bitcast_convert_type(last & ~low_bits, jnp.float32))

    _, (index, squared) = jax.lax.scan(next_nearest, jnp.full(queries.shape[1], -1, jnp.int32), None, length=k)
    return Neighbours(index, squared)


def nearest_brute(
    points: Float[jax.Array, "3 m"], queries: Float[jax.Array, "3 n"], k: int, block: int = 256
) -> Neighbours:
    """The k nearest points by comparing every pair, ``block`` queries at a time (reference; O(block x m) memory)."""
    count = queries.shape[1]
    padded = jnp.pad(queries, ((0, 0), (0, -count % block)))

    def one_block(q: jax.Array) -> tuple[jax.Array, jax.Array]:
        squared = sum((q[axis][:, None] - points[axis][None, :]) ** 2 for axis in range(3))
        negative, index = jax.lax.top_k(-jnp.asarray(squared), k)
        return index.astype(jnp.int32).T, -negative.T

    index, squared = jax.lax.map(one_block, padded.reshape(3, -1, block).transpose(1, 0, 2))
    return Neighbours(
        index.transpose(1, 0, 2).reshape(k, -1)[:, :count], squared.transpose(1, 0, 2).reshape(k, -1)[:, :count]
    )
