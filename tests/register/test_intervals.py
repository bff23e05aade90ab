"""Intervals over units: exact means, coverage, pairing, and the cases where there is nothing to resample."""

import numpy as np
import pytest

from jaxmodel.register.intervals import difference_over_units, mean_over_units, rate_over_units

UNITS = np.repeat([f"pair {i}" for i in range(12)], 10)


def nested(seed: int, between: float = 1.0, within: float = 0.1, units: int = 12, each: int = 10) -> np.ndarray:
    """Values that agree within a unit and differ between units."""
    draw = np.random.default_rng(seed)
    return (draw.normal(0, between, units)[:, None] + draw.normal(0, within, (units, each))).ravel()


def test_the_value_is_the_plain_mean_of_what_is_finite() -> None:
    values = nested(0)
    values[[3, 50]] = np.nan, np.inf
    found = mean_over_units(values, UNITS)
    assert found.value == pytest.approx(values[np.isfinite(values)].mean(), rel=1e-12)
    assert (found.units, found.count) == (12, 118) and found.low < found.value < found.high


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    """Units of one value each would be treated right by any bootstrap; here starts of a unit are nearly copies."""
    covered = [found.low <= 0 <= found.high for found in (mean_over_units(nested(i), UNITS, 400) for i in range(400))]
    assert 0.87 <= np.mean(covered) <= 0.97  # the percentile bootstrap of 12 units is known to fall a little short
    starts = np.arange(120)
    naive = [found.low <= 0 <= found.high for found in (mean_over_units(nested(i), starts, 400) for i in range(400))]
    assert np.mean(naive) < 0.6


def test_order_and_labels_of_the_units_do_not_matter() -> None:
    values, order = nested(1), np.random.default_rng(0).permutation(120)
    assert mean_over_units(values[order], UNITS[order]) == pytest.approx(mean_over_units(values, UNITS))
    assert mean_over_units(values, [f"x{u}" for u in UNITS]) == mean_over_units(values, UNITS)


def test_units_share_their_draws_so_a_difference_is_paired() -> None:
    values = nested(2)
    found = difference_over_units(values + 0.3, values, UNITS)
    assert found.value == pytest.approx(0.3) and found.low == pytest.approx(0.3) and found.high == pytest.approx(0.3)


def test_a_difference_leaves_out_where_either_is_missing() -> None:
    first, second = nested(3), nested(4)
    first[0], second[1] = np.nan, np.inf
    found = difference_over_units(first, second, UNITS)
    assert found.count == 118 and found.value == pytest.approx(np.mean(first[2:] - second[2:]))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_unanimous_units_get_wilsons_interval_over_units(share: float) -> None:
    """Oracle: statsmodels' formula for 0 of 12, written out: z²/(n + z²)."""
    found = rate_over_units(np.full(120, share == 1.0), UNITS)
    reach = 1.959963984540054**2 / (12 + 1.959963984540054**2)
    assert (found.low, found.high) == pytest.approx((1 - reach, 1.0) if share else (0.0, reach))


def test_a_mixed_rate_is_the_bootstrap_of_its_units() -> None:
    right = np.random.default_rng(5).random(120) < np.repeat(np.linspace(0.1, 0.9, 12), 10)
    assert rate_over_units(right, UNITS) == mean_over_units(right.astype(float), UNITS)


def test_one_unit_has_no_interval_and_none_has_no_value() -> None:
    one = mean_over_units(np.ones(5), ["a"] * 5)
    assert one.value == 1.0 and np.isnan(one.low) and np.isnan(one.high) and one.units == 1
    empty = mean_over_units(np.full(4, np.nan), ["a", "a", "b", "b"])
    assert np.isnan(empty.value) and np.isnan(empty.low) and empty.units == empty.count == 0
    assert np.isnan(mean_over_units(np.zeros(0), []).value)


def test_a_unit_without_values_does_not_count() -> None:
    values = np.array([1.0, 2.0, np.nan, 3.0])
    found = mean_over_units(values, ["a", "a", "b", "c"])
    assert found.units == 2 and found.value == 2.0


def test_few_units_get_no_interval() -> None:
    values, units = nested(6, units=5), np.repeat(list("abcde"), 10)
    assert np.isfinite(mean_over_units(values, units).low)
    few = mean_over_units(values[:40], units[:40])
    assert np.isfinite(few.value) and np.isnan(few.low) and np.isnan(few.high) and few.units == 4
    assert np.isnan(rate_over_units(np.ones(40, bool), units[:40]).low)
    values[40:] = np.nan
    assert np.isnan(mean_over_units(values, units).low)  # a unit without values is none
