"""The earlier method (thesis §4.3.2): views at four positions, where the sensor stands and at three drawn by chance."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxmodel.plan.free_space import ORIENTATIONS, FreeSpace
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.next_view import Search, View, ViewOutcome, no_view, view_of
from jaxmodel.plan.ray_march import ready
from jaxmodel.plan.utility import Utility
from jaxmodel.plan.view_scores import Scorer, Scores, joined, planning_sensor
from jaxmodel.plan.viewpoints import even_directions
from jaxmodel.scan.sensor import Sensor

POSITIONS = 4
MOST_STEPS = 20


def hill_climbing(
    map: LabelMap,
    sensor: Sensor,
    space: Any,
    current: Float[np.ndarray, "4 4"],
    search: Search = Search(),
    weights: Utility = Utility(),
    taken: Sequence[Float[np.ndarray, "4 4"]] = (),
) -> View:
    """The best of ``POSITIONS`` places with ``ORIENTATIONS`` views each, by exact utility.

    In free space these are the views of Sanchiz and Fisher as the thesis tells them: all orientations at the current
    place and at three others. Where a view has no orientation of its own, as on a sphere, they are the views around
    four places, and each place moves to its best one until none is better. The least overlap of ``search`` holds;
    ``taken`` are poses not to be repeated.
    """
    scorer = Scorer(map, ready(map), planning_sensor(sensor, search.fine), space, weights, 0.0, None, tuple(taken))
    random = np.random.default_rng(search.seed)
    if isinstance(space, FreeSpace):
        drawn = space.spread(ORIENTATIONS * (POSITIONS - 1), search.seed)
        angles = even_directions(ORIENTATIONS, search.seed)
        here = np.repeat(space.place_of(current[None, :3, 3]), ORIENTATIONS, axis=0)
        found = scorer(np.concatenate([np.concatenate([here, angles], axis=1), drawn]))
        return _best(found, map, space, search, weights, len(found.value))
    starts = space.spread(1000, search.seed)
    nearest = np.argmax(space.poses(starts)[:, :3, 2] @ current[:3, 2])
    rows = np.concatenate([[nearest], random.choice(len(starts), POSITIONS - 1, replace=False)])
    top = scorer(starts[rows])
    count = len(top.value)
    if count == 0:
        return no_view(ViewOutcome.NO_REACHABLE_VIEW, space.dimension, weights)
    least = search.minimum_overlap if map.views else 0.0
    for _ in range(MOST_STEPS):
        around = space.spacing(POSITIONS * ORIENTATIONS) * random.normal(size=(ORIENTATIONS, space.dimension))
        tried = scorer((top.parameters[:, None] + around).reshape(-1, space.dimension))
        count += len(tried.value)
        better = _first(joined(top, tried), len(top.value), least)
        if _worth(better, least).max() <= _worth(top, least).max():
            break
        top = better
    return _best(joined(top, tried), map, space, search, weights, count)


def _worth(found: Scores, least_overlap: float) -> Float[np.ndarray, " n"]:
    """What views are worth; where one overlaps too little, less than any other, by what it lacks."""
    lacking = np.maximum(least_overlap - found.overlap, 0)
    return np.where(lacking > 0, -1e3 - lacking, found.value)


def _first(found: Scores, count: int, least_overlap: float) -> Scores:
    return found.take(np.argsort(-_worth(found, least_overlap), kind="stable")[:count])


def _best(found: Scores, map: LabelMap, space: Any, search: Search, weights: Utility, count: int) -> View:
    if len(found.value) == 0:
        return no_view(ViewOutcome.NO_REACHABLE_VIEW, space.dimension, weights)
    able = found.overlap >= search.minimum_overlap
    if map.views and not able.any():
        row = int(np.argmax(found.overlap))
        return view_of(ViewOutcome.NO_OVERLAP, found.take(np.array([row])), weights, count)
    row = int(np.argmax(np.where(able | (map.views == 0), found.value, -np.inf)))
    outcome = ViewOutcome.FOUND if found.novelty.max() > 0 else ViewOutcome.NOTHING_NEW
    return view_of(outcome, found.take(np.array([row])), weights, count)
