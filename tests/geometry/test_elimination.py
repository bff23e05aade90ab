"""Elimination agrees with LAPACK, and says when a system has no single answer."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.geometry.elimination import inverse_positive, solve_positive, solve_semidefinite, square_root

solve = jax.jit(solve_positive)


def test_solve_positive_is_numpys() -> None:  # oracle: numpy.linalg.solve
    for seed in range(10):
        rng = np.random.default_rng(seed)
        rows = rng.normal(size=(40, 6)) * [1e3, 1e3, 1e3, 1, 1, 1]  # rotations and translations in unlike units
        matrix, right = rows.T @ rows, rng.normal(size=6)
        solution, well_posed = solve(matrix.astype(np.float32), right.astype(np.float32))
        expected = np.linalg.solve(matrix, right)
        assert bool(well_posed)
        np.testing.assert_allclose(solution, expected, rtol=0, atol=2e-5 * np.abs(expected).max())


def test_solve_positive_tells_a_singular_system() -> None:
    rows = np.random.default_rng(0).normal(size=(40, 6))
    rows[:, 5] = rows[:, 0] + rows[:, 3]
    _, well_posed = solve((rows.T @ rows).astype(np.float32), np.ones(6, np.float32))
    assert not bool(well_posed)
    solution, well_posed = solve(jnp.zeros((6, 6)), jnp.zeros(6))
    assert not bool(well_posed)
    assert np.all(np.isfinite(solution))


@pytest.mark.parametrize("size", [3, 6, 12])
def test_inverse(size: int) -> None:  # oracle: numpy.linalg.inv
    rng = np.random.default_rng(size)
    rows = rng.normal(size=(40, size)) * 10.0 ** rng.integers(-3, 4, size=size)
    matrix = rows.T @ rows
    with jax.enable_x64(True):
        inverse = np.asarray(jax.jit(inverse_positive)(matrix))
    unit = 1.0 / np.sqrt(np.diag(matrix))
    expected = np.outer(unit, unit) * np.linalg.inv(np.outer(unit, unit) * matrix)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((inverse - expected) / scale).max() < 1e-12


def test_a_semidefinite_system_is_solved_where_it_speaks() -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(3, 6))
    matrix, right = rows.T @ rows, rows.T @ rng.normal(size=3)
    with jax.enable_x64(True):
        x = np.asarray(jax.jit(solve_semidefinite)(matrix, right))
        nothing = np.asarray(jax.jit(solve_semidefinite)(np.zeros((6, 6)), np.zeros(6)))
    np.testing.assert_allclose(matrix @ x, right, atol=1e-10)
    np.testing.assert_array_equal(nothing, 0.0)


@pytest.mark.parametrize("rank", [0, 3, 6])
def test_square_root(rank: int) -> None:
    rows = np.random.default_rng(rank).normal(size=(rank, 6)) * [1e-4, 1, 1, 1e3, 1, 1]
    matrix = rows.T @ rows
    with jax.enable_x64(True):
        root = np.asarray(jax.jit(square_root)(matrix))
    scale = np.sqrt(np.maximum(np.outer(np.diag(matrix), np.diag(matrix)), 1e-300))
    assert np.all(np.abs(root.T @ root - matrix) <= 1e-12 * scale)
