"""Choices of views that use no utility: what a planner is measured against, under the same constraints.

Random views, views as far as possible from those taken, and the area factor, which looks where most of the unseen is.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.next_view import Search, View, ViewOutcome, no_view, view_of
from jaxmodel.plan.ray_march import ready
from jaxmodel.plan.utility import Utility
from jaxmodel.plan.view_scores import Scorer, planning_sensor
from jaxmodel.scan.sensor import Sensor

BASELINES = ("random", "uniform", "area_factor")


def baseline_view(
    kind: str,
    map: LabelMap,
    sensor: Sensor,
    space: Any,
    taken: Sequence[Float[np.ndarray, "4 4"]],
    search: Search = Search(),
) -> View:
    """The next view without a utility, among as many candidates as :func:`next_view` scores first.

    ``random``: any; ``uniform``: the one whose direction is farthest from those of all poses ``taken``
    (T_world_sensor), which spreads any number of views evenly (farthest first: Gonzalez, Theoretical Computer Science
    38, 1985); ``area_factor``: most rays on unknown voxels and occlusion planes, whatever their angle (the visibility
    criterion of Massios and Fisher, BMVC 1998). All are held to ``search.minimum_overlap``.
    """
    if kind not in BASELINES:
        raise InputError(f"There is no planner {kind!r}; there are {', '.join(BASELINES)}.")
    scorer = Scorer(map, ready(map), planning_sensor(sensor, search.rays), space, Utility(), 0.0, None, ())
    found = scorer(space.spread(search.views, search.seed))
    if len(found.value) == 0:
        return no_view(ViewOutcome.NO_REACHABLE_VIEW, space.dimension, Utility())
    able = (found.overlap >= search.minimum_overlap) | (map.views == 0)
    if kind == "area_factor" and able.any():
        # as many rays as the utility's views are chosen with: with few, the best of many is the luckiest
        best = np.argsort(-np.where(able, found.novelty, -1.0), kind="stable")[: search.shortlist]
        found = scorer._replace(sensor=planning_sensor(sensor, search.fine))(found.parameters[best])
    if kind == "random":
        worth = np.random.default_rng(search.seed).random(len(found.value))
    elif kind == "area_factor":
        worth = found.novelty
    else:
        forward = np.array([T[:3, 2] for T in taken]).reshape(-1, 3)
        worth = -np.max(found.poses[:, :3, 2] @ forward.T, axis=1, initial=-1.0)
    able = found.overlap >= search.minimum_overlap
    outcome = ViewOutcome.FOUND
    if found.novelty.max() <= 0:
        outcome = ViewOutcome.NOTHING_NEW
    elif map.views and not able.any():
        outcome, worth, able = ViewOutcome.NO_OVERLAP, found.overlap, np.ones_like(able)
    row = int(np.argmax(np.where(able | (map.views == 0), worth, -np.inf)))
    return view_of(outcome, found.take(np.array([row])), Utility(), len(found.value))
