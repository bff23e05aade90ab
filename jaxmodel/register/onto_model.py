"""One view fitted onto the model of the views before it, by its surface and its contours together.

Distances to tangent planes (Chen and Medioni 1992) say nothing of a slide along flat faces; contours (thesis §2.4,
§2.9.6) do: the edge between a face the model knows and one it does not is the end of the known face. Both are weighed
by how far they still scatter, so that contours, no finer than a pixel, decide only where surfaces do not. One view from
one start, unlike a sweep: exact neighbours from trees on the CPU and a 6 x 6 system a step.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxmodel.control_points.contour_points import contour_control_points
from jaxmodel.control_points.contours import ALL_KINDS
from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.range_image import RangeImage

POINTS, CONTOUR_POINTS = 3000, 2000
"""Of a view, that are fitted."""
FIRST_REACH, LAST_REACH, SHRINK = 0.05, 0.005, 0.8
"""How far partners may be, in the size of the model: at first, at last, and from step to step."""
STEPS, FEWEST = 40, 30
"""Steps at most; points of the view that must have a partner on the model's surface."""
MISTAKEN = 0.1
"""Error of a normal, rms: those of pixels beside an edge mix two faces, and speak of slides where there is no news."""
ALIKE = 0.7
"""Least cosine between the normals of partners."""
SURFACE_SCATTER, CONTOUR_SCATTER = 1e-4, 2e-3
"""Least standard deviation that is believed, in the size of the model."""
LOOSE = 0.05
"""Least standard deviation of a surface while far partners are allowed, in the reach: exact planes would hold a view
in the plane it first fell into, and no contour could move it on."""
INDEPENDENT = 3.0
"""Independent readings that all contour points together are believed as: a pixel hides the same from a whole edge."""
SOFT = 2.0
"""Scatters at which a pair's weight has fallen to a quarter (Geman and McClure)."""
NEIGHBOURS = 7
"""Contour points that tell the direction of the contour at one of them."""
STILL = 1e-5
"""A step of fewer sizes ends the fit."""


class Parts(NamedTuple):
    """What of a view is fitted, in its own frame: ``points (n, 3)`` with unit ``normals``, ``contours (c, 3)`` with
    the unit ``tangents`` of the contour there (none where there are too few).
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    contours: Float[np.ndarray, "c 3"]
    tangents: Float[np.ndarray, "c 3"]

    def moved(self, T: Float[np.ndarray, "4 4"]) -> "Parts":
        """The same in another frame."""
        R, t = T[:3, :3], T[:3, 3]
        return Parts(self.points @ R.T + t, self.normals @ R.T, self.contours @ R.T + t, self.tangents @ R.T)

    def thinned(self, count: int) -> "Parts":
        """With about ``count`` of the points, spread evenly."""
        kept = voxel_subsample(self.points, count)
        return Parts(self.points[kept], self.normals[kept], self.contours, self.tangents)


class Model(NamedTuple):
    """Views already placed, in one frame, and the trees to find partners in."""

    parts: Parts
    surface: KDTree
    contour: KDTree | None

    def with_view(self, view: Parts, T_model_view: Float[np.ndarray, "4 4"]) -> "Model":
        """The model and one more view."""
        moved = view.moved(T_model_view)
        return model_of(Parts(*(np.concatenate(pair) for pair in zip(self.parts, moved, strict=True))))


class FitOutcome(IntEnum):
    """How a fit ended."""

    FITTED = 0
    STEP_LIMIT = 1
    LITTLE_SHARED = 2

    @property
    def sentence(self) -> str:
        """What the outcome means."""
        return {
            FitOutcome.FITTED: "the steps have died down",
            FitOutcome.STEP_LIMIT: "the step limit was reached before the steps had died down",
            FitOutcome.LITTLE_SHARED: "too few points of the view lie near the model; the start is returned",
        }[self]


class Fit(NamedTuple):
    """``T_model_view`` found; ``covariance (6, 6)`` of a turn (radians) about the view's middle and a shift of it, in
    the model's frame, as the scatter of the pairs tells; ``shared`` part of the view's points with a partner at last,
    ``scatter`` standard deviation of their distances to the model's tangent planes.
    """

    outcome: FitOutcome
    T_model_view: Float[np.ndarray, "4 4"]
    covariance: Float[np.ndarray, "6 6"]
    shared: float
    scatter: float

    @property
    def deviations(self) -> tuple[float, float]:
        """Largest standard deviation of the turn about any axis, in degrees, and of the shift in any direction."""
        if not np.isfinite(self.covariance).all():
            return np.inf, np.inf
        blocks = self.covariance[:3, :3], self.covariance[3:, 3:]
        turn, shift = (float(np.sqrt(np.linalg.eigvalsh(block)[-1])) for block in blocks)
        return float(np.rad2deg(turn)), shift


def parts_of(image: RangeImage) -> Parts:
    """What of a range image a fit uses, sensor frame. Raises :class:`InputError` where it has no valid points."""
    cloud = as_cloud(image, "the range image")
    points, normals = (np.asarray(array, np.float64) for array in (cloud.points, cloud.normals))
    try:
        contours = np.asarray(contour_control_points(image, CONTOUR_POINTS, ALL_KINDS).points, np.float64)
    except InputError:  # no contours, no help from them
        contours = np.zeros((0, 3))
    if len(contours) < NEIGHBOURS:
        return Parts(points, normals, np.zeros((0, 3)), np.zeros((0, 3)))
    near = contours[KDTree(contours).query(contours, k=NEIGHBOURS)[1]]
    near = near - near.mean(axis=1, keepdims=True)
    tangents = np.linalg.eigh(np.einsum("nka,nkb->nab", near, near))[1][:, :, 2]
    return Parts(points, normals, contours, tangents)


def model_of(parts: Parts) -> Model:
    """A model from what is known in one frame. Raises :class:`InputError` where it has no point."""
    if len(parts.points) == 0:
        raise InputError("A model to fit views onto needs at least one point.")
    return Model(parts, KDTree(parts.points), KDTree(parts.contours) if len(parts.contours) else None)


def fit_onto(model: Model, view: Parts, T_model_view: Float[np.ndarray, "4 4"], size: float) -> Fit:
    """The pose of ``view`` in the model's frame, from a rough one; ``size`` of the object, unit of the data.

    Pairs farther apart than 5 % of the size are never made, so that the start must be better than that.
    """
    T = np.asarray(T_model_view, np.float64).copy()
    view, believed, shared, scatter = view.thinned(POINTS), np.zeros((6, 6)), 0.0, np.inf
    reach, outcome = FIRST_REACH * size, FitOutcome.STEP_LIMIT
    # a direction that nothing speaks of keeps its start, known as well as the first reach says
    prior = np.diag(FIRST_REACH**-2.0 * np.repeat([1.0, size**-2.0], 3))
    for _ in range(STEPS):
        moved = view.moved(T)
        centre = moved.points.mean(axis=0)
        found = _surface(model, moved, centre, reach, size)
        if found is None:
            return Fit(FitOutcome.LITTLE_SHARED, T_model_view, np.full((6, 6), np.inf), 0.0, np.inf)
        surface, shared, scatter = found
        contour, pairs = _contours(model, moved, centre, reach, size)
        information, right = np.split(surface + contour, [6], axis=1)
        step = np.linalg.solve(information + prior, right)[:, 0]
        spread = float(np.sqrt(np.mean(np.sum((moved.points - centre) ** 2, axis=1))))
        believed = _believed(surface, spread) + contour[:, :6] * (INDEPENDENT / max(pairs, INDEPENDENT)) + prior
        T = _turned(step, centre) @ T
        last = reach <= LAST_REACH * size
        reach = max(reach * SHRINK, LAST_REACH * size)
        if last and np.linalg.norm(step * np.repeat([size, 1.0], 3)) < STILL * size:
            outcome = FitOutcome.FITTED
            break
    return Fit(outcome, T, np.linalg.inv(believed), shared, scatter)


def _surface(
    model: Model, view: Parts, centre: Float[np.ndarray, "3"], reach: float, size: float
) -> tuple[Float[np.ndarray, "6 7"], float, float] | None:
    """Normal equations of distances to tangent planes, with the share of paired points and their scatter."""
    away, near = model.surface.query(view.points, distance_upper_bound=reach)
    held = np.flatnonzero(np.isfinite(away))
    held = held[np.einsum("na,na->n", view.normals[held], model.parts.normals[near[held]]) > ALIKE]
    if len(held) < min(FEWEST, len(view.points)):
        return None
    points, normals = view.points[held], model.parts.normals[near[held]]
    distance = np.einsum("na,na->n", normals, model.parts.points[near[held]] - points)
    rows = np.concatenate([np.cross(points - centre, normals), normals], axis=1)
    scatter = _scatter(np.abs(distance), max(SURFACE_SCATTER * size, LOOSE * reach))
    weight = _weight(distance / scatter) / scatter**2
    return (rows * weight[:, None]).T @ np.column_stack([rows, distance]), len(held) / len(view.points), scatter


def _believed(surface: Float[np.ndarray, "6 7"], spread: float) -> Float[np.ndarray, "6 6"]:
    """The information of a surface less what mistaken normals alone would make of it, for points ``spread`` away."""
    unit = np.repeat([1 / spread, 1.0], 3)
    value, vector = np.linalg.eigh(unit[:, None] * surface[:, :6] * unit)
    # normals have length 1: the sum of their weights is the trace
    value = np.maximum(value - MISTAKEN**2 * np.trace(surface[3:, 3:6]), 0.0)
    return (vector * value) @ vector.T / unit[:, None] / unit


def _contours(
    model: Model, view: Parts, centre: Float[np.ndarray, "3"], reach: float, size: float
) -> tuple[Float[np.ndarray, "6 7"], int]:
    """Normal equations of the distances between contours, across the view's, and of how many pairs."""
    none = np.zeros((6, 7)), 0
    if model.contour is None or len(view.contours) == 0:
        return none
    away, near = model.contour.query(view.contours, distance_upper_bound=reach)
    held = np.flatnonzero(np.isfinite(away))
    if len(held) < NEIGHBOURS:
        return none
    points, tangents = view.contours[held], view.tangents[held]
    across = np.eye(3) - tangents[:, :, None] * tangents[:, None, :]
    distance = np.einsum("nab,nb->na", across, model.parts.contours[near[held]] - points)
    x, y, z = (points - centre).T
    zero = np.zeros_like(x)
    # a turn w moves a point by w x p
    turned = np.stack([[zero, z, -y], [-z, zero, x], [y, -x, zero]]).transpose(2, 0, 1)
    rows = across @ np.concatenate([turned, np.broadcast_to(np.eye(3), turned.shape)], axis=2)
    length = np.linalg.norm(distance, axis=1)
    scatter = _scatter(length, CONTOUR_SCATTER * size)
    weight = _weight(length / scatter) / scatter**2
    sides = np.concatenate([rows, distance[:, :, None]], axis=2)
    return np.einsum("n,nai,naj->ij", weight, rows, sides), len(held)


def _scatter(distance: Float[np.ndarray, " n"], least: float) -> float:
    """Standard deviation by the median of absolute distances."""
    return max(1.4826 * float(np.median(distance)), least)


def _weight(ratio: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return 1 / (1 + (ratio / SOFT) ** 2) ** 2


def _turned(step: Float[np.ndarray, "6"], centre: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """A turn about ``centre`` and a shift as a motion."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix()
    T[:3, 3] = centre - T[:3, :3] @ centre + step[3:]
    return T
