"""The next best view: exact scores over the whole view space, the best few improved, the best of all (thesis §4.3.2).

The thesis searches from a spiral by Levenberg-Marquardt and calls its result sub-optimal. Here the exact march is cheap
enough to score thousands of views first; the gradient of the soft utility and a shrinking pattern of exact scores then
improve the best few, and every candidate is scored exactly again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import Label
from jaxmodel.plan.ray_march import Seen, Space, look, ready
from jaxmodel.plan.utility import Utility
from jaxmodel.scan.sensor import Sensor

SHRINK = 0.5
TRIES = 16
"""Views tried around each of the best in a round."""


@dataclass(frozen=True)
class Search:
    """How hard to look, and under which constraints.

    ``views`` scored exactly over the whole space, ``spiral`` more along the thesis's spiral; ``rays`` a view;
    ``best`` views improved in ``rounds`` of a pattern that shrinks by half; ``gradient`` of them first by
    Levenberg-Marquardt. ``minimum_overlap``: part of a view's readings that must fall on what is known. ``travel``:
    utility lost for a way as long as the map.
    """

    views: int = 2000
    spiral: int = 64
    rays: int = 1024
    best: int = 8
    rounds: int = 6
    gradient: int = 3
    minimum_overlap: float = 0.3
    travel: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("views", 1), ("spiral", 0), ("rays", 1), ("best", 1), ("rounds", 0), ("gradient", 0)):
            if getattr(self, name) < least:
                raise InputError(f"search.{name}: expected at least {least}, got {getattr(self, name)}.")
        if not 0 <= self.minimum_overlap < 1:
            raise InputError(f"search.minimum_overlap: expected a share below 1, got {self.minimum_overlap}.")
        if not self.travel >= 0:
            raise InputError(f"search.travel: expected zero or more, got {self.travel}.")


class ViewOutcome(Enum):
    """What the search found; the value is a sentence."""

    FOUND = "the best view over the whole space"
    NO_REACHABLE_VIEW = "the view space has no view that the sensor can reach"
    NO_OVERLAP = "no reachable view overlaps enough with what is known; the one that overlaps most"
    NOTHING_NEW = "no reachable view meets anything unknown or hidden"


class View(NamedTuple):
    """The view to take next. NaN pose where there is none.

    ``parameter`` in the view space, ``utility`` of the view (travel not taken off), ``shares`` and ``quality`` by
    label, ``overlap`` part of its readings on what is known, ``novelty`` part of its rays on unknown voxels and
    occlusion planes, ``weights`` the utility it was chosen by, ``scored`` how many views were scored exactly.
    """

    outcome: ViewOutcome
    T_world_sensor: Float[np.ndarray, "4 4"]
    parameter: Float[np.ndarray, " d"]
    utility: float
    shares: Float[np.ndarray, "6"]
    quality: Float[np.ndarray, "6"]
    overlap: float
    novelty: float
    weights: Utility
    scored: int


class Scores(NamedTuple):
    """Exact scores of many views, by view: ``value`` is the utility less repeats and travel."""

    parameters: Float[np.ndarray, "n d"]
    poses: Float[np.ndarray, "n 4 4"]
    seen: Seen
    utility: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    overlap: Float[np.ndarray, " n"]
    novelty: Float[np.ndarray, " n"]

    def take(self, rows: np.ndarray) -> "Scores":
        """Some of the views."""
        seen = self.seen.take(rows)
        rest = (self.utility, self.value, self.overlap, self.novelty)
        return Scores(self.parameters[rows], self.poses[rows], seen, *(array[rows] for array in rest))


class Scorer(NamedTuple):
    """Everything that a view's exact score depends on."""

    map: LabelMap
    space: Space
    sensor: Sensor
    views: Any
    weights: Utility
    travel: float
    eye: Float[np.ndarray, "3"] | None
    taken: tuple[Float[np.ndarray, "4 4"], ...]

    def __call__(self, parameters: Float[np.ndarray, "n d"]) -> Scores:
        """Scores of those of ``parameters`` that the view space allows."""
        poses = self.views.poses(parameters)
        allowed = np.asarray(self.views.allowed(poses))
        parameters, poses = parameters[allowed], poses[allowed]
        return self.scored(parameters, poses, look(self.map, poses, self.sensor, space=self.space))

    def scored(self, parameters, poses, seen: Seen) -> Scores:
        """The scores that follow from what is seen."""
        shares, quality, promise = (np.asarray(of, np.float32) for of in (seen.shares, seen.quality, seen.promising))
        utility = np.asarray(self.weights(shares, quality, promise))
        met = np.maximum(seen.counts.sum(axis=1), 1)
        overlap = (seen.counts[:, Label.OCCUPIED] + seen.counts[:, Label.BORDER]) / met
        novelty = (seen.counts[:, Label.UNKNOWN] + seen.counts[:, Label.OCCLUSION_PLANE]) / seen.total
        value = utility
        if len(self.taken):
            value = value - float(self.weights.repeat) * self.views.likeness(poses, self.taken)
        if self.travel > 0 and self.eye is not None:
            extent = self.map.grid.cell * max(self.map.grid.shape)
            value = value - self.travel * np.linalg.norm(poses[:, :3, 3] - self.eye, axis=1) / extent
        return Scores(parameters, poses, seen, utility, value, overlap, novelty)


def next_view(
    map: LabelMap,
    sensor: Sensor,
    space: Any,
    search: Search = Search(),
    weights: Utility = Utility(),
    current: Float[np.ndarray, "4 4"] | None = None,
    taken: Sequence[Float[np.ndarray, "4 4"]] = (),
) -> View:
    """The best view of a :class:`jaxmodel.plan.viewpoints.ViewSpace` for a map and a sensor.

    ``current`` pose ``T_world_sensor``, for travel; ``taken``: poses so far, not to be repeated. No reachable view,
    nothing left to see or too little overlap are outcomes, not errors.
    """
    eye = None if current is None else np.asarray(current, np.float64)[:3, 3]
    seen_by = planning_sensor(sensor, search.rays)
    scorer = Scorer(map, ready(map), seen_by, space, weights, search.travel, eye, tuple(taken))
    parts = [space.spread(search.views, search.seed)]
    if search.spiral:
        parts.append(space.spiral(search.spiral))
    found = scorer(np.concatenate(parts))
    if len(found.value) == 0:
        return _none(ViewOutcome.NO_REACHABLE_VIEW, space.dimension, weights)
    weights = weights.attainable(found.seen.shares)
    scorer = scorer._replace(weights=weights)
    found = scorer.scored(found.parameters, found.poses, found.seen)
    count = len(found.value)
    if found.novelty.max() <= 0:
        best = int(np.argmax(found.value))
        return _view(ViewOutcome.NOTHING_NEW, found.take(np.array([best])), weights, count)
    able = found.overlap >= search.minimum_overlap
    if map.views and not able.any():
        best = int(np.argmax(found.overlap))
        return _view(ViewOutcome.NO_OVERLAP, found.take(np.array([best])), weights, count)
    least = search.minimum_overlap if map.views else 0.0
    few = found.take(leaders(found, search.best, space.spacing(search.views), least))
    few, more = refined(scorer, few, search, least)
    best = int(np.argmax(np.where(few.overlap >= least, few.value, -np.inf)))
    return _view(ViewOutcome.FOUND, few.take(np.array([best])), weights, count + more)


def utility_field(
    map: LabelMap, sensor: Sensor, space: Any, weights: Utility, views: int = 20_000, rays: int = 1024, seed: int = 0
) -> Scores:
    """Exact utility over the whole view space as a map of ``views`` views, those allowed."""
    scorer = Scorer(map, ready(map), planning_sensor(sensor, rays), space, weights, 0.0, None, ())
    return scorer(space.spread(views, seed))


def planning_sensor(sensor: Sensor, rays: int) -> Sensor:
    """``sensor`` with the same view and about ``rays`` pixels in all, for planning; never more than it has."""
    scale = min(1.0, np.sqrt(rays / (sensor.width * sensor.height)))
    return replace(sensor, width=max(1, round(sensor.width * scale)), height=max(1, round(sensor.height * scale)))


def leaders(scores: Scores, count: int, apart: Float[np.ndarray, " d"], least_overlap: float) -> Any:
    """Rows of the best views that overlap enough, no two of them closer than twice the field's spacing."""
    order = np.argsort(-np.where(scores.overlap >= least_overlap, scores.value, -np.inf), kind="stable")
    order = order[: int(np.sum(scores.overlap >= least_overlap))][: 40 * count]
    chosen: list[int] = []
    poses = scores.poses
    reach = 2 * float(apart[-1])
    for row in order:
        turn = [float(poses[row, :3, 2] @ poses[other, :3, 2]) for other in chosen]
        way = [float(np.linalg.norm(poses[row, :3, 3] - poses[other, :3, 3])) for other in chosen]
        size = float(np.ptp(poses[:, :3, 3], axis=0).max())
        near = [c > np.cos(reach) and w <= reach / 2 * max(size, 1e-300) for c, w in zip(turn, way, strict=True)]
        if not any(near):
            chosen.append(int(row))
        if len(chosen) == count:
            break
    return np.array(chosen, np.int64)


def refined(scorer: Scorer, few: Scores, search: Search, least_overlap: float) -> tuple[Scores, int]:
    """Each of a few views moved to the best of a shrinking pattern around it, and how many scores that took."""
    random = np.random.default_rng(search.seed + 1)
    scale = scorer.views.spacing(search.views)
    scored = 0
    for _ in range(search.rounds):
        step = random.normal(size=(len(few.value), TRIES, len(scale))) * scale
        tried = scorer((few.parameters[:, None] + step).reshape(-1, len(scale)))
        scored += len(tried.value)
        few = _better(few, tried, least_overlap)
        scale = scale * SHRINK
    return few, scored


def _better(few: Scores, tried: Scores, least_overlap: float) -> Scores:
    """The best of the views known and tried, as many as were known, all of them distinct."""
    both = joined(few, tried)
    worth = np.where(both.overlap >= least_overlap, both.value, -np.inf)
    return both.take(np.argsort(-worth, kind="stable")[: len(few.value)])


def joined(one: Scores, two: Scores) -> Scores:
    """The views of both."""
    seen = one.seen.joined(two.seen)
    rest = [
        np.concatenate([getattr(one, name), getattr(two, name)]) for name in ("utility", "value", "overlap", "novelty")
    ]
    return Scores(np.concatenate([one.parameters, two.parameters]), np.concatenate([one.poses, two.poses]), seen, *rest)


def _view(outcome: ViewOutcome, one: Scores, weights: Utility, scored: int) -> View:
    return View(
        outcome,
        one.poses[0],
        one.parameters[0],
        float(one.utility[0]),
        one.seen.shares[0],
        one.seen.quality[0],
        float(one.overlap[0]),
        float(one.novelty[0]),
        weights,
        scored,
    )


def _none(outcome: ViewOutcome, dimension: int, weights: Utility) -> View:
    nothing = np.full(6, np.nan)
    return View(
        outcome,
        np.full((4, 4), np.nan),
        np.full(dimension, np.nan),
        np.nan,
        nothing,
        nothing,
        np.nan,
        np.nan,
        weights,
        0,
    )
