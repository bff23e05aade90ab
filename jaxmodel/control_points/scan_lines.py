"""A range image as scan lines: its distances, pitch and noise, and each line's readings on coordinates of its own.

Along a line through a sensor in one place (pinhole, panorama) a plane is straight in inverse distance against the
tangent of the angle, both taken about the line's middle direction; for parallel rays, in distance against position.
The abscissa is the true position along the line, so missing readings and uneven sampling do no harm, and noise, which
runs along the ray, moves the ordinate only.
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.sectors import sector_starts
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage, Scan

BRIDGE = 2  # missing readings in a row that a surface may reach across
_BLOCK = 1 << 14  # pixels treated together: their arrays stay in the cache
_SAMPLE = 1 << 18  # pixels that medians over the whole image are taken from
_THIRD = np.sqrt(20.0)  # standard deviation of a third difference of unit noise


class LineView(eqx.Module):
    """The image with the sensor at the origin, or at infinity along ``toward``.

    ``points (h, w, 3)`` from the sensor's place, NaN where there is no reading; ``distance (h, w)`` along the ray;
    ``pitch`` the step between neighbouring rays down a column and along a row: radian, or the unit of the data for
    parallel rays. ``toward`` is None for a sensor in one place.
    """

    points: Float[np.ndarray, "h w 3"]
    distance: Float[np.ndarray, "h w"]
    pitch: tuple[float, float]
    toward: Float[np.ndarray, "3"] | None

    def reach(self, distance: np.ndarray) -> np.ndarray:
        """What a pitch is to be multiplied by to be a length at these distances."""
        return np.ones_like(distance) if self.toward is not None else distance


class LineReadings(NamedTuple):
    """The readings of consecutive lines, flat, missing ones left out.

    ``pixel (n,)`` counts through the block, line by line; ``gap (n,)`` pixels to the next reading of the line, 0
    where there is none within reach.
    """

    pixel: Int[np.ndarray, " n"]
    gap: Int[np.ndarray, " n"]


def line_view(image: Scan) -> LineView:
    """``image`` from its sensor. Raises :class:`InputError` when it is not a range image."""
    if not isinstance(image, RangeImage):
        raise InputError("edges are found along the lines of a range image, and this scan has no grid of pixels")
    points = np.array(image.points, dtype=np.float64)
    points[~(image.valid & np.isfinite(points).all(axis=-1))] = np.nan
    if image.eye[3] == 0:
        toward = image.eye[:3] / np.linalg.norm(image.eye[:3])
        distance = -points @ toward
    else:
        toward = None
        points -= image.eye[:3] / image.eye[3]
        distance = np.sqrt(np.einsum("...i,...i", points, points))
        points[distance == 0] = np.nan
        distance[distance == 0] = np.nan
    pitch = [_pitch(np.swapaxes(points, 0, 1 - axis), np.swapaxes(distance, 0, 1 - axis), toward) for axis in (0, 1)]
    known = [value for value in pitch if value > 0]
    row, column = (value if value > 0 else max(known, default=1.0) for value in pitch)  # 1: nothing has a neighbour
    return LineView(points, distance, (row, column), toward)


def blocks(shape: tuple[int, ...]) -> Iterator[slice]:
    """Consecutive lines of an array (lines, places), in slices of bounded size."""
    step = max(1, _BLOCK // max(shape[1], 1))
    for first in range(0, shape[0], step):
        yield slice(first, min(first + step, shape[0]))


def readings(valid: Bool[np.ndarray, "m n"]) -> LineReadings:
    """Where the readings of some lines are, and how far it is from each to the next."""
    pixel = np.flatnonzero(valid)
    line = pixel // valid.shape[1]
    gap = np.zeros_like(pixel)
    gap[:-1] = np.diff(pixel)
    gap[:-1][np.diff(line) != 0] = 0
    gap[gap > BRIDGE + 1] = 0
    return LineReadings(pixel, gap)


def noise(view: LineView) -> float:
    """Standard deviation of the readings along the ray, unit of the data, from the median third difference.

    A third difference is free of slope and curvature; the median does not see the few that lie across edges.
    Zero where no four readings follow each other.
    """
    sizes = []
    for axis in (0, 1):
        lines = _sampled(np.swapaxes(view.distance, 0, 1 - axis))
        size = np.abs(np.diff(lines, n=3, axis=1))
        sizes.append(size[np.isfinite(size)])
    size = np.concatenate(sizes)
    return float(np.median(size)) / (0.6745 * _THIRD) if size.size else 0.0


def local_noise(
    view: LineView, joined: tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]], sigma: float, radius: int = 8
) -> Float[np.ndarray, "h w"]:
    """The noise around each pixel, as :func:`noise`: it grows where the surface is seen at a slant.

    The mean absolute third difference of a window, each capped at six times what ``sigma`` makes usual.
    ``joined[axis]`` tells where a reading and the next along the axis lie on one surface.
    """
    from scipy.ndimage import uniform_filter

    size = np.zeros(view.distance.shape)
    number = np.zeros(view.distance.shape)
    usual = sigma * _THIRD
    for axis in (0, 1):
        lines, links = np.swapaxes(view.distance, 0, 1 - axis), np.swapaxes(joined[axis], 0, 1 - axis)
        s, k = np.swapaxes(size, 0, 1 - axis), np.swapaxes(number, 0, 1 - axis)
        for rows in blocks(lines.shape):
            third = np.abs(np.diff(lines[rows], n=3, axis=1))
            link = links[rows]
            good = np.isfinite(third) & link[:, :-3] & link[:, 1:-2] & link[:, 2:-1]
            s[rows, 1:-2] += np.where(good, np.minimum(third, 6 * usual), 0.0)
            k[rows, 1:-2] += good
    width = 2 * radius + 1
    size = uniform_filter(size, width, mode="constant")
    number = uniform_filter(number, width, mode="constant")
    enough = number > 8 / width**2
    local = np.full(size.shape, sigma)
    local[enough] = size[enough] / (number[enough] * np.sqrt(2 / np.pi) * _THIRD)
    return np.maximum(local, 0.5 * sigma)


class LineFrames(NamedTuple):
    """Coordinates along lines: abscissa in pitches, and what turns a height into an ordinate.

    ``group (n,)`` the frame of each reading, consecutive; ``cosine (n,)`` between a reading's ray and its frame's
    middle one; ``along (n, 3)`` how the ray of cosine 1 moves with the abscissa, which is not straight on a panorama's
    line.
    """

    x: Float[np.ndarray, " n"]
    cosine: Float[np.ndarray, " n"]
    group: Int[np.ndarray, " n"]
    along: Float[np.ndarray, "n 3"]


def line_frames(
    points: Float[np.ndarray, "n 3"],
    distance: Float[np.ndarray, " n"],
    line: Int[np.ndarray, " n"],
    pitch: float,
    toward: Float[np.ndarray, "3"] | None,
) -> LineFrames:
    """A frame for each line of some readings, or several where the line is wider than about 100 degrees."""
    rays = points if toward is not None else points / distance[:, None]
    new = np.append(True, np.diff(line) != 0) if toward is not None else sector_starts(points, rays, line)
    starts = np.flatnonzero(new)
    group = np.cumsum(new) - 1
    count = np.diff(np.append(starts, len(line)))
    if toward is None:
        middle = rays[starts] + rays[starts + count - 1]
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    else:
        middle = np.broadcast_to(-toward, (len(starts), 3))
    forward = rays[starts + count - 1] - rays[starts]
    forward -= np.sum(forward * middle, axis=1, keepdims=True) * middle
    length = np.linalg.norm(forward, axis=1, keepdims=True)
    forward /= np.where(length > 0, length, 1.0)
    if toward is None:
        cosine = np.einsum("ij,ij->i", rays, middle[group])
        rays = rays / cosine[:, None]
    else:
        cosine = np.ones_like(distance)
        rays = rays + distance[:, None] * toward
    x = np.einsum("ij,ij->i", rays, forward[group])
    return LineFrames(x / pitch, cosine, group, _along(rays, x, group, forward))


def _along(
    rays: Float[np.ndarray, "n 3"],
    x: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    forward: Float[np.ndarray, "g 3"],
) -> Float[np.ndarray, "n 3"]:
    """Derivative of the rays with respect to x: the mean of the steps to both neighbours of the same group."""
    run = np.diff(x)
    good = (np.diff(group) == 0) & (run > 0)
    step = np.diff(rays, axis=0) / np.where(good, run, 1.0)[:, None]
    step[~good] = 0.0
    total, number = np.zeros_like(rays), np.zeros(len(x))
    total[:-1] += step
    total[1:] += step
    number[:-1] += good
    number[1:] += good
    return np.where(number[:, None] > 0, total / np.maximum(number, 1.0)[:, None], forward[group])


def _pitch(points: np.ndarray, distance: np.ndarray, toward: np.ndarray | None) -> float:
    """Median step between neighbouring rays along the second axis; NaN where there is none."""
    points, distance = _sampled(points), _sampled(distance)
    rays = points / distance[..., None] if toward is None else points + distance[..., None] * toward
    step = np.sqrt(np.sum(np.diff(rays, axis=1) ** 2, axis=-1))
    step = step[np.isfinite(step)]
    return float(np.median(step)) if step.size else float("nan")


def _sampled(lines: np.ndarray) -> np.ndarray:
    """Enough of the lines, evenly picked."""
    most = max(1, _SAMPLE // max(lines.shape[1], 1))
    return lines[:: -(-lines.shape[0] // most)] if lines.shape[0] else lines
