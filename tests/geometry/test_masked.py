"""Padding adds nothing: statistics of masked entries equal NumPy's on the entries alone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.geometry import masked


@given(st.integers(0, 5_000_000))
def test_size_class_holds_the_count_and_wastes_little(count: int) -> None:
    length = masked.size_class(count)
    assert length >= max(count, 256)
    assert length == 256 or length < 1.5 * count
    assert length & (length - 1) == 0 or (length % 3 == 0 and (length // 3) & (length // 3 - 1) == 0)
    assert masked.size_class(length) == length


def test_size_classes_are_few_and_grow() -> None:
    lengths = [masked.size_class(count) for count in range(1, 5000)]
    assert sorted(lengths) == lengths
    assert sorted(set(lengths)) == [256, 384, 512, 768, 1024, 1536, 2048, 3072, 4096, 6144]
    assert masked.size_class(3, smallest=4) == 4


@pytest.mark.parametrize("values", [np.arange(12.0, dtype=np.float32).reshape(4, 3), np.ones(5, bool), np.arange(3)])
def test_pad_rows_keeps_rows_and_type(values: np.ndarray) -> None:
    padded = masked.pad_rows(values, 7)
    assert padded.dtype == values.dtype
    assert padded.shape == (7, *values.shape[1:])
    np.testing.assert_array_equal(padded[: len(values)], values)
    assert not padded[len(values) :].any()


def batch(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Values (6, 2, 40) with NaN, inf and -inf wherever the mask is not set; rows of one and of 40 entries."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(6, 2, 40)).astype(np.float32)
    values[0] = np.round(values[0])  # ties
    mask = rng.uniform(size=values.shape) < rng.uniform(0.1, 1.0, size=(6, 2, 1))
    mask[..., 7] = True
    mask[1, 0] = np.arange(40) == 3
    mask[2, 1] = True
    junk = rng.choice(np.asarray([np.nan, np.inf, -np.inf, 1e30], np.float32), size=values.shape)
    return np.where(mask, values, junk), mask


def test_mean_is_that_of_the_entries() -> None:
    values, mask = batch()
    ours = np.asarray(masked.mean(jnp.asarray(values), jnp.asarray(mask)))
    expected = [[values[i, j][mask[i, j]].mean() for j in range(2)] for i in range(6)]
    np.testing.assert_allclose(ours, expected, atol=1e-6)


@pytest.mark.parametrize("q", [0.0, 0.1, 0.5, 0.77, 1.0])
def test_quantile_is_numpys(q: float) -> None:  # oracle: numpy.quantile
    values, mask = batch(1)
    ours = np.asarray(masked.quantile(jnp.asarray(values), jnp.asarray(mask), q))
    expected = [[np.quantile(values[i, j][mask[i, j]], q) for j in range(2)] for i in range(6)]
    np.testing.assert_allclose(ours, expected, atol=2e-6)
    if q == 0.5:
        np.testing.assert_array_equal(masked.median(jnp.asarray(values), jnp.asarray(mask)), ours)


def test_no_entry_at_all() -> None:
    values, mask = jnp.full((2, 5), jnp.nan), jnp.zeros((2, 5), bool)
    np.testing.assert_array_equal(masked.mean(values, mask), 0.0)
    assert np.isnan(masked.median(values, mask)).all()


def test_one_empty_row_does_not_touch_the_other() -> None:
    values = jnp.asarray([[1.0, 2.0, 4.0], [9.0, 9.0, 9.0]])
    mask = jnp.asarray([[True, True, True], [False, False, False]])
    ours = np.asarray(jax.jit(jax.vmap(masked.median))(values, mask))
    assert ours[0] == 2.0
    assert np.isnan(ours[1])
