"""Weighted least-squares parabolas on consecutive readings of scan lines, many segments at once.

A segment is a run of consecutive rows of flat arrays: rows ``starts[i]`` to ``starts[i + 1]``, the last one to the
end. Weights are inverse variances, so a misfit is a chi-square. Sums are taken about each segment's own centre and
scale: nothing is lost on long lines or far from the origin.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


class Readings(NamedTuple):
    """Abscissae, heights and inverse variances, flat."""

    x: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]

    def take(self, rows: np.ndarray) -> "Readings":
        """Some of the rows, in the order asked."""
        return Readings(self.x[rows], self.y[rows], self.weight[rows])


class Parabolas(NamedTuple):
    """One parabola a segment, on polynomials orthogonal over the segment's own readings.

    With ``t = (x - centre) / scale``: 1, ``t`` and ``t² - second - skew t``, times the three ``coefficients``, whose
    inverse variances are the ``norms``; ``misfit`` is the chi-square the parabola leaves.
    """

    count: Int[np.ndarray, " s"]
    centre: Float[np.ndarray, " s"]
    scale: Float[np.ndarray, " s"]
    second: Float[np.ndarray, " s"]
    skew: Float[np.ndarray, " s"]
    coefficients: Float[np.ndarray, "3 s"]
    norms: Float[np.ndarray, "3 s"]
    misfit: Float[np.ndarray, " s"]

    def take(self, rows: np.ndarray) -> "Parabolas":
        """The parabolas of some segments, in the order asked."""
        return Parabolas(*(part[..., rows] for part in self))

    def polynomials(self, x: Float[np.ndarray, " s"]) -> Float[np.ndarray, "3 s"]:
        """The three polynomials of each segment at one abscissa each."""
        t = (x - self.centre) / self.scale
        return np.stack([np.ones_like(t), t, t * t - self.second - self.skew * t])

    def derivatives(self, x: Float[np.ndarray, " s"]) -> Float[np.ndarray, "3 s"]:
        """Their derivatives with respect to x."""
        t = (x - self.centre) / self.scale
        return np.stack([np.zeros_like(t), np.ones_like(t), 2 * t - self.skew]) / self.scale


class Cuts(NamedTuple):
    """Where each segment is best cut in two: first row of the right part, chi-square of one parabola and of two.

    A segment too short to be cut has its own first row there, and no gain.
    """

    row: Int[np.ndarray, " s"]
    whole: Float[np.ndarray, " s"]
    parts: Float[np.ndarray, " s"]


def fit(data: Readings, starts: Int[np.ndarray, " s"]) -> Parabolas:
    """Parabolas through the segments; straight or constant where two or one readings are all there is."""
    return _fit(data, starts)[0]


def best_cuts(data: Readings, starts: Int[np.ndarray, " s"], least: int) -> Cuts:
    """The cut of each segment in two parabolas of least misfit, at least ``least`` readings on each side."""
    whole, t, residual = _fit(data, starts)
    count = whole.count
    # What the single parabola leaves is small, so the running sums keep their digits.
    t2, weight = t * t, data.weight
    wr, wt, wt2 = weight * residual, weight * t, weight * t2
    terms = (weight, wt, wt2, wt2 * t, wt2 * t2, wr, wr * t, wr * t2, wr * residual)
    left, right = [], []
    for term in terms:
        running = np.cumsum(term)
        running -= term
        before = running - np.repeat(running[starts], count)
        left.append(before)
        right.append(np.repeat(np.add.reduceat(term, starts), count) - before)
    misfit = _misfit(*left) + _misfit(*right)
    row = np.arange(len(t)) - np.repeat(starts, count)
    misfit[(row < least) | (row > np.repeat(count - least, count))] = np.inf
    lowest = np.minimum.reduceat(misfit, starts)
    at = first_rows(misfit == np.repeat(lowest, count), starts)
    cut = np.isfinite(lowest)
    return Cuts(np.where(cut, at, starts), whole.misfit, np.where(cut, np.maximum(lowest, 0.0), whole.misfit))


def runs(
    data: Readings, first: Int[np.ndarray, " c"], end: Int[np.ndarray, " c"]
) -> tuple[Readings, Int[np.ndarray, " c"]]:
    """The rows of runs, which may overlap, one run after the other, and where each begins."""
    count = end - first
    begin = np.cumsum(count) - count
    return data.take(np.arange(count.sum()) + np.repeat(first - begin, count)), begin


def first_rows(flags: Bool[np.ndarray, " n"], starts: Int[np.ndarray, " s"]) -> Int[np.ndarray, " s"]:
    """The first flagged row of each segment; every segment must have one."""
    rows = np.flatnonzero(flags)
    return rows[np.searchsorted(rows, starts)]


def _fit(
    data: Readings, starts: Int[np.ndarray, " s"]
) -> tuple[Parabolas, Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """The parabolas, each reading's scaled abscissa and its residual."""
    weight = data.weight
    count = np.diff(np.append(starts, len(weight)))
    total = np.add.reduceat(weight, starts)
    centre = np.add.reduceat(weight * data.x, starts) / total
    t = data.x - np.repeat(centre, count)
    scale = np.maximum.reduceat(np.abs(t), starts)
    scale[scale == 0] = 1.0
    t /= np.repeat(scale, count)
    wt = weight * t
    wt2 = wt * t
    mean = np.add.reduceat(weight * data.y, starts) / total
    residual = data.y - np.repeat(mean, count)
    first = np.add.reduceat(wt2, starts)
    second = first / total
    third = np.add.reduceat(wt2 * t, starts)
    skew = _ratio(third, first)
    curved = np.add.reduceat(wt2 * t * t, starts) - second * first - skew * third
    curved[(count < 3) | (curved < 1e-9 * total)] = 0.0
    slope = _ratio(np.add.reduceat(wt * residual, starts), first)
    residual -= np.repeat(slope, count) * t
    bend = _ratio(np.add.reduceat(wt2 * residual, starts), curved)
    residual -= np.repeat(bend, count) * (t * (t - np.repeat(skew, count)) - np.repeat(second, count))
    misfit = np.add.reduceat(weight * residual * residual, starts)
    coefficients, norms = np.stack([mean, slope, bend]), np.stack([total, first, curved])
    return Parabolas(count, centre, scale, second, skew, coefficients, norms, misfit), t, residual


def _misfit(
    s0: np.ndarray,
    s1: np.ndarray,
    s2: np.ndarray,
    s3: np.ndarray,
    s4: np.ndarray,
    r0: np.ndarray,
    r1: np.ndarray,
    r2: np.ndarray,
    rr: np.ndarray,
) -> np.ndarray:
    """Chi-square of a parabola from the sums of w, wt, .. wt⁴ and wr, wrt, wrt², wr²; moves t to its mean first."""
    inverse = _ratio(np.ones_like(s0), s0)
    m = s1 * inverse
    a2 = s2 * inverse - m * m
    a3 = s3 * inverse - m * (3 * a2 + m * m)
    a4 = s4 * inverse - m * (4 * a3 + m * (6 * a2 + m * m))
    skew = _ratio(a3, a2)
    curved = a4 - a2 * a2 - skew * a3
    curved[curved < 1e-11] = 0.0
    p1 = r1 - m * r0
    p2 = r2 - m * (r1 + p1) - a2 * r0 - skew * p1
    return rr - inverse * (r0 * r0 + _ratio(p1 * p1, a2) + _ratio(p2 * p2, curved))


def _ratio(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a / b, and 0 where b is not above 0."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
