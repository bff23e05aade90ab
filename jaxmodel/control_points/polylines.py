"""Contours at any resolution: polylines through measured points (thesis §2.4.1, contours approximated by segments).

Every point of a chain gets, once, the error at which it is left out; a larger error leaves out more of them. A point
counts by its distance from the chord, and, because a chord alone would leave two points of a straight edge, by
``ALONG`` times its distance along the chain from the nearer end of the chord too.
"""

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.control_points.contour_set import Contour, ContourSet
from jaxmodel.errors import InputError

ALONG = 0.25
"""How much a distance along the edge counts against one across it: straight parts keep a point at least every
``2 error / ALONG`` = 8 errors. A thin line of pixels strays up to about half a pixel from a straight edge, so bends of
half a pixel say nothing, and with 1/4 such an error leaves straight parts a point every 4 pixels: from there on a
coarser polyline drops points by shape, and a finer one, which would follow the pixels' zigzag, fills evenly. From 0.03
to 1 the accuracy of registrations with few contour points hardly changes; it was best at 0.25."""


def approximate(contours: ContourSet, error: float) -> ContourSet:
    """Polylines through measured points: each chain with only the points that matter more than ``error``.

    No point left out is farther than ``error`` (unit of the data, 0 or more) from the segment that replaces it, and
    a segment of an approximated straight part is no longer than ``2 error / ALONG`` and one step of the chain. The
    first and last point of an open chain stay; a closed chain keeps two points at least. A smaller error keeps all
    the points a larger one keeps. Raises :class:`InputError` for an error that is negative or not a number.
    """
    if not error >= 0:
        raise InputError(f"error is {error}, expected a length of 0 or more")
    if not contours.chains:
        return contours
    matters = importance(contours)
    chains = []
    for chain, values in zip(contours.chains, matters, strict=True):
        kept = values > error
        if not chain.closed:
            kept[[0, -1]] = True
        elif np.count_nonzero(kept) < 2:
            kept[np.argsort(-values, kind="stable")[:2]] = True
        chains.append(Contour(chain.pixels[kept], chain.points[kept], chain.kind[kept], chain.closed))
    return ContourSet(tuple(chains), contours.outcome)


def importance(contours: ContourSet) -> list[Float[np.ndarray, " n"]]:
    """For each chain, the error at which each of its points is left out, in the unit of the data.

    The ends of a chain, of a closed one its first point and the one halfway round, matter ``ALONG`` times the chain's
    length, and no less than any point between them: short chains go first, whole.
    """
    if not contours.chains:
        return []
    closed = np.array([chain.closed for chain in contours.chains])
    lines = [np.concatenate([c.points, c.points[:1]]) if c.closed else c.points for c in contours.chains]
    starts = np.concatenate([[0], np.cumsum([len(line) for line in lines])])
    first, last = starts[:-1], starts[1:] - 1
    points = np.concatenate(lines).astype(np.float64)
    steps = np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1)
    steps[first] = 0.0
    along = np.cumsum(steps)
    length = along[last] - along[first]

    half = np.searchsorted(along, along[first] + 0.5 * length)
    half = np.clip(half, np.minimum(first + 1, last), np.maximum(last - 1, first))[closed]
    middle = last.copy()
    middle[closed] = half
    values = _hierarchy(
        points, along, np.stack([np.append(first, half), np.append(middle, last[closed])], axis=1).astype(np.int64)
    )
    ends = np.maximum(ALONG * length, np.maximum.reduceat(values, first))
    values[first], values[last], values[half] = ends, ends, ends[closed]
    return [values[i : j - 1] if ring else values[i:j] for i, j, ring in zip(first, starts[1:], closed, strict=True)]


def _hierarchy(
    points: Float[np.ndarray, "n 3"], along: Float[np.ndarray, " n"], spans: Int[np.ndarray, "s 2"]
) -> Float[np.ndarray, " n"]:
    """Split every span of a line at its worst point, and its parts again, all spans of one depth at once.

    A point's value is the largest deviation in the span it splits and in all the spans below, so the points above
    any error have all their parents with them. The distance along the line keeps the splits away from the ends of a
    span that is much longer than its bends, so the depth grows like the logarithm of the number of points.
    """
    values = np.zeros(len(points))
    parent = np.full(len(spans), -1)
    levels = []
    while True:
        inside = spans[:, 1] - spans[:, 0] - 1
        spans, parent, inside = spans[inside > 0], parent[inside > 0], inside[inside > 0]
        if len(spans) == 0:
            break
        starts = np.concatenate([[0], np.cumsum(inside)[:-1]])
        span = np.repeat(np.arange(len(spans)), inside)
        place = np.arange(len(span)) - starts[span] + spans[span, 0] + 1
        deviation = _deviation(points, along, place, spans[span, 0], spans[span, 1])
        largest = np.maximum.reduceat(deviation, starts)
        # Of points that differ by rounding alone the first one is taken, whatever the unit.
        candidates = np.flatnonzero(deviation >= (1 - 1e-9) * largest[span])
        worst = place[candidates[np.unique(span[candidates], return_index=True)[1]]]
        bent = largest > 0  # the rest are points that coincide
        worst, largest, spans, parent = worst[bent], largest[bent], spans[bent], parent[bent]
        values[worst] = largest
        levels.append((worst, parent))
        spans = np.concatenate([np.stack([spans[:, 0], worst], axis=1), np.stack([worst, spans[:, 1]], axis=1)])
        parent = np.concatenate([worst, worst])
    for worst, parent in reversed(levels):
        below = parent >= 0
        np.maximum.at(values, parent[below], values[worst[below]])
    return values


def _deviation(
    points: Float[np.ndarray, "n 3"],
    along: Float[np.ndarray, " n"],
    place: Int[np.ndarray, " k"],
    first: Int[np.ndarray, " k"],
    last: Int[np.ndarray, " k"],
) -> Float[np.ndarray, " k"]:
    """Distance of points from their chord, with ``ALONG`` times that along the line from the chord's nearer end."""
    chord, offset = points[last] - points[first], points[place] - points[first]
    squared = np.sum(chord**2, axis=1)
    share = np.clip(np.sum(offset * chord, axis=1) / np.where(squared > 0, squared, 1.0), 0.0, 1.0)
    across = np.linalg.norm(offset - share[:, None] * chord, axis=1)
    return np.hypot(across, ALONG * np.minimum(along[place] - along[first], along[last] - along[place]))
