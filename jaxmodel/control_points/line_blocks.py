"""The readings of some scan lines as abscissae, ordinates and weights, ready to be segmented."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.parabolas import Readings
from jaxmodel.control_points.scan_lines import LineView, line_frames

_AVERAGED = (0.15, 0.4, 0.8)  # noise in pitches from which one, two, three lines on each side are averaged
_FLOOR = 0.05  # pitches that a reading may always stray from its parabola


class LineArrays(NamedTuple):
    """An image with the lines along the second axis.

    ``along`` and ``across`` tell where a reading and the next one of its line, or of the next line, lie on one surface;
    ``sigma`` is the noise, unit of the data, ``pitch`` the step between the rays of a line.
    """

    points: Float[np.ndarray, "m n 3"]
    distance: Float[np.ndarray, "m n"]
    sigma: Float[np.ndarray, "m n"]
    along: Bool[np.ndarray, "m n"]
    across: Bool[np.ndarray, "m n"]
    pitch: float
    toward: Float[np.ndarray, "3"] | None


class LineBlock(NamedTuple):
    """Readings of some lines, flat; abscissae and ordinates in pitches, ordinates growing towards the sensor.

    ``pieces`` are the first rows of the runs between jumps; ``averaged`` how many lines a reading is the mean of, which
    rounds an edge across them off over as many places. A slope s stands for the tangent ``along - s eyeward``.
    """

    line: Int[np.ndarray, " n"]
    place: Int[np.ndarray, " n"]
    data: Readings
    pieces: Int[np.ndarray, " p"]
    averaged: Float[np.ndarray, " n"]
    along: Float[np.ndarray, "n 3"]
    eyeward: Float[np.ndarray, "n 3"]

    def tangents(self, slope: Float[np.ndarray, " k"], rows: np.ndarray) -> Float[np.ndarray, "k 3"]:
        """Directions in space, not unit, that slopes at some rows stand for."""
        return self.along[rows] - slope[:, None] * self.eyeward[rows]


def line_arrays(
    view: LineView,
    axis: int,
    sigma: Float[np.ndarray, "h w"],
    joined: tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]],
) -> LineArrays:
    """The image with the lines along ``axis`` of it as the second axis."""
    points, distance, sigma, along, across = (
        np.swapaxes(part, 0, 1 - axis) for part in (view.points, view.distance, sigma, joined[axis], joined[1 - axis])
    )
    return LineArrays(points, distance, sigma, along, across, view.pitch[axis], view.toward)


def line_block(arrays: LineArrays, lines: slice) -> LineBlock:
    """Lines ``lines`` of the image.

    Where the noise passes a share of the pitch, neighbouring lines are averaged first, as many on one side as on the
    other, so that planes stay as they are.
    """
    distance = arrays.distance[lines]
    pixel = np.flatnonzero(np.isfinite(distance))
    line, place = np.divmod(pixel, distance.shape[1])
    distance = distance.reshape(-1)[pixel]
    points = arrays.points[lines].reshape(-1, 3)[pixel]
    reach = distance if arrays.toward is None else np.ones_like(distance)
    sigma = arrays.sigma[lines].reshape(-1)[pixel] / (arrays.pitch * reach)
    frames = line_frames(points, distance, line + lines.start, arrays.pitch, arrays.toward)
    linked = arrays.along[lines].reshape(-1)[pixel][:-1] & (np.diff(frames.group) == 0)
    pieces = np.flatnonzero(np.append(True, ~linked)[: len(pixel)])
    height, number = (part.reshape(-1)[pixel] for part in _averaged(arrays, lines))
    if arrays.toward is None:
        # in units of each piece's mean height, so that ordinates are lengths in pitches
        height = height / frames.cosine
        size = np.diff(np.append(pieces, len(pixel)))
        unit = np.repeat(np.add.reduceat(height, pieces) / size, size) if len(pixel) else height
        height, sigma = height / unit, sigma * height / unit
        eyeward = points * unit[:, None]
    else:
        eyeward = np.broadcast_to(-arrays.toward, points.shape)
    data = Readings(frames.x, height / arrays.pitch, 1.0 / (sigma**2 / number + _FLOOR**2))
    return LineBlock(line + lines.start, place, data, pieces, number, frames.along, eyeward)


def _averaged(arrays: LineArrays, lines: slice) -> tuple[Float[np.ndarray, "b n"], Float[np.ndarray, "b n"]]:
    """Heights of some lines, each averaged with the same pixels of its neighbours, and over how many."""
    index = np.arange(lines.start, lines.stop)
    last = len(arrays.distance) - 1

    def heights(rows: Int[np.ndarray, " b"]) -> Float[np.ndarray, "b n"]:
        distance = arrays.distance[np.clip(rows, 0, last)]
        return 1.0 / distance if arrays.toward is None else -distance

    total = heights(index)
    number = np.ones_like(total)
    reach = arrays.distance[lines] if arrays.toward is None else 1.0
    ratio = arrays.sigma[lines] / (arrays.pitch * reach)
    open_ = np.ones(total.shape, dtype=bool)
    for k, least in enumerate(_AVERAGED, start=1):
        open_ &= (ratio > least) & ((index >= k) & (index + k <= last))[:, None]
        if not open_.any():
            break
        open_ &= arrays.across[np.clip(index + k - 1, 0, last)] & arrays.across[np.clip(index - k, 0, last)]
        pair = heights(index - k) + heights(index + k)
        open_ &= np.isfinite(pair)
        total += np.where(open_, pair, 0.0)
        number += 2 * open_
    return total / number, number
