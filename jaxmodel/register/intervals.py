"""Intervals over many registrations whose results are not independent: pairs of scans are resampled, not starts.

Starts and noise draws of one pair share its geometry, so counting each start as an observation would make intervals far
too narrow. The bootstrap draws whole pairs (cluster bootstrap; Efron and Tibshirani 1993, percentile interval).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.stats import norm

CONFIDENCE = 0.95
RESAMPLES = 2000
FEWEST_UNITS = 5
"""Resampling fewer pairs than this says nothing about others, so no interval is given."""


class Estimate(NamedTuple):
    """A figure with its interval; ``units`` pairs and ``count`` registrations stand behind it.

    NaN where there was nothing to average, and bounds NaN where there were fewer than ``FEWEST_UNITS`` units.
    """

    value: float
    low: float
    high: float
    units: int
    count: int


def mean_over_units(
    values: Float[np.ndarray, " n"],
    units: Shaped[np.ndarray, " n"] | Sequence[str],
    resamples: int = RESAMPLES,
    seed: int = 0,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Mean of all values, each registration counting the same, and its interval when whole units are drawn.

    Args:
        values: one a registration; those not finite are left out.
        units: the unit (pair of scans) each belongs to.
        resamples: bootstrap draws.
        seed: of the draws; the same for two calls on the same units, so that they are resampled alike.
        confidence: coverage of the interval.
    """
    kept = np.isfinite(values)
    sums, counts = _by_unit(values, kept, units)
    drawn = _resampled(sums, counts, resamples, seed)
    return _estimate(sums.sum() / counts.sum() if counts.sum() else np.nan, drawn, counts, confidence)


def rate_over_units(
    right: Bool[np.ndarray, " n"],
    units: Shaped[np.ndarray, " n"] | Sequence[str],
    resamples: int = RESAMPLES,
    seed: int = 0,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """As ``mean_over_units`` for a share.

    Where every unit has the share 0, or every one 1, the bootstrap has no width; Wilson's interval with the number of
    units as the number of trials then stands in for it.
    """
    found = mean_over_units(np.asarray(right, dtype=float), units, resamples, seed, confidence)
    if found.units >= FEWEST_UNITS and found.value in (0.0, 1.0):
        z = float(norm.ppf(0.5 + confidence / 2))
        reach = z * z / (found.units + z * z)
        low, high = (0.0, reach) if found.value == 0.0 else (1.0 - reach, 1.0)
        return found._replace(low=low, high=high)
    return found


def difference_over_units(
    first: Float[np.ndarray, " n"],
    second: Float[np.ndarray, " n"],
    units: Shaped[np.ndarray, " n"] | Sequence[str],
    resamples: int = RESAMPLES,
    seed: int = 0,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Mean of ``first - second`` over the same registrations, paired: what differs between pairs cancels.

    Entries where either is not finite are left out.
    """
    with np.errstate(invalid="ignore"):
        return mean_over_units(np.subtract(first, second), units, resamples, seed, confidence)


def _by_unit(
    values: Float[np.ndarray, " n"], kept: Bool[np.ndarray, " n"], units: Shaped[np.ndarray, " n"] | Sequence[str]
) -> tuple[Float[np.ndarray, " u"], Int[np.ndarray, " u"]]:
    """Sum and number of the kept values of each unit, units in sorted order."""
    names, place = np.unique(np.asarray(units), return_inverse=True)
    sums = np.bincount(place[kept], weights=values[kept], minlength=len(names)).astype(float)
    return sums, np.bincount(place[kept], minlength=len(names))


def _resampled(
    sums: Float[np.ndarray, " u"], counts: Int[np.ndarray, " u"], resamples: int, seed: int
) -> Float[np.ndarray, " r"]:
    if np.count_nonzero(counts) < FEWEST_UNITS:
        return np.zeros(0)
    draw = np.random.default_rng([seed, len(sums)])
    times = draw.multinomial(len(sums), np.full(len(sums), 1.0 / len(sums)), size=resamples)
    totals = times @ counts
    return (times @ sums)[totals > 0] / totals[totals > 0]


def _estimate(
    value: float, drawn: Float[np.ndarray, " r"], counts: Int[np.ndarray, " u"], confidence: float
) -> Estimate:
    units = int(np.count_nonzero(counts))
    low, high = np.nan, np.nan
    if len(drawn):
        low, high = np.quantile(drawn, [0.5 - confidence / 2, 0.5 + confidence / 2]).tolist()
    return Estimate(float(value), float(low), float(high), units, int(counts.sum()))
