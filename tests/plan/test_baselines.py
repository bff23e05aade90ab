"""Choices without a utility: what each of them is the best in, and the constraint all are held to."""

from typing import Any

import equinox as eqx
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.plan.baselines import baseline_view
from jaxmodel.plan.label_map import object_map
from jaxmodel.plan.next_view import Search, ViewOutcome
from jaxmodel.plan.ray_march import look
from jaxmodel.plan.utility import Utility
from jaxmodel.plan.view_scores import planning_sensor
from jaxmodel.plan.viewpoints import Restricted

SEARCH = Search(views=200, rays=256)
KNOWN, NEW = [2, 5], [0, 4]


def scored(valve: Any, map: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses, overlap and novelty of the candidates, counted by the march itself."""
    poses = valve.sphere.poses(valve.sphere.spread(SEARCH.views, SEARCH.seed))
    counts = look(map, poses, planning_sensor(valve.sensor, SEARCH.rays)).counts
    return poses, counts[:, KNOWN].sum(axis=1) / np.maximum(counts.sum(axis=1), 1), counts[:, NEW].sum(axis=1)


def test_the_area_factor_takes_the_most_of_the_unseen_that_overlaps(valve: Any) -> None:
    poses, overlap, new = scored(valve, valve.maps[1])
    view = baseline_view("area_factor", valve.maps[1], valve.sensor, valve.sphere, valve.taken[:1], SEARCH)
    able = overlap >= SEARCH.minimum_overlap
    best = int(np.argmax(np.where(able, new, -1)))
    np.testing.assert_array_equal(view.T_world_sensor, poses[best])
    assert view.outcome is ViewOutcome.FOUND and view.overlap >= 0.3
    # unconstrained it may take more, and here it does
    unheld = Search(200, rays=256, minimum_overlap=0.0)
    free = baseline_view("area_factor", valve.maps[1], valve.sensor, valve.sphere, (), unheld)
    assert free.novelty > view.novelty


def test_uniform_views_are_as_far_as_possible_from_those_taken(valve: Any) -> None:
    poses, overlap, _ = scored(valve, valve.maps[2])
    view = baseline_view("uniform", valve.maps[2], valve.sensor, valve.sphere, valve.taken, SEARCH)
    like = np.max(poses[:, :3, 2] @ np.stack(valve.taken)[:, :3, 2].T, axis=1)
    assert view.T_world_sensor[:3, 2] @ valve.taken[0][:3, 2] <= like[overlap >= 0.3].min() + 1e-9


def test_random_views_overlap_and_follow_their_seed(valve: Any) -> None:
    views = [
        baseline_view("random", valve.maps[1], valve.sensor, valve.sphere, (), Search(200, rays=256, seed=seed))
        for seed in (1, 1, 2, 3, 4)
    ]
    np.testing.assert_array_equal(views[0].T_world_sensor, views[1].T_world_sensor)
    assert len({view.T_world_sensor.tobytes() for view in views}) > 2
    assert all(view.overlap >= 0.3 for view in views)


def test_no_overlap_and_no_view_are_outcomes(valve: Any) -> None:
    tight = Search(200, rays=256, minimum_overlap=0.999)
    _, overlap, _ = scored(valve, valve.maps[1])
    view = baseline_view("area_factor", valve.maps[1], valve.sensor, valve.sphere, (), tight)
    assert view.outcome is ViewOutcome.NO_OVERLAP and view.overlap == overlap.max()
    nowhere = Restricted(valve.sphere, lambda poses: np.zeros(len(poses), bool))
    none = baseline_view("uniform", valve.maps[1], valve.sensor, nowhere, valve.taken, SEARCH)
    assert none.outcome is ViewOutcome.NO_REACHABLE_VIEW and np.isnan(none.T_world_sensor).all()


def test_nothing_new_ends_every_planner(valve: Any) -> None:
    """A map without an unknown voxel."""
    empty = object_map(np.zeros(3), valve.size, 32)
    empty = eqx.tree_at(lambda m: m.crossed, empty, np.ones_like(empty.crossed))
    for kind in ("random", "uniform", "area_factor"):
        assert baseline_view(kind, empty, valve.sensor, valve.sphere, (), SEARCH).outcome is ViewOutcome.NOTHING_NEW


def test_an_unknown_planner_is_named(valve: Any) -> None:
    with pytest.raises(InputError, match="no planner 'best'"):
        baseline_view("best", valve.maps[0], valve.sensor, valve.sphere, (), SEARCH)


def test_the_weights_that_a_choice_reports_are_the_default(valve: Any) -> None:
    view = baseline_view("random", valve.maps[0], valve.sensor, valve.sphere, (), SEARCH)
    assert view.weights == Utility()
