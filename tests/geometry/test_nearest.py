"""The voxel table against brute force, and brute force against an oracle (scipy's k-d tree)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.nearest import (
    FAR,
    Neighbours,
    VoxelTable,
    build_table,
    candidate_stack,
    nearest_brute,
    nearest_one,
    nearest_table,
)

brute = jax.jit(nearest_brute, static_argnums=2)
table_stack = jax.jit(nearest_table, static_argnums=3)
table_one = jax.jit(nearest_one)


def surface(count: int, seed: int = 0) -> np.ndarray:
    """Random points on a bumpy closed surface about one unit across, in no special place or orientation."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    x, y, z = directions.T
    radius = 0.5 * (1 + 0.2 * np.sin(5 * x + 1) * np.cos(4 * y) + 0.15 * np.sin(6 * z))
    points = radius[:, None] * directions * [1.0, 0.8, 0.7]
    return points @ Rotation.from_rotvec([0.5, 0.3, -0.8]).as_matrix().T + [0.1, -0.2, 0.3]


def queries_near(points: np.ndarray, reach: float, count: int, seed: int = 1) -> np.ndarray:
    """Queries at most ``reach`` from a point of the cloud, as a kernel holds them: float32 (3, n)."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    start = points[rng.integers(len(points), size=count)]
    return np.ascontiguousarray((start + rng.uniform(0, reach, size=(count, 1)) * direction).T, np.float32)


def columns(points: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(points.T, np.float32)


def agreement(points: np.ndarray, cells: int, candidates: int, k: int = 4, count: int = 20_000) -> tuple[float, float]:
    """Share of queries within three cells of the cloud with the same nearest, and with the same k nearest as sets."""
    table = build_table(points, cells, candidates)
    queries = queries_near(points, 3 * table.cell, count)
    found = np.asarray(table_stack(table, columns(points), queries, k).index)
    _, nearest = KDTree(columns(points).T).query(queries.T, k=k)  # oracle; equal to brute force, see below
    true = np.asarray(nearest)
    same_set = np.all(np.sort(found.T, axis=1) == np.sort(true, axis=1), axis=1)
    return float(np.mean(found[0] == true[:, 0])), float(np.mean(same_set))


@pytest.mark.parametrize("offset", [0.0, 50.0])
def test_brute_force_is_the_oracles(offset: float) -> None:
    """1000 queries are not a multiple of the block; offsets are in units of the cloud's size."""
    points = columns(surface(700) + offset)
    queries = columns(np.random.default_rng(3).uniform(-1, 1, size=(1000, 3)) + offset)
    found: Neighbours = brute(points, queries, 5)
    distance, index = KDTree(points.T.astype(np.float64)).query(queries.T.astype(np.float64), k=5)
    rounding = 4e-7 * max(offset, 1.0)
    np.testing.assert_allclose(np.sqrt(found.squared_distance.T), distance, rtol=0, atol=rounding)
    differs = index != np.asarray(found.index).T  # only where two distances are equal to rounding
    assert differs.mean() < 1e-3
    assert np.all(np.diff(distance, axis=1)[:, :].min(axis=1)[differs.any(axis=1)] < 4 * rounding)
    assert found.index.dtype == np.int32


def test_brute_force_of_one_query_and_one_point() -> None:
    found = brute(jnp.asarray([[1.0], [2.0], [3.0]]), jnp.asarray([[1.0], [2.0], [5.0]]), 1)
    assert found.index.tolist() == [[0]]
    assert found.squared_distance.tolist() == [[4.0]]


def test_2000_points_near_the_cloud() -> None:
    nearest, four = agreement(surface(2000), cells=128, candidates=8)
    assert nearest >= 0.999
    assert four >= 0.99


@pytest.mark.slow
def test_40000_points_of_a_surface_near_the_cloud() -> None:
    nearest, four = agreement(surface(40_000), cells=128, candidates=16)
    assert nearest >= 0.99
    assert four >= 0.99


@pytest.mark.slow
@pytest.mark.data
def test_40000_points_of_a_real_scan_near_the_cloud(data_dir) -> None:
    from jaxmodel.io.datasets import StanfordBunny

    image = StanfordBunny(data_dir).scan("bun000")
    points = np.asarray(image.points[image.valid], np.float64)
    assert len(points) > 40_000
    nearest, four = agreement(points, cells=160, candidates=16)  # 128: 0.999 and 0.976
    assert nearest >= 0.99
    assert four >= 0.99


@pytest.fixture(scope="module")
def small() -> tuple[np.ndarray, VoxelTable]:
    """A cloud and a table of few cells, eight candidates each."""
    points = surface(600)
    return points, build_table(points, 24, 8)


def test_one_index_per_cell_is_exact_up_to_the_cell(small) -> None:
    """Everywhere inside the table the distance is within one cell diagonal of the true one."""
    points, table = small
    rng = np.random.default_rng(4)
    queries = (table.origin + rng.uniform(0, 24, size=(50_000, 3)) * table.cell).astype(np.float32)
    found = np.linalg.norm(points[np.asarray(table_one(table, queries.T))] - queries, axis=1)
    true, _ = KDTree(points).query(queries)
    excess = found - true
    assert excess.min() > -1e-6
    assert excess.max() <= np.sqrt(3) * table.cell
    assert np.mean(excess < 1e-6) > 0.5


def test_a_cells_row_is_ordered_from_its_centre(small) -> None:
    points, table = small
    keys = np.random.default_rng(5).integers(24**3, size=2000)
    centres = np.asarray(table.origin) + (np.stack(np.unravel_index(keys, (24, 24, 24)), axis=-1) + 0.5) * table.cell
    distance, _ = KDTree(points).query(centres, k=8)
    near = distance[:, 0] <= 4 * table.cell  # further out a cell holds the neighbours of its nearest point
    assert near.sum() > 500
    keys, centres, distance = keys[near], centres[near], distance[near]
    rows = np.linalg.norm(points[np.asarray(table.index)[keys]] - centres[:, None], axis=2)
    np.testing.assert_allclose(rows, distance, atol=1e-6)
    first = np.asarray(table_one(table, columns(centres)))
    np.testing.assert_array_equal(first, np.asarray(table.index)[keys, 0])


def test_the_stack_ranks_its_cells_candidates(small) -> None:
    """All eight in order of true distance (to 2 parts in a million), and k of them are the first k."""
    points, table = small
    queries = queries_near(points, 0.3, 2000)
    found = table_stack(table, columns(points), queries, 8)
    index, squared = np.asarray(found.index), np.asarray(found.squared_distance)
    assert np.all(np.sort(index, axis=0)[1:] != np.sort(index, axis=0)[:-1])
    assert np.all(np.diff(squared, axis=0) >= 0)
    true = np.sum((columns(points)[:, index] - queries[:, None, :]) ** 2, axis=0)
    np.testing.assert_allclose(squared, true, rtol=3e-6)
    shorter = table_stack(table, columns(points), queries, 3)
    np.testing.assert_array_equal(shorter.index, index[:3])
    np.testing.assert_array_equal(shorter.squared_distance, squared[:3])


@pytest.mark.parametrize("k", [1, 4])
def test_outside_the_cube_the_nearest_cell_answers(small, k: int) -> None:
    points, table = small
    edge = 24 * table.cell
    outside = table.origin + np.array([[-2.0, 0.5, 0.5], [0.5, 3.0, 0.5], [1.5, -1.5, 7.0], [-1e6, 1e6, 0.5]]) * edge
    cell = np.clip(np.floor((outside - table.origin) / table.cell), 0, 23).astype(int)
    keys = (cell[:, 0] * 24 + cell[:, 1]) * 24 + cell[:, 2]
    found = np.asarray(table_stack(table, columns(points), columns(outside), k).index)
    assert all(set(found[:, i]) <= set(np.asarray(table.index)[keys[i]].tolist()) for i in range(4))
    np.testing.assert_array_equal(table_one(table, columns(outside)), np.asarray(table.index)[keys, 0])


@pytest.mark.parametrize("count", [1, 3, 5])
def test_fewer_points_than_candidates_gives_each_once(count: int) -> None:
    points = surface(count, 7)
    table = build_table(points, 8, 8, margin=0.2)
    queries = np.random.default_rng(8).uniform(-1, 1, size=(3, 100)).astype(np.float32)
    found = table_stack(table, columns(points), queries, 8)
    index, squared = np.asarray(found.index), np.asarray(found.squared_distance)
    np.testing.assert_array_equal(np.sort(index[:count], axis=0), np.tile(np.arange(count)[:, None], 100))
    assert np.all(squared[:count] < 1e3)
    np.testing.assert_array_equal(squared[count:], FAR)
    assert np.all((index >= 0) & (index < count))


def test_refused_candidates_do_not_enter_the_stack(small) -> None:
    """The stack holds the nearest accepted candidates; nothing is below FAR beyond them."""
    points, table = small
    queries = queries_near(points, 0.1, 3000)
    accept = lambda point: point[0] > 0.1  # noqa: E731
    found = candidate_stack(table, jnp.asarray(columns(points)), jnp.asarray(queries), 4, accept)
    everything = table_stack(table, columns(points), queries, 8)
    accepted = columns(points)[0][np.asarray(everything.index)] > 0.1
    some = accepted.any(axis=0)
    assert np.mean(~some) > 0.02
    assert np.mean(some & ~accepted.all(axis=0)) > 0.02
    for query in range(0, 3000, 7):
        expected = np.asarray(everything.index)[accepted[:, query], query][:4]
        np.testing.assert_array_equal(np.asarray(found.index)[: len(expected), query], expected)
        np.testing.assert_array_equal(np.asarray(found.squared_distance)[len(expected) :, query], FAR)
        assert np.all(np.asarray(found.squared_distance)[: len(expected), query] < FAR)


def test_more_neighbours_than_candidates_is_refused(small) -> None:
    points, table = small
    with pytest.raises(ValueError, match="8 candidates per cell cannot give 9"):
        nearest_table(table, jnp.asarray(columns(points)), jnp.zeros((3, 1)), 9)


@pytest.mark.parametrize(("count", "dtype"), [(32_767, np.int16), (32_768, np.int32), (70_000, np.int32)])
def test_indices_are_wide_enough(count: int, dtype: type) -> None:
    points = np.random.default_rng(9).uniform(-1, 1, size=(count, 3))
    table = build_table(points, 16, 1)
    assert table.index.dtype == dtype
    corner = np.stack(np.unravel_index(np.arange(16**3), (16, 16, 16)), axis=-1) * table.cell
    centres = np.asarray(table.origin) + corner + table.cell / 2
    _, index = KDTree(points).query(centres)
    found = np.asarray(table_one(table, columns(centres)))
    assert found.dtype == np.int32
    np.testing.assert_array_equal(found, index)
    assert found.max() > min(count - 1, 32_767) * 0.9
    assert count < 40_000 or found.max() > 32_767


@pytest.mark.parametrize("scale", [1e3, 1e-3])
def test_the_unit_of_length_does_not_matter(small, scale: float) -> None:
    points, table = small
    other = build_table(points * scale, 24, 8)
    assert np.mean(other.index[:, 0] == table.index[:, 0]) > 0.9999
    np.testing.assert_allclose(other.cell, table.cell * scale, rtol=1e-6)
