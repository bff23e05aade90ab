"""The earlier method: no better than a field of views, and where it looks."""

from typing import Any

import equinox as eqx
import numpy as np

from jaxmodel.plan.free_space import free_space
from jaxmodel.plan.hill_climbing import hill_climbing
from jaxmodel.plan.label_map import object_map
from jaxmodel.plan.next_view import Search, ViewOutcome, utility_field
from jaxmodel.plan.utility import THESIS
from jaxmodel.plan.viewpoints import Restricted

SEARCH = Search(rays=256, minimum_overlap=0.0)


def test_on_a_sphere_it_climbs_but_finds_no_more_than_the_field(valve: Any) -> None:
    current = valve.taken[0]
    view = hill_climbing(valve.maps[1], valve.sensor, valve.sphere, current, SEARCH, THESIS)
    field = utility_field(valve.maps[1], valve.sensor, valve.sphere, THESIS, 4000, 256)
    assert view.outcome is ViewOutcome.FOUND
    assert np.median(field.utility) < view.utility <= 1.1 * field.utility.max()
    again = hill_climbing(valve.maps[1], valve.sensor, valve.sphere, current, SEARCH, THESIS)
    np.testing.assert_array_equal(view.T_world_sensor, again.T_world_sensor)


def test_in_free_space_it_looks_from_four_places(valve: Any) -> None:
    map = valve.maps[1]
    grid = map.grid
    eye = grid.origin + 0.5 * grid.cell
    space = free_space(map, eye, grid.origin, grid.origin + grid.cell * np.array(grid.shape))
    current = np.eye(4)
    current[:3, 3] = eye
    view = hill_climbing(map, valve.sensor, space, current, SEARCH)
    assert view.outcome is ViewOutcome.FOUND and view.scored <= 144
    assert space.allowed(view.T_world_sensor[None]).all()


def test_nowhere_and_nothing_new(valve: Any) -> None:
    nowhere = Restricted(valve.sphere, lambda poses: np.zeros(len(poses), bool))
    none = hill_climbing(valve.maps[1], valve.sensor, nowhere, valve.taken[0], SEARCH)
    assert none.outcome is ViewOutcome.NO_REACHABLE_VIEW
    empty = object_map(np.zeros(3), valve.size, 32)
    empty = eqx.tree_at(lambda m: m.crossed, empty, np.ones_like(empty.crossed))
    view = hill_climbing(empty, valve.sensor, valve.sphere, valve.taken[0], SEARCH)
    assert view.outcome is ViewOutcome.NOTHING_NEW
