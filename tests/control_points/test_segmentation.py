"""Laws of the segmentation of lines: known joints are found, and nothing else, whatever stands beside them."""

import numpy as np
import pytest

from jaxmodel.control_points.parabolas import Readings
from jaxmodel.control_points.segmentation import segment_pieces, split_at_chords

GAIN = 25.0


def polyline(joints: tuple[int, ...], length: int, bend: float = 0.0) -> np.ndarray:
    """Heights of a line of alternating slopes 1 and -1, each part a parabola where ``bend`` is not 0."""
    y, height, slope = np.zeros(length), 0.0, 1.0
    for start, end in zip((0, *joints), (*joints, length), strict=True):
        t = np.arange(end - start)
        y[start:end] = height + slope * t + bend * t * t
        height, slope = height + slope * (end - start) + bend * (end - start) ** 2, -slope
    return y


def weighted(y: np.ndarray, sigma: float) -> Readings:
    return Readings(np.arange(len(y), dtype=float), y, np.full(len(y), 1.0 / sigma**2))


@pytest.mark.parametrize("bend", [0.0, 0.01])
def test_joints_without_noise_are_found_exactly(bend: float) -> None:
    joints = (17, 40, 49, 90)
    starts = segment_pieces(weighted(polyline(joints, 120, bend), 0.05), np.array([0]), GAIN)
    # the reading at the joint itself lies on both sides
    assert len(starts) == 1 + len(joints)
    assert np.abs(starts[1:] - np.array(joints)).max() <= 1


def test_chords_alone_find_the_joints_of_straight_parts() -> None:
    starts = split_at_chords(weighted(polyline((30, 70), 100), 0.05), np.array([0]), doubt=4.0)
    assert {30, 70} <= set(starts.tolist())


def test_one_parabola_stays_whole_under_noise() -> None:
    rng = np.random.default_rng(0)
    lines = [0.003 * (np.arange(200) - 80.0) ** 2 + 0.7 * rng.normal(size=200) for _ in range(50)]
    pieces = 200 * np.arange(50)
    starts = segment_pieces(weighted(np.concatenate(lines), 0.7), pieces, GAIN)
    np.testing.assert_array_equal(starts, pieces)


def test_noisy_joints_are_found_within_two_readings() -> None:
    rng = np.random.default_rng(1)
    joints = (40, 80, 130)
    lines = np.concatenate([polyline(joints, 180) + 0.5 * rng.normal(size=180) for _ in range(100)])
    pieces = 180 * np.arange(100)
    found = np.setdiff1d(segment_pieces(weighted(lines, 0.5), pieces, GAIN), pieces)
    true = (pieces[:, None] + np.array(joints)).ravel()
    distance = np.abs(found[:, None] - true)
    assert np.mean(distance.min(axis=0) <= 2) > 0.97
    assert np.mean(distance.min(axis=1) <= 2) > 0.97


def test_a_line_is_segmented_the_same_alone_and_among_others() -> None:
    rng = np.random.default_rng(2)
    lines = [polyline((20 + i, 60), 100) + 0.3 * rng.normal(size=100) for i in range(12)]
    pieces = 100 * np.arange(12)
    together = segment_pieces(weighted(np.concatenate(lines), 0.3), pieces, GAIN)
    alone = [segment_pieces(weighted(y, 0.3), np.array([0]), GAIN) + 100 * i for i, y in enumerate(lines)]
    np.testing.assert_array_equal(together, np.concatenate(alone))


@pytest.mark.parametrize("length", [1, 2, 3, 5, 6])
def test_short_pieces_are_left_whole_or_cut_in_parts_of_three(length: int) -> None:
    y = np.where(np.arange(length) < 3, 0.0, 10.0)
    starts = segment_pieces(weighted(y, 0.05), np.array([0]), GAIN)
    assert starts.tolist() == ([0, 3] if length == 6 else [0])


def test_equal_abscissae_break_nothing() -> None:
    data = Readings(np.zeros(20), np.arange(20.0), np.full(20, 100.0))
    starts = segment_pieces(data, np.array([0]), GAIN)
    assert starts[0] == 0
    assert (np.diff(np.append(starts, 20)) >= 3).all()
