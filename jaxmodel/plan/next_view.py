"""The next best view: exact scores over the whole view space, the best few improved, the best of all (thesis §4.3.2).

The thesis searches from a spiral by Levenberg-Marquardt and calls its result sub-optimal. Here the exact march is cheap
enough to score thousands of views first; a shrinking pattern of exact scores then improves the best few, after the
gradient of the soft utility where that is asked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.ray_march import ready
from jaxmodel.plan.utility import Utility
from jaxmodel.plan.view_climb import climbed
from jaxmodel.plan.view_scores import Scorer, Scores, joined, leaders, planning_sensor
from jaxmodel.scan.sensor import Sensor

SHRINK = 0.5
TRIES = 16
"""Views tried around each of the best in a round."""
FEWEST = 4
"""Views that a pattern goes on with at least."""


@dataclass(frozen=True)
class Search:
    """How hard to look, and under which constraints.

    ``views`` scored exactly over the whole space, ``spiral`` more along the thesis's spiral, ``rays`` a view. The best
    ``shortlist`` of them are scored again with ``fine`` rays: late in a task few rays of a view meet anything new, and
    with few rays the best of many is the luckiest. The ``best`` of those are improved in ``rounds`` of a pattern that
    shrinks by half, ``gradient`` of them first by Levenberg-Marquardt on the soft utility: none by default, as it adds
    nothing that the pattern does not find (``jaxmodel run next_view_search``). ``minimum_overlap``: part of a view's
    readings that must fall on what is known. ``least_novelty``: part of its rays that must meet something new, else the
    outcome is ``LITTLE_NEW``. ``travel``: utility lost for a way as long as the map.
    """

    views: int = 4000
    spiral: int = 64
    rays: int = 1024
    shortlist: int = 512
    fine: int = 4096
    best: int = 16
    rounds: int = 7
    gradient: int = 0
    minimum_overlap: float = 0.3
    least_novelty: float = 0.001
    travel: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        least_of = {
            "views": 1,
            "spiral": 0,
            "rays": 1,
            "shortlist": 1,
            "fine": 1,
            "best": 1,
            "rounds": 0,
            "gradient": 0,
        }
        for name, least in least_of.items():
            if getattr(self, name) < least:
                raise InputError(f"search.{name}: expected at least {least}, got {getattr(self, name)}.")
        for name in ("minimum_overlap", "least_novelty"):
            if not 0 <= getattr(self, name) < 1:
                raise InputError(f"search.{name}: expected a share below 1, got {getattr(self, name)}.")
        if not self.travel >= 0:
            raise InputError(f"search.travel: expected zero or more, got {self.travel}.")


class ViewOutcome(Enum):
    """What the search found; the value is a sentence."""

    FOUND = "the best view over the whole space"
    NO_REACHABLE_VIEW = "the view space has no view that the sensor can reach"
    NO_OVERLAP = "no reachable view overlaps enough with what is known; the one that overlaps most"
    NOTHING_NEW = "no reachable view meets anything unknown or hidden"
    LITTLE_NEW = "the best reachable view meets almost nothing unknown or hidden"


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
        return no_view(ViewOutcome.NO_REACHABLE_VIEW, space.dimension, weights)
    least = search.minimum_overlap if map.views else 0.0
    scorer, found = scorer.attaining(found, least)
    count = len(found.value)
    if found.novelty.max() <= 0:
        best = int(np.argmax(found.value))
        return view_of(ViewOutcome.NOTHING_NEW, found.take(np.array([best])), scorer.weights, count)
    if not (found.overlap >= least).any():
        best = int(np.argmax(found.overlap))
        return view_of(ViewOutcome.NO_OVERLAP, found.take(np.array([best])), scorer.weights, count)
    coarse = found
    scorer, found = shortlisted(scorer, coarse, planning_sensor(sensor, search.fine), search.shortlist, least)
    count += 0 if found is coarse else len(found.value)
    few = found.take(leaders(found, search.best, space.spacing(search.views), least))
    if search.gradient:
        ends = climbed(scorer, few.take(np.arange(min(search.gradient, len(few.value)))), least)
        few, count = joined(few, ends), count + len(ends.value)
    scorer, few, more = refined(scorer, few, search, least)
    best = int(np.argmax(np.where(few.overlap >= least, few.value, -np.inf)))
    outcome = ViewOutcome.FOUND if few.novelty[best] >= search.least_novelty else ViewOutcome.LITTLE_NEW
    return view_of(outcome, few.take(np.array([best])), scorer.weights, count + more)


def utility_field(
    map: LabelMap, sensor: Sensor, space: Any, weights: Utility, views: int = 20_000, rays: int = 1024, seed: int = 0
) -> Scores:
    """Exact utility over the whole view space as a map of ``views`` views, those allowed."""
    scorer = Scorer(map, ready(map), planning_sensor(sensor, rays), space, weights, 0.0, None, ())
    return scorer(space.spread(views, seed))


def shortlisted(
    scorer: Scorer, found: Scores, sensor: Sensor, count: int, least_overlap: float
) -> tuple[Scorer, Scores]:
    """The best ``count`` views scored again through ``sensor``, and the scorer that did, its nominal shares theirs.

    Both as they were where ``sensor`` is the scorer's, or where its rays meet nothing new, or overlap too little.
    """
    if sensor == scorer.sensor:
        return scorer, found
    worth = np.where(found.overlap >= least_overlap, found.value, -np.inf)
    top = np.argsort(-worth, kind="stable")[: min(count, int(np.sum(found.overlap >= least_overlap)))]
    finer = scorer._replace(sensor=sensor)
    again = finer(found.parameters[top])
    if again.novelty.max() <= 0 or again.overlap.max() < least_overlap:
        return scorer, found
    return finer.attaining(again, least_overlap)


def refined(scorer: Scorer, few: Scores, search: Search, least_overlap: float) -> tuple[Scorer, Scores, int]:
    """Each of a few views moved to the best of a shrinking pattern around it, and how many scores that took.

    Those that fall behind are left out, a third in each round, down to ``FEWEST``. The nominal shares of the scorer
    rise where a view meets more than was thought to be attainable: else more would count for nothing.
    """
    random = np.random.default_rng(search.seed + 1)
    scale = scorer.views.spacing(search.views)
    scored = 0
    for _ in range(search.rounds):
        step = random.normal(size=(len(few.value), TRIES, len(scale))) * scale
        tried = scorer((few.parameters[:, None] + step).reshape(-1, len(scale)))
        scored += len(tried.value)
        both = joined(few, tried)
        able = both.overlap >= least_overlap
        scorer = scorer._replace(weights=scorer.weights.raised(both.seen.shares[able]))
        both = scorer.scored(both.parameters, both.poses, both.seen)
        order = np.argsort(-np.where(able, both.value, -np.inf), kind="stable")
        few = both.take(order[: max(FEWEST, len(few.value) * 2 // 3)])
        scale = scale * SHRINK
    return scorer, few, scored


def view_of(outcome: ViewOutcome, one: Scores, weights: Utility, scored: int) -> View:
    """The first of ``one``."""
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


def no_view(outcome: ViewOutcome, dimension: int, weights: Utility) -> View:
    """Nowhere to look from."""
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
