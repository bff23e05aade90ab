"""Laws of jumps along lines: steps, steep surfaces, mixed points, spikes."""

import numpy as np
import pytest

from jaxmodel.control_points.jumps import find_steps, mixed_points, spikes
from jaxmodel.control_points.scan_lines import readings


def found(distance: np.ndarray, sigma: float = 0.0, jump: float = 4.0) -> tuple[list[int], list[int], list[int]]:
    """Places before jumps, of mixed points and of spikes on one line of pitch 1; NaN is a missing reading."""
    flat = readings(np.isfinite(distance)[None])
    here = distance[flat.pixel]
    pitch, noise = np.ones(len(here)), np.full(len(here), sigma)
    steps = find_steps(here, flat, pitch, noise, jump)
    mixed = mixed_points(here, steps, pitch, noise)
    return tuple(flat.pixel[flags].tolist() for flags in (steps.jump, mixed, spikes(steps)))  # type: ignore[return-value]


def test_a_step_beyond_the_limit_is_a_jump_and_one_below_it_is_none() -> None:
    line = np.repeat([100.0, 104.5, 108.0], 10)
    assert found(line) == ([9], [], [])
    assert found(line[::-1]) == ([19], [], [])
    assert found(np.zeros(5)) == ([], [], [])


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("backwards", [False, True])
def test_the_mixed_point_of_a_jump_is_found(share: float, backwards: bool) -> None:
    line = np.concatenate([np.full(10, 100.0), [100 + 30 * share], np.full(10, 130.0)])
    assert found(line[::-1] if backwards else line)[1] == [10]


def test_two_mixed_points_go_one_after_the_other() -> None:
    line = np.concatenate([np.full(10, 100.0), [108.0, 121.0], np.full(10, 130.0)])
    first = found(line)[1]
    assert first == [10, 11]


@pytest.mark.parametrize("slope", [-3.9, 0.0, 2.0, 3.9])
def test_sides_of_any_slope_lose_nothing(slope: float) -> None:
    line = np.concatenate([100.0 + slope * np.arange(10), 300.0 - slope * np.arange(10)])
    jumps, mixed, _ = found(line)
    assert jumps == [9]
    assert mixed == []


def test_a_steep_surface_is_no_row_of_jumps() -> None:
    steep = np.concatenate([np.full(8, 100.0), 100.0 + 6.0 * np.arange(1, 9), np.full(8, 148.0)])
    assert found(steep) == ([], [], [])
    beside_a_jump = np.concatenate([steep, np.full(8, 400.0)])
    assert found(beside_a_jump) == ([23], [], [])


def test_a_curved_rim_keeps_its_last_readings() -> None:
    ball = -np.sqrt(60.0**2 - np.arange(59.6, 0, -1.0) ** 2)[::-1]  # runs away ever faster
    line = np.concatenate([ball, np.full(10, 200.0)])
    jumps, mixed, _ = found(line)
    assert len(ball) - 1 in jumps
    assert mixed == []


def test_a_reading_off_both_sides_is_a_spike() -> None:
    line = np.full(15, 100.0)
    line[7] = 60.0
    assert found(line) == ([6, 7], [], [7])


def test_jumps_are_seen_across_missing_readings_but_not_across_many() -> None:
    line = np.concatenate([np.full(8, 100.0), [np.nan, np.nan], np.full(8, 130.0)])
    assert found(line)[0] == [7]
    assert found(np.insert(line, 8, [np.nan]))[0] == []


def test_noise_makes_no_jump() -> None:
    rng = np.random.default_rng(0)
    assert found(100.0 + 3.0 * rng.normal(size=20_000), sigma=3.0)[0] == []


def test_no_reading_at_all() -> None:
    assert readings(np.zeros((3, 4), dtype=bool)).pixel.shape == (0,)


@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("readings_on_it", [2, 3])
def test_a_steep_face_at_an_outline_keeps_its_readings(readings_on_it: int, backwards: bool) -> None:
    """Steps of 6 pitches, each beyond a jump, which begin with half a step: the crease lies between two readings."""
    face = 3.0 + 6.0 * np.arange(readings_on_it)
    line = np.concatenate([np.full(10, 100.0), 100.0 + face, np.full(10, 250.0)])
    jumps, mixed, _ = found(line[::-1] if backwards else line)
    assert mixed == []
    assert jumps == [9 if backwards else 9 + readings_on_it]


def test_a_mixed_point_beside_a_steep_face_is_found_alone() -> None:
    line = np.concatenate([np.full(10, 100.0), [103.0, 109.0, 115.0, 170.0], np.full(10, 250.0)])
    assert found(line)[1] == [13]


def test_an_uneven_row_of_large_steps_is_no_steep_surface() -> None:
    line = np.concatenate([np.full(10, 100.0), [121.0, 194.0, 235.0], np.full(10, 265.0)])
    assert found(line)[1] == [10, 11, 12]
