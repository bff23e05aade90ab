"""Zhang's four cases against numbers worked out by hand, and the valley of the histogram."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.register.rejection import BINS, histogram_valley, sum_over_points, zhang_limit

limit_of = jax.jit(zhang_limit)
valley_of = jax.jit(histogram_valley)
SIZE = 64


def padded(distances: list[float] | np.ndarray, junk: float = 1e9) -> tuple[jax.Array, jax.Array]:
    """Distances in ``SIZE`` entries; the rest is not kept and holds ``junk``."""
    values = np.full(SIZE, junk, np.float32)
    values[: len(distances)] = distances
    return jnp.asarray(values), jnp.asarray(np.arange(SIZE) < len(distances))


def limit(distances: list[float], scale: float = 1.0, previous: float = 1e6, junk: float = 1e9) -> float:
    values, kept = padded(distances, junk)
    return float(limit_of(values, kept, jnp.float32(scale), jnp.float32(previous)))


@pytest.mark.parametrize(
    ("distances", "expected"),
    [
        ([0.5, 0.75], 0.625 + 3 * 0.125),  # mean 0.625 < D: mean + 3 sigma
        ([1.5, 2.5], 2.0 + 2 * 0.5),  # D <= mean 2 < 3 D: mean + 2 sigma
        ([4.0, 5.0], 4.5 + 0.5),  # 3 D <= mean 4.5 < 6 D: mean + sigma
        ([0.0, 2.0], 1.0 + 2 * 1.0),  # mean = D belongs to the second case
        ([2.0, 4.0], 3.0 + 1.0),  # mean = 3 D to the third
        ([1.0, 1.0, 1.0, 1.0], 1.0),  # no spread
        ([0.25], 0.25),  # one pair
    ],
)
def test_limits_from_mean_and_deviation(distances: list[float], expected: float) -> None:
    assert limit(distances) == pytest.approx(expected, rel=1e-6)
    # D and the distances in another unit: the limit in that unit
    assert limit([1000 * d for d in distances], 1000.0, 1e9) == pytest.approx(1000 * expected, rel=1e-6)


# 32 bins of width 1 up to 32: main peak 5 in bin 8, then 3, then 1 (the valley, bin 10), then 2 in bin 11
BIMODAL = [8.5] * 5 + [9.5] * 3 + [10.5] + [11.5] * 2 + [2.5] * 4 + [32.0]


def test_the_fourth_case_cuts_at_the_valley() -> None:
    assert np.mean(BIMODAL) >= 6.0
    assert limit(BIMODAL) == pytest.approx(11.0, rel=1e-6)
    assert limit(BIMODAL, scale=float(np.mean(BIMODAL)) / 5.9) > 11.5  # mean < 6 D: mean + sigma instead


def test_mean_of_exactly_six_scales_is_the_fourth_case() -> None:
    distances = [6.0, 6.0, 4.0, 8.0]
    # 32 bins of width 1/4: the peak (2 pairs) is bin 24, the next bin is empty and so is the one after: the valley
    assert limit(distances) == pytest.approx(6.5, rel=1e-6)
    assert limit(distances, scale=1.001) == pytest.approx(6 + np.std(distances), rel=1e-6)


def test_only_pairs_below_the_previous_limit_count() -> None:
    assert limit([0.5, 0.75, 4.0, 9.0], previous=4.0) == pytest.approx(limit([0.5, 0.75]), rel=1e-6)
    assert limit([0.5, 0.75, 3.99], previous=4.0) > 2.0


@pytest.mark.parametrize("junk", [np.nan, np.inf, -np.inf, 0.0])
def test_pairs_not_kept_may_hold_anything(junk: float) -> None:
    assert limit([0.5, 0.75], junk=junk) == limit([0.5, 0.75])
    assert limit(BIMODAL, junk=junk) == limit(BIMODAL)


@pytest.mark.parametrize(("distances", "previous"), [([], 7.0), ([8.0, 9.0], 7.0), ([], np.inf)])
def test_without_a_pair_the_limit_stays(distances: list[float], previous: float) -> None:
    assert limit(distances, previous=previous) == previous


def valley_reference(distances: np.ndarray) -> float:
    """The definition in words, bin by bin, in float32 as the kernel bins."""
    width = np.float32(distances.max()) / np.float32(BINS)
    counts = np.bincount(np.minimum((distances / width).astype(int), BINS - 1), minlength=BINS)
    for j in range(int(np.argmax(counts)) + 1, BINS):
        lower_than_before = counts[j] < counts[j - 1]
        if lower_than_before and (j == BINS - 1 or counts[j] <= counts[j + 1]):
            return float((j + 1) * width)
    return np.inf


def test_the_valley_is_the_first_after_the_peak() -> None:
    found_inner = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        distances = np.concatenate([rng.normal(3, 0.5, 30), rng.uniform(0, 9, 20)]).astype(np.float32)
        distances = np.abs(distances)[: rng.integers(5, 50)]
        ours, expected = float(valley_of(*padded(distances))), valley_reference(distances)
        if np.isinf(expected):
            assert ours > distances.max()
        else:
            found_inner += expected < distances.max()
            assert ours == pytest.approx(expected, rel=1e-6)
    assert found_inner > 30


@pytest.mark.parametrize("distances", [[3.0], [3.0, 3.0, 3.0], [0.0, 0.0]])
def test_without_a_valley_everything_stays(distances: list[float]) -> None:
    ours = float(valley_of(*padded(distances)))
    assert ours > max(distances)
    assert np.isfinite(ours)


def test_sums_in_one_pass() -> None:
    terms = [np.random.default_rng(seed).normal(size=1000).astype(np.float32) for seed in range(17)]
    sums = sum_over_points([jnp.asarray(term) for term in terms])
    np.testing.assert_allclose(sums, [term.sum(dtype=np.float64) for term in terms], atol=1e-3)
    assert len(sums) == 17


@pytest.mark.parametrize("size", [1e-30, 1e-3, 1.0, 1e6, 1e30])
@pytest.mark.parametrize("n", [1, 7, 2048])
def test_repeatable_sums_have_the_same_bits_in_any_order(size: float, n: int) -> None:
    rng = np.random.default_rng(n)
    terms = [(size * rng.normal(size=n) ** 3).astype(np.float32), np.zeros(n, np.float32)]
    in_order = jax.jit(lambda t: sum_over_points(t, repeatable=True))
    expected = np.asarray(in_order([jnp.asarray(term) for term in terms]))
    largest = np.abs(terms[0]).max()
    rounding = 4e-6 * np.sqrt(n) * largest  # of n terms, 3.5 sigma
    assert abs(expected[0] - terms[0].sum(dtype=np.float64)) < rounding
    assert expected[1] == 0.0
    for seed in range(20):
        order = np.random.default_rng(seed).permutation(n)
        shuffled = in_order([jnp.asarray(term[order]) for term in terms])
        np.testing.assert_array_equal(np.asarray(shuffled), expected)


@pytest.mark.parametrize("n", [1, 7, 2048])
@pytest.mark.parametrize("slack", [1.0, 3.0, 1e3])
def test_bounds_known_beforehand_give_repeatable_sums_too(n: int, slack: float) -> None:
    rng = np.random.default_rng(n)
    term = rng.uniform(-1, 1, n).astype(np.float32)
    bound = jnp.float32(slack * np.abs(term).max())
    summed = jax.jit(lambda t: sum_over_points([t], repeatable=True, bounds=[bound])[0])
    expected = float(summed(jnp.asarray(term)))
    assert abs(expected - term.sum(dtype=np.float64)) < 4e-6 * np.sqrt(n) * float(bound)
    for seed in range(20):
        assert float(summed(jnp.asarray(np.random.default_rng(seed).permutation(term)))) == expected


def test_repeatable_sums_do_not_overflow() -> None:
    ones = jnp.full(2048, 1.9999999, jnp.float32)
    (total,) = sum_over_points([ones], repeatable=True)
    assert float(total) == pytest.approx(4096.0, rel=1e-6)
