"""The closed loop: what it keeps, when it stops, what it does when views cannot be placed."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.plan.explore import FAILURES, Ending, Loop, Placed, Step, explore, label_shares
from jaxmodel.plan.labels import Label
from jaxmodel.plan.map_update import update
from jaxmodel.plan.next_view import Search, View, ViewOutcome
from jaxmodel.plan.viewpoints import Restricted

SEARCH = Search(views=150, spiral=10, rays=256, best=2, rounds=1)


def steps(valve: Any, loop: Loop, space: Any = None, search: Search = SEARCH, **rest: Any) -> Iterator[Step]:
    views = valve.sphere if space is None else space
    return explore(valve.scan, valve.maps[0], valve.sensor, lambda map, T: views, valve.taken[0], loop, search, **rest)


@pytest.fixture(scope="module")
def run(valve: Any) -> list[Step]:
    return list(steps(valve, Loop(views=5)))


def test_each_view_is_the_one_planned_before_it_and_adds_to_the_map(valve: Any, run: list[Step]) -> None:
    assert [step.number for step in run] == list(range(5))
    assert run[0].planned is None and run[-1].ending is Ending.VIEWS_USED
    map = valve.maps[0]
    for step in run:
        if step.planned is not None:
            np.testing.assert_array_equal(step.T_world_sensor, step.planned.T_world_sensor)
            assert step.planned.overlap >= SEARCH.minimum_overlap
        map = update(map, step.image, step.T_world_sensor, valve.sensor)
        np.testing.assert_array_equal(step.map.labels, map.labels)
    unknown = [step.map.share(Label.UNKNOWN) for step in run]
    assert unknown[1] < unknown[0] and (np.diff(unknown) <= 0).all()
    assert sum(label_shares(run[-1].map).values()) == pytest.approx(1)


def test_runs_agree(valve: Any, run: list[Step]) -> None:
    again = list(steps(valve, Loop(views=5)))
    for one, other in zip(run, again, strict=True):
        np.testing.assert_array_equal(one.T_world_sensor, other.T_world_sensor)
        np.testing.assert_array_equal(one.map.labels, other.map.labels)


def test_two_views_of_little_gain_end_it(valve: Any) -> None:
    """From one place, over and over."""
    here = Restricted(valve.sphere, lambda poses: poses[:, :3, 2] @ valve.taken[0][:3, 2] > 0.98)
    found = list(steps(valve, Loop(views=9, least_gain=0.2), here))
    assert found[-1].ending is Ending.LITTLE_GAIN
    assert max(step.gain for step in found[-2:]) < 0.2 and all(step.ending is Ending.GOES_ON for step in found[:-1])


def test_next_to_nothing_new_ends_it(valve: Any) -> None:
    found = list(steps(valve, Loop(views=9), search=replace(SEARCH, least_novelty=0.1)))
    assert found[-1].ending is Ending.LITTLE_NEW and 1 < len(found) < 9
    assert all(step.planned is None or step.planned.novelty >= 0.1 for step in found)


def test_no_reachable_view_ends_it(valve: Any) -> None:
    nowhere = Restricted(valve.sphere, lambda poses: np.zeros(len(poses), bool))
    assert [step.ending for step in steps(valve, Loop(views=4), nowhere)] == [Ending.NO_REACHABLE_VIEW]


def test_a_first_view_of_nothing_ends_it(valve: Any) -> None:
    away = valve.taken[0].copy()
    away[:3, [0, 2]] *= -1
    found = list(explore(valve.scan, valve.maps[0], valve.sensor, lambda map, T: valve.sphere, away, Loop(), SEARCH))
    assert [step.ending for step in found] == [Ending.NOTHING_SEEN]


def test_views_that_cannot_be_placed_are_left_out_and_end_it(valve: Any) -> None:
    found = list(steps(valve, Loop(views=9), place=lambda image, T: Placed(T, sure=False)))
    assert [step.ending for step in found][-1] is Ending.NOT_PLACED and len(found) == 1 + FAILURES
    for step in found[1:]:
        np.testing.assert_array_equal(step.map.labels, found[0].map.labels)
    overlaps = [step.planned.overlap for step in found[1:] if step.planned is not None]
    assert overlaps[1] >= 1 - 0.7 * 0.6 and overlaps[2] >= 1 - 0.7 * 0.36


def test_a_view_goes_to_the_map_where_it_was_placed(valve: Any) -> None:
    """Not where it was planned."""
    shift = np.eye(4)
    shift[0, 3] = 3 * valve.maps[0].grid.cell
    found = list(steps(valve, Loop(views=2), place=lambda image, T: Placed(shift @ T)))
    expected = update(found[0].map, found[1].image, shift @ found[1].T_world_sensor, valve.sensor)
    np.testing.assert_array_equal(found[1].map.labels, expected.labels)


def test_the_chooser_gets_what_was_taken(valve: Any) -> None:
    calls: list[int] = []

    def choose(map: Any, space: Any, search: Search, taken: Any) -> View:
        calls.append(len(taken))
        pose = valve.taken[1]
        nan = np.full(6, np.nan)
        return View(ViewOutcome.FOUND, pose, np.zeros(2), 0.0, nan, nan, 1.0, 1.0, None, 0)  # type: ignore[arg-type]

    found = list(steps(valve, Loop(views=3, least_gain=0.0), choose=choose))
    assert calls == [1, 2] and len(found) == 3
    np.testing.assert_array_equal(found[2].T_world_sensor, valve.taken[1])


@pytest.mark.parametrize(
    ("bad", "message"),
    [({"views": 0}, "loop.views"), ({"least_gain": 1.0}, "loop.least_gain"), ({"stride": 0.0}, "loop.stride")],
)
def test_a_loop_that_makes_no_sense(bad: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Loop(**bad)
