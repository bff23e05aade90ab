"""The LAPACK-free eigenvector agrees with LAPACK's, at any scale, and says when it is not unique."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.geometry.eigen import largest_eigenvector, smallest_eigenvector

batched = jax.jit(jax.vmap(largest_eigenvector))


def symmetric(eigenvalues: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (n, 4, 4) with given eigenvalues (n, 4), and their eigenvectors in columns."""
    rng = np.random.default_rng(seed)
    V = np.linalg.qr(rng.normal(size=(len(eigenvalues), 4, 4)))[0]
    return np.einsum("nij,nj,nkj->nik", V, eigenvalues, V), V


def solve(matrices: np.ndarray, dtype: type) -> tuple[np.ndarray, np.ndarray]:
    with jax.enable_x64(dtype is np.float64):
        vector, alone = batched(jnp.asarray(matrices, dtype))
        assert vector.dtype == dtype
        return np.asarray(vector), np.asarray(alone)


def sine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sine of the angle between unit vectors, sign ignored."""
    return np.linalg.norm(a - np.sum(a * b, axis=-1, keepdims=True) * b, axis=-1)


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 2e-14), (np.float32, 5e-6)])
def test_agrees_with_lapack(dtype: type, tolerance: float) -> None:  # oracle: numpy.linalg.eigh
    rng = np.random.default_rng(0)
    values = np.sort(rng.uniform(-1, 1, size=(60, 4)), axis=1)
    values[:, 3] = values[:, 2] + rng.uniform(0.2, 1.0, size=60)
    values[:20] -= 5.0  # every eigenvalue negative
    matrices, _ = symmetric(values, 1)
    oracle = np.linalg.eigh(matrices.astype(dtype).astype(np.float64))[1][:, :, 3]
    vector, alone = solve(matrices, dtype)
    np.testing.assert_allclose(np.linalg.norm(vector, axis=1), 1.0, atol=4 * np.finfo(dtype).eps)
    assert sine(vector, oracle).max() < tolerance
    np.testing.assert_allclose(alone, 1.0, atol=1e-5)


@pytest.mark.parametrize(("dtype", "exponents"), [(np.float64, (-60, 0, 60)), (np.float32, (-12, 0, 12))])
def test_any_scale(dtype: type, exponents: tuple[int, ...]) -> None:
    matrices, V = symmetric(np.tile([-1.0, 0.1, 0.4, 1.0], (len(exponents), 1)), 2)
    vector, _ = solve(matrices * 10.0 ** np.asarray(exponents)[:, None, None], dtype)
    assert sine(vector, V[:, :, 3]).max() < 100 * np.finfo(dtype).eps


def test_a_small_gap_is_resolved_in_float64() -> None:
    """A gap of 1e-6 of the norm: the vector is right to eps / gap and still said to be alone."""
    matrices, V = symmetric(np.tile([-0.5, 0.2, 1.0 - 1e-6, 1.0], (10, 1)), 3)
    vector, alone = solve(matrices, np.float64)
    assert sine(vector, V[:, :, 3]).max() < 1e-8
    assert alone.min() > 0.999


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(
    ("values", "expected"), [([-1, 0, 1, 1], 1 / 2), ([-1, 1, 1, 1], 1 / 3), ([1, 1, 1, 1], 1 / 4), ([-1] * 4, 1 / 4)]
)
def test_ties_are_told(dtype: type, values: list[float], expected: float) -> None:
    _, alone = solve(np.diag(np.asarray(values, float))[None], dtype)
    np.testing.assert_allclose(alone, expected, rtol=1e-5)


def test_the_zero_matrix_stays_finite_and_is_not_alone() -> None:
    vector, alone = solve(np.zeros((1, 4, 4)), np.float32)
    assert np.all(np.isfinite(vector))
    assert alone[0] < 0.9


def test_a_lane_does_not_see_its_neighbours() -> None:
    matrices, _ = symmetric(np.tile([-1.0, 0.1, 0.4, 1.0], (4, 1)), 4)
    reference, _ = solve(matrices, np.float32)
    matrices[1], matrices[2] = np.nan, 0.0
    vector, _ = solve(matrices, np.float32)
    np.testing.assert_array_equal(vector[[0, 3]], reference[[0, 3]])


def test_the_smallest_of_a_singular_matrix() -> None:  # oracle: numpy.linalg.svd of the rows
    smallest = jax.jit(jax.vmap(smallest_eigenvector))
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(30, 20, 9))
    rows[:, :, 3] *= 1e-3
    rows -= (rows @ rows[:, :1].swapaxes(1, 2)) * rows[:, :1] / np.sum(rows[:, :1] ** 2, axis=2, keepdims=True)
    matrices = rows.swapaxes(1, 2) @ rows
    expected = np.linalg.svd(rows)[2][:, -1]
    for scale in (1e-40, 1.0, 1e40):
        with jax.enable_x64(True):
            vector = np.asarray(smallest(matrices * scale))
        assert sine(vector, expected).max() < 1e-9


def test_the_smallest_of_noisy_rows() -> None:  # oracle: numpy.linalg.eigh
    matrices, V = symmetric(np.tile([1e-6, 2e-6, 0.5, 1.0], (20, 1)), 6)
    with jax.enable_x64(True):
        vector = np.asarray(jax.jit(jax.vmap(smallest_eigenvector))(matrices))
    assert sine(vector, V[:, :, 0]).max() < 1e-8
