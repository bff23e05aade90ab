"""A pot with handle, spout and lid, its points on regular grids: synthetic clouds as those of CAD programs."""

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.scan.triangle_mesh import box, ring

_BODY = np.array([0.42, 0.42, 0.30])  # half axes
_KNOB, _KNOB_HEIGHT = 0.07, 0.35
_HANDLE = (0.2, 0.04, -0.42)  # radius of its middle line, of its tube, x of its centre
_SPOUT = (0.07, 0.035, 0.34)  # radius where it begins, where it ends, length
_SPOUT_FROM, _SPOUT_ALONG = np.array([0.33, 0.0, 0.0]), np.array([0.8, 0.0, 0.6])


def regular_pot(count: int) -> Float[np.ndarray, "n 3"]:
    """About ``count`` points of the outer surface, longest side about 1; each part has its own grid, equally fine.

    Raises :class:`InputError` for fewer than 500: the parts would not be told apart.
    """
    if count < 500:
        raise InputError(f"A pot of {count} points: expected at least 500.")
    spacing = 0.05
    for _ in range(12):
        points = _parts(spacing)
        spacing *= float(np.sqrt(len(points) / count))
    return points


def _parts(spacing: float) -> Float[np.ndarray, "n 3"]:
    body = _ellipsoid(_BODY, spacing)
    knob = _ellipsoid(np.full(3, _KNOB), spacing) + np.array([0, 0, _KNOB_HEIGHT])
    major, minor, at = _HANDLE
    around, across = (max(8, round(2 * np.pi * radius / spacing)) for radius in (major, minor))
    handle = ring(major, minor, around, across).vertices[:, [0, 2, 1]] + np.array([at, 0, 0])
    spout = _spout(spacing)
    parts = [body, knob, handle, spout]
    inside = [_in_body, _in_knob, _in_handle, _in_spout]
    kept = []
    for i, part in enumerate(parts):
        hidden = np.zeros(len(part), bool)
        for j, within in enumerate(inside):
            if j != i:
                hidden |= within(part)
        kept.append(part[~hidden])
    return np.concatenate(kept)


def _ellipsoid(half: Float[np.ndarray, "3"], spacing: float) -> Float[np.ndarray, "n 3"]:
    """Six square grids of equal angles drawn onto an ellipsoid."""
    cells = max(3, round(np.pi / 2 * float(half.max()) / spacing))
    cube = np.tan(np.pi / 4 * box((-1, -1, -1), (1, 1, 1), cells).vertices)
    return cube / np.linalg.norm(cube, axis=1, keepdims=True) * half


def _spout(spacing: float) -> Float[np.ndarray, "n 3"]:
    """A cone with a round end, in rings."""
    first, last, length = _SPOUT
    rings = max(3, round(length / spacing))
    sides = max(8, round(2 * np.pi * last / spacing))
    v = 2 * np.pi / sides * np.arange(sides)
    s = np.linspace(0, 1, rings + 1)
    polar = np.linspace(0, np.pi / 2, max(2, round(np.pi / 2 * last / spacing)) + 1)[1:-1]
    radius = np.concatenate([first + (last - first) * s, last * np.cos(polar)])
    height = np.concatenate([length * s, length + last * np.sin(polar)])
    side, up = np.array([0.0, 1.0, 0.0]), np.cross(_SPOUT_ALONG, [0.0, 1.0, 0.0])
    circle = np.cos(v)[:, None] * side + np.sin(v)[:, None] * up
    walls = (height[:, None] * _SPOUT_ALONG)[:, None, :] + radius[:, None, None] * circle
    tip = (length + last) * _SPOUT_ALONG
    return np.concatenate([walls.reshape(-1, 3), tip[None]]) + _SPOUT_FROM


def _in_body(points: np.ndarray) -> np.ndarray:
    return ((points / _BODY) ** 2).sum(axis=1) < 1


def _in_knob(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - [0, 0, _KNOB_HEIGHT], axis=1) < _KNOB


def _in_handle(points: np.ndarray) -> np.ndarray:
    major, minor, at = _HANDLE
    reach = np.hypot(points[:, 0] - at, points[:, 2]) - major
    return np.hypot(reach, points[:, 1]) < minor


def _in_spout(points: np.ndarray) -> np.ndarray:
    first, last, length = _SPOUT
    chord = points - _SPOUT_FROM
    height = chord @ _SPOUT_ALONG
    off = np.linalg.norm(chord - height[:, None] * _SPOUT_ALONG, axis=1)
    cone = (height >= 0) & (height < length) & (off < first + (last - first) * height / length)
    return cone | (np.linalg.norm(chord - length * _SPOUT_ALONG, axis=1) < last)
