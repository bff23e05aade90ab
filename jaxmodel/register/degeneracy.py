"""Which motions a surface does not feel: named, with their axis, from points and normals alone.

A motion moves each point by ``d``; what the surface feels of it is ``n . d``. The quotient of both, summed over the
surface, is the squared sine of the angle at which the motion leaves the surface, whatever the unit: 0 for a motion that
slides along it (slippage analysis, Gelfand and Guibas 2004, with the motion's own length as the norm). Its smallest
values over all motions are a generalised eigenvalue problem. Normals that err by an angle make every sliding motion
look as if it left the surface at that angle, so that motions below what the normals themselves are sure of are free.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.spatial import KDTree

from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.errors import InputError

FEWEST = 10
"""Points, at least."""
POINTS = 1500
"""Of a surface that are looked at, evenly spread."""
NEIGHBOURS = 10
"""Of a point, from which the error of its normal is told."""
SURE_DEG = 1.5
"""Least angle, degrees, at which a motion must leave a surface to be felt, however exact the normals."""
TIMES = 1.7
"""Errors of the normals at which a motion must leave the surface to be felt."""
CREASE = 4.0
"""Errors of a normal beyond which it belongs to no smooth surface, but to an edge: it speaks of none of its faces."""
WORST = 0.03
"""Share of the points that may err wildly: pixels beside an edge mix two faces."""


class Kind(IntEnum):
    """What a surface is that some motions slide along."""

    HELD = 0
    PRISM = 1
    REVOLUTION = 2
    HELIX = 3
    CYLINDER = 4
    PLANE = 5
    SPHERE = 6
    OTHER = 7

    @property
    def sentence(self) -> str:
        """What is free."""
        return {
            Kind.HELD: "every motion is felt",
            Kind.PRISM: "free to slide along one direction: a prism or a corridor",
            Kind.REVOLUTION: "free to turn about one axis: a surface of revolution",
            Kind.HELIX: "free to turn about one axis while sliding along it: a helix",
            Kind.CYLINDER: "free to turn about one axis and to slide along it: a cylinder",
            Kind.PLANE: "free to slide in a plane and to turn in it: a plane",
            Kind.SPHERE: "free to turn about a point: a sphere",
            Kind.OTHER: "several motions are free that belong to no single surface",
        }[self]


class Freedom(NamedTuple):
    """What a surface does not feel.

    ``kind``; ``axis (3,)`` unit: of the slide, of the turn, or the plane's normal, zero where there is none; ``point
    (3,)`` on the axis, or the sphere's centre; ``spectrum (6,)`` root mean square sine of the angle at which the six
    principal motions leave the surface, smallest first, and ``motions (6, 6)`` these as columns (turn about the
    points' middle times their spread, shift in their spread); ``turns (3,)`` and ``shifts (3,)`` the same of turns
    alone and shifts alone, each with the other free to follow; ``floor``: below which a motion is free.
    """

    kind: Kind
    axis: Float[np.ndarray, "3"]
    point: Float[np.ndarray, "3"]
    spectrum: Float[np.ndarray, "6"]
    motions: Float[np.ndarray, "6 6"]
    turns: Float[np.ndarray, "3"]
    shifts: Float[np.ndarray, "3"]
    floor: float


def freedom(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Freedom:
    """Of a surface, or of the part of it that two scans share.

    ``points (n, 3)``, at least ten, any frame and unit; unit ``normals (n, 3)``, to either side. Raises
    :class:`InputError` for fewer points.
    """
    if len(points) < FEWEST:
        raise InputError(f"{len(points)} points are too few to tell what they are free to do: expected {FEWEST}.")
    kept = voxel_subsample(points, POINTS)
    p, n = np.asarray(points[kept], np.float64), np.asarray(normals[kept], np.float64)
    middle = p.mean(axis=0)
    spread = max(float(np.sqrt(np.mean(np.sum((p - middle) ** 2, axis=1)))), 1e-300)
    p = (p - middle) / spread
    left = _off_trend(p, n)
    error = _typical(left)
    smooth = left <= max(CREASE * error, np.deg2rad(SURE_DEG)) ** 2
    if smooth.sum() >= FEWEST:
        p, n = p[smooth], n[smooth]
    felt, moved = _forms(p, n)
    felt, moved = _without_worst(p, n, felt, moved)
    value, motion = eigh(felt, moved)
    floor = max(np.sin(np.deg2rad(SURE_DEG)), TIMES * error)
    spectrum = np.sqrt(np.maximum(value, 0.0))
    free = motion[:, spectrum < floor]
    kind, axis, point = _named(free)
    return Freedom(
        kind,
        axis,
        point * spread + middle,
        spectrum,
        motion,
        _alone(felt, moved, slice(0, 3)),
        _alone(felt, moved, slice(3, 6)),
        float(floor),
    )


def normal_error(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> float:
    """Root mean square error of a normal, radian and per direction: what is left of it after the trend around it.

    The points should be so far apart that their normals were estimated from points of their own.
    """
    return _typical(_off_trend(points, normals))


def _typical(squared: Float[np.ndarray, " n"]) -> float:
    # of a sum of two squares the median is 1.39 of one's variance
    return float(np.sqrt(np.median(squared) * 2 / 1.386))


def _off_trend(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Squared error of each normal per direction, radian."""
    count = min(NEIGHBOURS, len(points) - 1)
    if count < 6:
        return np.zeros(len(points))
    near = np.asarray(KDTree(points).query(points, k=count + 1)[1])[:, 1:]
    offset = points[near] - points[:, None]
    design = np.concatenate([np.ones((*near.shape, 1)), offset], axis=2)
    # the trend of the neighbours, taken at the point itself, beside the normal found there
    solved = np.linalg.pinv(design, rcond=1e-3)[:, 0]
    # normals of a bare cloud may point to either side
    side = np.where(np.einsum("nka,na->nk", normals[near], normals) < 0, -1.0, 1.0)
    left = normals - np.einsum("nk,nka->na", solved * side, normals[near])
    inflation = 1 + np.sum(solved**2, axis=1)
    return np.sum(left**2, axis=1) / inflation / 2  # two directions across a normal


def _forms(p: Float[np.ndarray, "n 3"], n: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares, as forms of a motion (turn, shift), of what is felt and of what is moved."""
    row = np.concatenate([np.cross(p, n), n], axis=1)
    zero, (x, y, z) = np.zeros(len(p)), p.T
    turned = np.stack([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    way = np.concatenate([turned, np.broadcast_to(np.eye(3), turned.shape)], axis=2)
    return row.T @ row / len(p), np.einsum("nai,naj->ij", way, way) / len(p)


def _without_worst(
    p: Float[np.ndarray, "n 3"], n: Float[np.ndarray, "n 3"], felt: Float[np.ndarray, "6 6"], moved: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Both forms, less the few points that alone feel the freest motions."""
    _, motion = eigh(felt, moved)
    row = np.concatenate([np.cross(p, n), n], axis=1)
    left = np.sum((row @ motion[:, :3]) ** 2, axis=1)
    calm = left <= np.quantile(left, 1 - WORST)
    return _forms(p[calm], n[calm])


def _alone(felt: np.ndarray, moved: np.ndarray, part: slice) -> Float[np.ndarray, "3"]:
    """The spectrum of one block, the other block free to follow."""
    other = slice(3, 6) if part.start == 0 else slice(0, 3)
    inner = felt[other, other] + 1e-12 * np.eye(3)
    schur = felt[part, part] - felt[part, other] @ np.linalg.solve(inner, felt[other, part])
    return np.sqrt(np.maximum(eigh(schur, moved[part, part], eigvals_only=True), 0.0))


def _named(free: Float[np.ndarray, "6 k"]) -> tuple[Kind, np.ndarray, np.ndarray]:
    """The surface that has just these motions (turn about the origin, shift), its axis, and a point on it."""
    zero, count = np.zeros(3), free.shape[1]
    if count == 0:
        return Kind.HELD, zero, zero
    basis = np.linalg.qr(free)[0]
    # the part of the turns: as many of them as the free motions have beside pure shifts
    _, size, right = np.linalg.svd(basis[:3], full_matrices=True)
    turns = int((size > TURNS_AT_ALL).sum())
    shifts = count - turns
    if turns == 0:
        direction = basis[3:, 0] / np.linalg.norm(basis[3:, 0])
        return (Kind.PRISM, direction, zero) if shifts == 1 else (Kind.OTHER, zero, zero)
    screw = basis @ right[0]
    turn, shift = screw[:3], screw[3:]
    axis, point = turn / np.linalg.norm(turn), np.cross(turn, shift) / (turn @ turn)
    along = abs(turn @ shift) / (turn @ turn)
    if (turns, shifts) == (1, 0):
        return (Kind.REVOLUTION if along < PITCH else Kind.HELIX), axis, point
    slide = (basis @ right[turns:].T)[3:]
    if (turns, shifts) == (1, 1):
        with_axis = abs(slide[:, 0] @ axis) / max(np.linalg.norm(slide[:, 0]), 1e-300)
        across = point - (point @ axis) * axis
        return (Kind.CYLINDER, axis, across) if with_axis > 0.9 else (Kind.OTHER, zero, zero)
    if (turns, shifts) == (1, 2):
        normal = np.cross(*slide.T)
        normal = normal / max(np.linalg.norm(normal), 1e-300)
        return (Kind.PLANE, normal, zero) if abs(normal @ axis) > 0.9 else (Kind.OTHER, zero, zero)
    if (turns, shifts) == (3, 0):
        # shift = -turn x centre for every turn: least squares for the centre
        rows = np.concatenate([_cross(w) for w in basis[:3].T])
        centre, *_ = np.linalg.lstsq(rows, -basis[3:].T.ravel(), rcond=None)
        return Kind.SPHERE, zero, centre
    return Kind.OTHER, zero, zero


TURNS_AT_ALL = 0.25
"""Least share of a turn in a free motion of length 1 that is more than a shift's own error."""
PITCH = 0.25
"""Most that a turn about an axis may slide along it, in spreads a radian, and still be a turn."""


def _cross(w: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
