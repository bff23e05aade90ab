"""Laws of the many-segment least squares: each segment equals NumPy's own fit (oracle), wherever it lies."""

import numpy as np
import pytest

from jaxmodel.control_points.parabolas import Readings, best_cuts, fit


def readings(seed: int, offset: float = 0.0) -> tuple[Readings, np.ndarray]:
    """Uneven readings of about forty segments of 1 to 60 rows."""
    rng = np.random.default_rng(seed)
    count = rng.integers(1, 60, size=40)
    starts = np.cumsum(count) - count
    x = np.cumsum(rng.uniform(0.5, 1.5, size=count.sum())) + offset
    y = rng.normal(size=len(x)) + 0.02 * (x - offset) ** 1.5 + 1e-3 * offset
    return Readings(x, y, rng.uniform(0.3, 3.0, size=len(x))), starts


def oracle(data: Readings, rows: slice) -> tuple[np.polynomial.Polynomial, float]:
    """NumPy's weighted parabola, straight or constant for fewer than three rows, and its chi-square."""
    x, y, weight = (part[rows] for part in data)
    polynomial = np.polynomial.Polynomial.fit(x, y, min(2, len(x) - 1), w=np.sqrt(weight))
    return polynomial, float(np.sum(weight * (y - polynomial(x)) ** 2))


@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_values_slopes_and_misfits_are_those_of_numpy(offset: float) -> None:
    data, starts = readings(0, offset)
    parabolas = fit(data, starts)
    ends = np.append(starts[1:], len(data.x))
    at = data.x[starts] + 0.3
    value = np.sum(parabolas.coefficients * parabolas.polynomials(at), axis=0)
    slope = np.sum(parabolas.coefficients * parabolas.derivatives(at), axis=0)
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        polynomial, misfit = oracle(data, slice(start, end))
        assert parabolas.misfit[i] == pytest.approx(misfit, abs=1e-8)
        if end - start > 4:
            assert value[i] == pytest.approx(polynomial(at[i]), abs=1e-7)
            assert slope[i] == pytest.approx(polynomial.deriv()(at[i]), abs=1e-7)


def test_the_norms_are_inverse_variances_of_the_coefficients() -> None:
    data, starts = readings(1)
    rng = np.random.default_rng(2)
    draws = []
    for _ in range(2000):
        y = rng.normal(size=len(data.x)) / np.sqrt(data.weight)
        draws.append(fit(Readings(data.x, y, data.weight), starts).coefficients)
    parabolas = fit(data, starts)
    long = parabolas.count >= 3
    ratio = np.var(np.stack(draws), axis=0)[:, long] * parabolas.norms[:, long]
    assert np.abs(ratio - 1).max() < 0.2


def test_the_best_cut_is_the_best_of_all_cuts() -> None:
    data, starts = readings(3)
    cuts = best_cuts(data, starts, least=3)
    for i, (start, end) in enumerate(zip(starts, np.append(starts[1:], len(data.x)), strict=True)):
        if end - start < 6:
            assert cuts.row[i] == start
            assert cuts.parts[i] == cuts.whole[i]
            continue
        tried = [
            oracle(data, slice(start, row))[1] + oracle(data, slice(row, end))[1] for row in range(start + 3, end - 2)
        ]
        assert cuts.parts[i] == pytest.approx(min(tried), abs=1e-6)
        assert tried[cuts.row[i] - start - 3] == pytest.approx(min(tried), abs=1e-6)


def test_a_cut_is_found_at_the_end_of_a_long_segment() -> None:
    x = np.arange(3000.0)
    y = np.where(x < 2996, 0.5 * x, 0.5 * x + 7.0)
    cuts = best_cuts(Readings(x, y, np.ones(3000)), np.array([0]), least=3)
    assert cuts.row[0] == 2996
    assert cuts.parts[0] < 1e-6 * cuts.whole[0]
