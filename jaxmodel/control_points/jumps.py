"""Jump edges of scan lines, and the readings beside them that belong to no surface (thesis §2.4.1).

A laser beam that straddles a depth jump gives the mean of two surfaces, a "mixed point".
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.edge_map import EdgeKind, EdgeMarks
from jaxmodel.control_points.scan_lines import LineReadings, LineView, blocks, readings

_SLOPE_RUN = 4  # steps of one sign in a row, half as large as a jump or more, that make a steep surface, not a jump
_EVEN = 2.5  # times the usual step of a steep surface that one of its steps may be
_DOUBT = 5.0  # standard deviations a step must pass


def without_mixed_points(view: LineView, sigma: Float[np.ndarray, "h w"], jump: float) -> LineView:
    """The view without mixed points, and without single readings off all their neighbours.

    ``sigma`` is the noise of each reading, unit of the data; ``jump`` in pitches. One reading is taken from each side
    of a jump at a time.
    """
    spoilt = np.zeros(view.distance.shape, dtype=bool)
    alone = np.zeros(view.distance.shape, dtype=np.int8)
    for axis in (0, 1):
        mixed, single = np.swapaxes(spoilt, 0, 1 - axis), np.swapaxes(alone, 0, 1 - axis)
        for line, place, at in _lines(view, axis, sigma, jump):
            mixed[line, place] |= mixed_points(at.distance, at.steps, at.pitch, at.sigma)
            single[line, place] += spikes(at.steps)
    spoilt |= alone == 2
    if not spoilt.any():
        return view
    points = np.where(spoilt[..., None], np.nan, view.points)
    return LineView(points, np.where(spoilt, np.nan, view.distance), view.pitch, view.toward)


def joined_readings(
    view: LineView, sigma: Float[np.ndarray, "h w"], jump: float, marks: EdgeMarks | None = None
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """For each axis, where a reading and the next one along it lie on one surface.

    Jumps and borders are entered into ``marks``: a border is a reading with no other within reach on one side.
    """
    out = []
    for axis in (0, 1):
        joined = np.zeros(view.distance.shape, dtype=bool)
        turned = np.swapaxes(joined, 0, 1 - axis)
        for line, place, at in _lines(view, axis, sigma, jump):
            steps = at.steps
            turned[line, place] = steps.linked & ~steps.jump
            if marks is None:
                continue
            lone = ~steps.linked | ~np.append(False, steps.linked[:-1])
            marks.mark(EdgeKind.BORDER, axis, line[lone], place[lone])
            before = np.flatnonzero(steps.jump)
            rising = steps.step[before] > 0
            near, far = np.where(rising, before, before + 1), np.where(rising, before + 1, before)
            marks.mark_jumps(axis, line[before], place[near], place[far])
        out.append(joined)
    return out[0], out[1]


class Steps(NamedTuple):
    """From each reading to the next one of its line: ``step`` in distance, whether linked and whether a jump."""

    step: Float[np.ndarray, " n"]
    limit: Float[np.ndarray, " n"]
    linked: Bool[np.ndarray, " n"]
    jump: Bool[np.ndarray, " n"]


def find_steps(
    distance: Float[np.ndarray, " n"],
    lines: LineReadings,
    pitch: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, " n"],
    jump: float,
) -> Steps:
    """Jumps along lines: steps beyond ``jump`` pitches and the noise that are not part of a steep surface.

    ``distance``, ``pitch`` (a length at each reading) and ``sigma`` are in the unit of the data.
    """
    linked = lines.gap > 0
    step = np.zeros_like(distance)
    step[:-1] = np.diff(distance)
    nearer = np.minimum(pitch, np.append(pitch[1:], np.inf))
    noise = np.hypot(sigma, np.append(sigma[1:], 0.0))
    limit = jump * nearer * np.sqrt(np.maximum(lines.gap, 1)) + _DOUBT * noise
    large = linked & (np.abs(step) > limit)
    return Steps(step, limit, linked, large & ~_steep(step, linked & (np.abs(step) > 0.5 * limit)))


class _Readings(NamedTuple):
    """Readings of some lines, with their pitch and noise as lengths, and the steps between them."""

    distance: Float[np.ndarray, " n"]
    pitch: Float[np.ndarray, " n"]
    sigma: Float[np.ndarray, " n"]
    steps: Steps


def _lines(
    view: LineView, axis: int, sigma: Float[np.ndarray, "h w"], jump: float
) -> Iterator[tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], _Readings]]:
    """Block after block of lines along ``axis``: the readings' lines and places, and the readings."""
    distances, sigmas = np.swapaxes(view.distance, 0, 1 - axis), np.swapaxes(sigma, 0, 1 - axis)
    for lines in blocks(distances.shape):
        flat = readings(np.isfinite(distances[lines]))
        if len(flat.pixel) == 0:
            continue
        line, place = np.divmod(flat.pixel, distances.shape[1])
        line += lines.start
        distance, noise = distances[line, place], sigmas[line, place]
        pitch = view.pitch[axis] * view.reach(distance)
        yield line, place, _Readings(distance, pitch, noise, find_steps(distance, flat, pitch, noise, jump))


def mixed_points(
    distance: Float[np.ndarray, " n"],
    steps: Steps,
    pitch: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Readings between the two surfaces of a jump, on neither.

    Such a reading has a jump on one side and, on its other side, either a jump of the same sign or a surface which
    it leaves towards the jump's far end, by more than the surface's own slope, a pitch and the noise explain.
    """
    return (
        _mixed_end(distance, steps, pitch, sigma)
        | _mixed_end(distance[::-1], _mirrored(steps), pitch[::-1], sigma[::-1])[::-1]
    )


def spikes(steps: Steps) -> Bool[np.ndarray, " n"]:
    """Readings with a jump on both sides, of opposite signs."""
    before = np.append(False, steps.jump[:-1])
    step = np.append(0.0, steps.step[:-1])
    return before & steps.jump & (step * steps.step < 0)


def _mixed_end(
    distance: Float[np.ndarray, " n"], steps: Steps, pitch: Float[np.ndarray, " n"], sigma: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """The mixed points among the readings just before a jump."""
    out = np.zeros(len(distance), dtype=bool)
    at = np.flatnonzero(steps.jump)
    at = at[at >= 1]
    sign = np.sign(steps.step[at])
    last = sign * steps.step[at - 1]
    out[at] = steps.jump[at - 1] & (last > 0)
    smooth = steps.linked & ~steps.jump
    deep = at >= 3
    at, sign, last = at[deep], sign[deep], last[deep]
    whole = smooth[at - 1] & smooth[at - 2] & smooth[at - 3]
    slope = 0.5 * (distance[at - 1] - distance[at - 3])
    off = last - sign * slope
    # variance of d0 - 1.5 d1 + 0.5 d3
    allowed = np.abs(slope) + pitch[at] + _DOUBT * np.sqrt(3.5) * sigma[at]
    out[at] |= whole & (off > allowed)
    return out


def _mirrored(steps: Steps) -> Steps:
    """The same steps with the lines read backwards."""
    back = [np.append(part[:-1][::-1], part[-1:]) for part in steps]
    back[0] = -back[0]
    return Steps(*back)


def _steep(step: Float[np.ndarray, " n"], large: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Steps that go on evenly, several in a row: a surface seen at a slant."""
    out = np.zeros(len(step), dtype=bool)
    sign = np.where(large, np.sign(step), 0.0)
    new = np.append(True, np.diff(sign) != 0)
    run = np.cumsum(new) - 1
    rows = np.flatnonzero(large & (np.bincount(run)[run] >= _SLOPE_RUN))
    if len(rows) == 0:
        return out
    size = np.abs(step[rows])
    run, count = np.unique(run[rows], return_inverse=True, return_counts=True)[1:]
    order = np.lexsort((size, run))
    usual = size[order][np.cumsum(count) - count + (count - 1) // 2]  # each run's median, the lower of two
    out[rows] = size <= _EVEN * usual[run]
    return out
