"""Where scan lines too wide for one frame are cut: where the surface does not bend, so that no crease lies at a cut."""

import numpy as np
from jaxtyping import Bool, Float, Int

_SECTOR = 1.8  # length of the rays' path on the unit sphere between two cuts, more or less
_SLACK = 0.08  # of that, by which a cut may be moved either way
_APART = 1.0  # between the ends of neighbouring unit rays: there a line is cut always, nothing is seen between them
_BASE = 12  # readings on each side that a bend is measured over
_PULL = 0.01  # radian of bend that a cut at the end of its slack must save


def sector_starts(
    points: Float[np.ndarray, "n 3"], rays: Float[np.ndarray, "n 3"], line: Int[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """First readings of the sectors of all lines: all unit ``rays`` of one are within 60 degrees of their middle.

    ``points (n, 3)`` from the sensor, line after line. Lines in turn are cut at different places, so no edge of the
    scene lies along all cuts.
    """
    first = np.append(True, np.diff(line) != 0)[: len(line)]
    turn = np.append(0.0, np.sqrt(np.sum(np.diff(rays, axis=0) ** 2, axis=1)))[: len(line)]
    turned = np.cumsum(turn)
    number = np.cumsum(first) - 1
    turned -= turned[first][number]
    starts = first | (turn > _APART)
    if turned.max(initial=0.0) <= _SECTOR:
        return starts
    position = turned / _SECTOR + 0.5 * (line % 2)
    passed = np.flatnonzero(~first[1:] & (np.diff(np.floor(position)) > 0)) + 1
    starts[_moved(points, number, position, passed)] = True
    return starts


def _moved(
    points: Float[np.ndarray, "n 3"],
    number: Int[np.ndarray, " n"],
    position: Float[np.ndarray, " n"],
    passed: Int[np.ndarray, " c"],
) -> Int[np.ndarray, " c"]:
    """The rows near ``passed``, the first beyond whole positions, where the line bends least."""
    if len(passed) == 0:
        return passed
    lines = 2.0 * (position.max() + 1.0)
    key, nominal = lines * number + position, lines * number[passed] + np.floor(position[passed])
    low = np.minimum(np.searchsorted(key, nominal - _SLACK), passed)
    high = np.maximum(np.searchsorted(key, nominal + _SLACK), passed + 1)
    count = high - low
    begin = np.cumsum(count) - count
    rows = np.arange(count.sum()) + np.repeat(low - begin, count)
    cost = _bends(points, number, rows) + _PULL * np.abs(key[rows] - np.repeat(nominal, count)) / _SLACK
    best = np.flatnonzero(cost == np.repeat(np.minimum.reduceat(cost, begin), count))
    return rows[best[np.searchsorted(best, begin)]]


def _bends(
    points: Float[np.ndarray, "n 3"], number: Int[np.ndarray, " n"], rows: Int[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Angle between the chords to both sides, in radian; more than any near the ends of a line."""
    before, after = np.maximum(rows - _BASE, 0), np.minimum(rows + _BASE, len(points) - 1)
    inside = (number[before] == number[rows]) & (number[after] == number[rows]) & (after - before == 2 * _BASE)
    left, right = points[rows] - points[before], points[after] - points[rows]
    sine = np.linalg.norm(np.cross(left, right), axis=1)
    return np.where(inside, np.arctan2(sine, np.sum(left * right, axis=1)), np.pi)
