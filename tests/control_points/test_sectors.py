"""Laws of the sectors of wide lines: none wider than two radian or so, none cut at a corner."""

import numpy as np
import pytest

from jaxmodel.control_points.sectors import sector_starts


def walls(turn: np.ndarray, corner: float) -> np.ndarray:
    """Points of a line that looks along the insides of a square room turned so that one corner is at ``corner``."""
    from_corner = np.mod(turn - corner, np.pi / 2) - np.pi / 4
    distance = 1.0 / np.cos(from_corner)
    return distance[:, None] * np.stack([np.sin(turn), np.zeros_like(turn), np.cos(turn)], axis=1)


def cuts(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    starts = sector_starts(points, points / np.linalg.norm(points, axis=1, keepdims=True), line)
    return np.flatnonzero(starts)


@pytest.mark.parametrize("sigma", [0.0, 0.002])
def test_no_cut_lies_within_reach_of_a_corner(sigma: float) -> None:
    turn = np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    line = np.zeros(1500, dtype=np.int64)
    rng = np.random.default_rng(0)
    for corner in np.linspace(0, np.pi / 2, 40):
        points = walls(turn, corner) * (1 + sigma * rng.normal(size=1500))[:, None]
        found = cuts(points, line)
        assert 4 <= len(found) <= 5
        away = np.mod(turn[found[1:]] - corner + np.pi / 4, np.pi / 2) - np.pi / 4
        assert np.abs(away).min() > 10 * (turn[1] - turn[0])


@pytest.mark.parametrize("count", [40, 400, 4000])
def test_every_ray_of_a_sector_is_within_60_degrees_of_its_middle(count: int) -> None:
    turn = np.tile(np.linspace(0, 2 * np.pi, count, endpoint=False), 2)
    points = walls(turn, 0.3)
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    for part in np.split(rays, cuts(points, np.repeat([0, 1], count))[1:]):
        middle = part[0] + part[-1]
        assert (part @ middle / np.linalg.norm(middle)).min() > 0.5


def test_a_line_that_fits_one_sector_is_left_whole_and_others_change_nothing() -> None:
    narrow, wide = walls(np.linspace(0, 1.5, 200), 0.5), walls(np.linspace(0, 3.0, 300), 0.5)
    assert cuts(narrow, np.zeros(200, dtype=np.int64)).tolist() == [0]
    together = cuts(np.concatenate([narrow, wide]), np.repeat([0, 2], [200, 300]))
    alone = cuts(wide, np.zeros(300, dtype=np.int64))
    assert together.tolist() == [0, *(200 + alone)]


def test_neighbours_that_see_opposite_ways_are_parted() -> None:
    points = np.array([[1.0, 0, 0], [2.0, 0, 0], [-1.0, 0, 0], [-2.0, 0, 0]])
    assert cuts(points, np.zeros(4, dtype=np.int64)).tolist() == [0, 2]
