"""Jump edges of a range image along its rows and columns, and the image without mixed points (thesis §2.4.1)."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.edge_map import EdgeKind, EdgeMarks
from jaxmodel.control_points.mixed_points import mixed_points, spikes
from jaxmodel.control_points.scan_lines import LineView, blocks, readings
from jaxmodel.control_points.steps import Steps, find_steps


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
            steps, linked = at.steps, at.steps.gap > 0
            turned[line, place] = linked & ~steps.jump
            if marks is None:
                continue
            lone = ~linked | ~np.append(False, linked[:-1])
            marks.mark(EdgeKind.BORDER, axis, line[lone], place[lone])
            before = np.flatnonzero(steps.jump)
            rising = steps.step[before] > 0
            near, far = np.where(rising, before, before + 1), np.where(rising, before + 1, before)
            marks.mark_jumps(axis, line[before], place[near], place[far])
        out.append(joined)
    return out[0], out[1]


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
