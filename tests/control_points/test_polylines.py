"""Laws of the resolution control: the error is kept, a larger one keeps less, units do not matter."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.control_points.contour_set import Contour, ContourOutcome, ContourSet
from jaxmodel.control_points.polylines import ALONG, approximate, importance
from jaxmodel.errors import InputError


def contour(points: np.ndarray, closed: bool = False) -> Contour:
    n = len(points)
    return Contour(np.stack([np.arange(n), np.arange(n)], axis=1), points.astype(float), np.ones(n, dtype=int), closed)


def one(points: np.ndarray, closed: bool = False) -> ContourSet:
    return ContourSet((contour(points, closed),), ContourOutcome.FOUND)


def wander(seed: int, n: int) -> np.ndarray:
    """A walk in space: smooth, or a scribble to and fro; some points are twice in place."""
    rng = np.random.default_rng(seed)
    if seed % 2:
        return np.repeat(rng.normal(size=(n, 3)) * [3.0, 1.0, 0.1], 1 + (rng.random(n) < 0.1), axis=0)[:n]
    step = np.cumsum(rng.normal(size=(n, 3)), axis=0) * rng.uniform(0, 0.3) + rng.normal(size=3)
    step *= rng.random((n, 1)) > 0.1
    return np.cumsum(step, axis=0)


def distance_to_polyline(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Reference: of each point, the distance from the nearest of the segments between consecutive corners."""
    a, b = corners[:-1], corners[1:]
    chord = b - a
    squared = np.maximum(np.sum(chord**2, axis=1), 1e-300)
    share = np.clip(np.sum((points[:, None] - a) * chord, axis=2) / squared, 0, 1)
    return np.linalg.norm(points[:, None] - a - share[..., None] * chord, axis=2).min(axis=1)


@given(seed=st.integers(0, 10_000), n=st.integers(3, 60), closed=st.booleans(), rank=st.floats(0.0, 1.0))
def test_points_left_out_are_within_the_error_and_the_rest_are_measured(
    seed: int, n: int, closed: bool, rank: float
) -> None:
    points = wander(seed, n)
    whole = one(points, closed)
    error = float(np.quantile(importance(whole)[0], rank, method="lower"))
    (chain,) = approximate(whole, error).chains
    rows = chain.pixels[:, 0]
    assert (np.diff(rows) > 0).all()
    np.testing.assert_array_equal(chain.points, points[rows])
    corners = np.concatenate([chain.points, chain.points[:1]]) if closed else chain.points
    for i, j in zip(rows, [*rows[1:], rows[0] + n] if closed else rows[1:], strict=False):
        between = points[np.arange(i, j + 1) % n]
        assert distance_to_polyline(between, between[[0, -1]]).max() <= error * (1 + 1e-9)
    assert distance_to_polyline(points, corners).max() <= error * (1 + 1e-9)
    assert chain.closed == closed
    if not closed:
        assert rows[0] == 0 and rows[-1] == n - 1


@given(seed=st.integers(0, 10_000), n=st.integers(3, 120), closed=st.booleans())
def test_a_smaller_error_keeps_all_that_a_larger_one_keeps(seed: int, n: int, closed: bool) -> None:
    whole = one(wander(seed, n), closed)
    kept = [set(approximate(whole, error).chains[0].pixels[:, 0]) for error in (0.0, 0.1, 0.5, 2.0, 10.0, 1e9)]
    assert all(more >= fewer for more, fewer in pairwise(kept))
    assert len(kept[-1]) == 2


@given(seed=st.integers(0, 10_000), n=st.integers(3, 120), closed=st.booleans())
def test_importance_is_a_length(seed: int, n: int, closed: bool) -> None:
    points = wander(seed, n)
    plain, large = importance(one(points, closed))[0], importance(one(1024.0 * points, closed))[0]
    np.testing.assert_array_equal(large, 1024.0 * plain)
    metres = importance(one(points / 1000.0, closed))[0]
    np.testing.assert_allclose(1000.0 * metres, plain, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("factor", [1e-3, 0.7, 3.3, 1 / 3])
def test_ties_are_broken_alike_in_every_unit(factor: float) -> None:
    # Straight lines with a point on each side of their middle, which tie but for rounding.
    for n in range(30, 130, 2):
        points = np.arange(n)[:, None] * np.array([0.37, 0.11, 0.05])
        error = 1.1 * ALONG * float(np.linalg.norm(points[-1])) / 4
        rows = [approximate(one(k * points), k * error).chains[0].pixels[:, 0].tolist() for k in (1.0, factor)]
        assert rows[0] == rows[1] == [0, n // 2 - 1, n - 1]


@given(seed=st.integers(0, 10_000))
def test_chains_do_not_change_one_another(seed: int) -> None:
    chains = [contour(wander(seed + i, 3 + 7 * i), closed=i % 2 == 1) for i in range(5)]
    together = importance(ContourSet(tuple(chains), ContourOutcome.FOUND))
    for chain, values in zip(chains, together, strict=True):
        alone = importance(ContourSet((chain,), ContourOutcome.FOUND))[0]
        np.testing.assert_allclose(values, alone, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("error", [0.3, 1.0, 2.5, 10.0])
def test_a_straight_edge_keeps_points_at_least_every_eight_errors(error: float) -> None:
    line = np.stack([np.arange(400.0), 0 * np.arange(400.0), 0 * np.arange(400.0)], axis=1)
    rows = approximate(one(line), error).chains[0].pixels[:, 0]
    longest = np.diff(rows).max()
    assert longest <= 2 * error / ALONG + 1
    assert len(rows) <= 3 + 2 * 400 / (2 * error / ALONG)


def test_a_corner_comes_before_the_straight_parts_beside_it() -> None:
    x = np.arange(41.0)
    corner = np.stack([x, np.abs(x - 13.0), 0 * x], axis=1)
    values = importance(one(corner))[0]
    assert set(np.argsort(-values, kind="stable")[:3]) == {0, 13, 40}
    assert values[0] == values[40] == max(ALONG * 40 * np.sqrt(2.0), values[13])


def test_a_closed_circle_stays_round() -> None:
    angle = 2 * np.pi * np.arange(200) / 200
    circle = 10.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    (chain,) = approximate(one(circle, closed=True), 0.5).chains
    sagitta = 10.0 * (1 - np.cos(np.pi * np.diff(np.append(chain.pixels[:, 0], 200)) / 200))
    assert chain.closed and len(chain) < 40 and sagitta.max() <= 0.5


def test_points_that_coincide_and_chains_of_two_matter_no_more_than_they_should() -> None:
    assert importance(one(np.ones((6, 3))))[0].tolist() == [0.0] * 6
    assert approximate(one(np.ones((6, 3))), 0.1).chains[0].pixels[:, 0].tolist() == [0, 5]
    assert importance(one(np.array([[0.0, 0, 0], [3.0, 0, 4.0]])))[0].tolist() == [5 * ALONG, 5 * ALONG]


def test_no_contour_stays_none() -> None:
    none = ContourSet((), ContourOutcome.NO_EDGE)
    assert approximate(none, 1.0) is none and importance(none) == []


@pytest.mark.parametrize("error", [-1.0, np.nan])
def test_an_error_that_is_no_length_is_refused(error: float) -> None:
    with pytest.raises(InputError, match="expected a length of 0 or more"):
        approximate(one(wander(0, 5)), error)
