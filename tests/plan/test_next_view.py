"""The search for the next best view, against the exhaustive field; its constraints and its outcomes."""

from typing import Any

import equinox as eqx
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.plan.label_map import object_map
from jaxmodel.plan.next_view import Search, ViewOutcome, next_view, utility_field
from jaxmodel.plan.ray_march import look, ready
from jaxmodel.plan.utility import THESIS, Utility
from jaxmodel.plan.view_scores import Scorer, planning_sensor
from jaxmodel.plan.viewpoints import Circle, Restricted
from jaxmodel.scan.sensor import Sensor

FREE = Search(rays=256, fine=256, minimum_overlap=0.0)
ONCE = Utility(repeat=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("views", [0, 1, 2])
def test_the_optimum_is_that_of_the_exhaustive_field(valve: Any, views: int) -> None:
    view = next_view(valve.maps[views], valve.sensor, valve.sphere, FREE, ONCE)
    field = utility_field(valve.maps[views], valve.sensor, valve.sphere, view.weights, 20_000, 256)
    assert view.utility >= 0.99 * field.utility.max()


@pytest.mark.slow
@pytest.mark.parametrize("least", [0.0, 0.3])
def test_climbs_are_scored_exactly_and_never_cost_anything(valve: Any, least: float) -> None:
    plain, climbing = (
        Search(views=300, rays=256, fine=256, best=3, rounds=0, gradient=gradient, minimum_overlap=least)
        for gradient in (0, 3)
    )
    for map in valve.maps[1:]:
        without, found = (next_view(map, valve.sensor, valve.sphere, search, ONCE) for search in (plain, climbing))
        assert found.utility >= without.utility and found.overlap >= least
        assert found.scored == without.scored + 3
        again = look(map, found.T_world_sensor[None], planning_sensor(valve.sensor, 256))
        np.testing.assert_allclose(again.shares[0], found.shares)


def test_fixed_weights_are_kept_and_scheduled_ones_follow_the_map(valve: Any) -> None:
    kept = next_view(valve.maps[1], valve.sensor, valve.sphere, FREE, THESIS)
    assert kept.weights == THESIS
    found = next_view(valve.maps[1], valve.sensor, valve.sphere, FREE, ONCE)
    field = utility_field(valve.maps[1], valve.sensor, valve.sphere, THESIS, FREE.views, FREE.rays, FREE.seed)
    assert float(found.weights.unknown) == pytest.approx(min(1.5 * field.novelty.max(), 0.999), rel=0.02)
    assert found.weights.unknown == found.weights.occlusion_plane and found.weights.occupied <= 0.2


def test_runs_agree_and_the_seed_matters_little(valve: Any) -> None:
    one, again, other = (
        next_view(valve.maps[2], valve.sensor, valve.sphere, Search(rays=256, fine=256, seed=seed), Utility())
        for seed in (0, 0, 5)
    )
    np.testing.assert_array_equal(one.T_world_sensor, again.T_world_sensor)
    assert one.utility == again.utility
    assert other.utility == pytest.approx(one.utility, rel=0.1)


def test_a_view_keeps_the_least_overlap(valve: Any) -> None:
    overlaps = []
    for least in (0.0, 0.3, 0.6):
        view = next_view(valve.maps[1], valve.sensor, valve.sphere, Search(rays=256, fine=256, minimum_overlap=least))
        assert view.outcome is ViewOutcome.FOUND and view.overlap >= least
        overlaps.append(view.novelty)
    assert overlaps[0] > overlaps[1] > overlaps[2]


def test_views_taken_are_not_repeated(valve: Any) -> None:
    """With nothing else to tell views apart, the farthest is taken."""
    weights = Utility(repeat=100.0)
    view = next_view(valve.maps[1], valve.sensor, valve.sphere, FREE, weights, valve.taken[0], valve.taken[:1])
    assert view.T_world_sensor[:3, 2] @ valve.taken[0][:3, 2] < -0.95


def test_travel_keeps_the_sensor_near(valve: Any) -> None:
    here = valve.taken[0]
    far = next_view(valve.maps[1], valve.sensor, valve.sphere, FREE, ONCE, here)
    near = next_view(
        valve.maps[1],
        valve.sensor,
        valve.sphere,
        Search(rays=256, fine=256, minimum_overlap=0.0, travel=50.0),
        ONCE,
        here,
    )
    way = [np.linalg.norm(view.T_world_sensor[:3, 3] - here[:3, 3]) for view in (near, far)]
    assert way[0] < 0.2 * way[1]


def test_only_permitted_views_are_taken(valve: Any) -> None:
    upper = Restricted(valve.sphere, lambda poses: poses[:, 2, 3] > 0.5)
    view = next_view(valve.maps[1], valve.sensor, upper, FREE)
    assert view.T_world_sensor[2, 3] > 0.5
    nowhere = Restricted(valve.sphere, lambda poses: np.zeros(len(poses), bool))
    none = next_view(valve.maps[1], valve.sensor, nowhere, FREE)
    assert none.outcome is ViewOutcome.NO_REACHABLE_VIEW and np.isnan(none.T_world_sensor).all() and none.scored == 0


def test_a_circle_is_a_view_space_too(valve: Any) -> None:
    axis = np.array([0.0, 0.0, 1.0])
    circle = Circle(valve.sphere.centre, valve.sphere.radius, axis, 60.0)
    view = next_view(valve.maps[1], valve.sensor, circle, FREE, ONCE)
    away = (view.T_world_sensor[:3, 3] - valve.sphere.centre) / valve.sphere.radius
    assert away @ axis == pytest.approx(0.5, abs=1e-5) and view.outcome is ViewOutcome.FOUND


def test_nothing_new_and_no_overlap_are_outcomes(valve: Any) -> None:
    known = object_map(valve.sphere.centre, valve.size, 32)
    known = eqx.tree_at(lambda m: m.crossed, known, np.ones_like(known.crossed))
    assert next_view(known, valve.sensor, valve.sphere, FREE).outcome is ViewOutcome.NOTHING_NEW
    tight = Search(rays=256, fine=256, minimum_overlap=0.999)
    assert next_view(valve.maps[1], valve.sensor, valve.sphere, tight).outcome is ViewOutcome.NO_OVERLAP


def test_a_view_with_next_to_nothing_new_is_told(valve: Any) -> None:
    view = next_view(valve.maps[1], valve.sensor, valve.sphere, FREE)
    few = Search(rays=256, fine=256, minimum_overlap=0.0, least_novelty=view.novelty + 0.01)
    little = next_view(valve.maps[1], valve.sensor, valve.sphere, few)
    assert view.outcome is ViewOutcome.FOUND and little.outcome is ViewOutcome.LITTLE_NEW
    np.testing.assert_array_equal(view.T_world_sensor, little.T_world_sensor)


def test_views_chosen_with_few_rays_are_scored_again_with_more(valve: Any) -> None:
    coarse = Search(rays=64, fine=64, minimum_overlap=0.2)
    fine = Search(rays=64, fine=3600, minimum_overlap=0.2)
    judge = Scorer(valve.maps[2], ready(valve.maps[2]), valve.sensor, valve.sphere, ONCE, 0.0, None, ())
    few, many = (next_view(valve.maps[2], valve.sensor, valve.sphere, search, ONCE) for search in (coarse, fine))
    worth = judge._replace(weights=many.weights)(np.stack([few.parameter, many.parameter]))
    assert worth.value[1] > worth.value[0] and many.novelty == pytest.approx(float(worth.novelty[1]))
    assert (worth.overlap[1] >= 0.2) and many.scored > few.scored


def test_nominal_shares_follow_the_views_that_may_be_taken(valve: Any) -> None:
    scorer = Scorer(valve.maps[1], ready(valve.maps[1]), valve.sensor, valve.sphere, Utility(), 0.0, None, ())
    found = scorer(valve.sphere.spread(300))
    able = found.overlap >= 0.5
    held, scores = scorer.attaining(found, 0.5)
    assert float(held.weights.unknown) == pytest.approx(min(1.5 * found.novelty[able].max(), 0.999), rel=1e-5)
    assert found.novelty.max() > 1.1 * found.novelty[able].max()
    np.testing.assert_array_equal(scores.utility, held(found.parameters).utility)
    raised = held.weights.raised(found.seen.shares)
    assert (
        float(raised.unknown)
        == float(raised.occlusion_plane)
        == pytest.approx(min(1.5 * found.novelty.max(), 0.999), rel=1e-5)
    )
    assert held.weights.raised(found.seen.shares[able]) is held.weights
    assert THESIS.raised(found.seen.shares) is THESIS


def test_a_sensor_that_reaches_nothing_sees_nothing_new(valve: Any) -> None:
    short = Sensor(60, 60, field_of_view_deg=40.0, maximum_range=0.1 * valve.size)
    assert next_view(valve.maps[0], short, valve.sphere, FREE).outcome is ViewOutcome.NOTHING_NEW


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"views": 0}, "search.views"),
        ({"rays": 0}, "search.rays"),
        ({"best": 0}, "search.best"),
        ({"minimum_overlap": 1.0}, "search.minimum_overlap"),
        ({"minimum_overlap": float("nan")}, "search.minimum_overlap"),
        ({"fine": 0}, "search.fine"),
        ({"shortlist": 0}, "search.shortlist"),
        ({"least_novelty": 1.0}, "search.least_novelty"),
        ({"travel": -1.0}, "search.travel"),
    ],
)
def test_a_search_that_makes_no_sense(bad: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Search(**bad)
