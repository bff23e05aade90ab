"""Cells, keys and centres are one another's inverse, and the cube holds its cloud."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.geometry.voxel_grid import VoxelGrid, cube_around

GRID = VoxelGrid(np.array([-1.0, 20.0, 300.0]), 0.25, (3, 5, 4))


def test_keys_number_the_cells_row_major() -> None:
    keys = np.arange(3 * 5 * 4)
    centres = GRID.centres(keys)
    indices = GRID.indices(centres)
    np.testing.assert_array_equal(GRID.keys(indices), keys)
    np.testing.assert_array_equal(indices, np.stack(np.unravel_index(keys, GRID.shape), axis=-1))
    assert GRID.inside(indices).all()
    np.testing.assert_allclose(centres[0], GRID.origin + 0.125)


@given(st.integers(0, 10_000))
def test_a_point_lies_within_half_a_cell_of_its_centre(seed: int) -> None:
    points = GRID.origin + np.random.default_rng(seed).uniform(0, 1, size=(2, 9, 3)) * np.array(GRID.shape) * GRID.cell
    indices = GRID.indices(points)
    assert GRID.inside(indices).all()
    assert np.abs(GRID.centres(GRID.keys(indices)) - points).max() <= GRID.cell / 2 * (1 + 1e-9)


def test_outside_is_told_on_each_side() -> None:
    middle = np.array([1, 2, 2])
    for axis in range(3):
        for wrong in (-1, GRID.shape[axis]):
            cell = middle.copy()
            cell[axis] = wrong
            assert not GRID.inside(cell)
    assert GRID.inside(middle)
    below = GRID.origin - np.array([1e-9, 0.0, 0.0])
    assert GRID.indices(below)[0] == -1


@pytest.mark.parametrize("offset", [0.0, 1e4])
@pytest.mark.parametrize("margin", [0.0, 0.3])
def test_the_cube_is_centred_on_the_box_and_as_large_as_it_must_be(offset: float, margin: float) -> None:
    points = offset + np.random.default_rng(2).uniform(-1, 1, size=(50, 3)) * np.array([3.0, 1.0, 0.2])
    grid = cube_around(points, 16, margin)
    low, high = points.min(axis=0), points.max(axis=0)
    assert grid.shape == (16, 16, 16)
    np.testing.assert_allclose(grid.cell * 16, (high - low).max() + 2 * margin, rtol=1e-9)
    np.testing.assert_allclose(grid.origin + 8 * grid.cell, (low + high) / 2, rtol=1e-9, atol=1e-9)
    lowest, highest = grid.origin, grid.origin + 16 * grid.cell
    assert np.all(lowest <= low - margin + 1e-9 * (1 + offset))
    assert np.all(highest >= high + margin - 1e-9 * (1 + offset))


def test_bad_grids_are_refused() -> None:
    with pytest.raises(ValueError, match="cell edge"):
        VoxelGrid(np.zeros(3), 0.0, (1, 1, 1))
    with pytest.raises(ValueError, match="cell edge"):
        VoxelGrid(np.zeros(3), float("nan"), (1, 1, 1))
    with pytest.raises(ValueError, match="at least one cell"):
        VoxelGrid(np.zeros(3), 1.0, (4, 0, 4))
    with pytest.raises(ValueError, match="coincide"):
        cube_around(np.ones((5, 3)), 8, 0.0)
    assert cube_around(np.ones((5, 3)), 8, 0.5).cell == 1.0 / 8
