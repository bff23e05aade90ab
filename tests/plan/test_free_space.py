import equinox as eqx
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.plan.free_space import free_space
from jaxmodel.plan.label_map import unknown_map

GRID = VoxelGrid(np.array([2.0, -1.0, 0.0]), 0.5, (9, 7, 6))
LOW, HIGH = GRID.origin, GRID.origin + np.array(GRID.shape) * GRID.cell


def _map(occupied, unknown=()):
    """Empty but for some voxels."""
    points = np.zeros(GRID.shape, np.int32)
    crossed = np.ones(GRID.shape, bool)
    for voxels, array, value in ((occupied, points, 1), (unknown, crossed, False)):
        for voxel in voxels:
            array[voxel] = value
    return eqx.tree_at(lambda m: (m.points, m.crossed), unknown_map(GRID, open_outside=True), (points, crossed))


def _eye(*voxel):
    return GRID.origin + (np.array(voxel) + 0.5) * GRID.cell


def _flooded(labels_empty, start):
    """Voxels joined to one by faces, by hand."""
    found, waiting = {start}, [start]
    while waiting:
        voxel = waiting.pop()
        for axis in range(3):
            for way in (-1, 1):
                beside = tuple(v + way * (a == axis) for a, v in enumerate(voxel))
                inside = all(0 <= v < n for v, n in zip(beside, GRID.shape, strict=True))
                if inside and labels_empty[beside] and beside not in found:
                    found.add(beside)
                    waiting.append(beside)
    return found


def test_free_are_the_empty_voxels_joined_to_the_robot():
    rng = np.random.default_rng(0)
    for share in (0.2, 0.45, 0.6):
        stops = np.argwhere(rng.random(GRID.shape) < share).tolist()
        half = len(stops) // 2
        start = (4, 3, 2)
        kinds = [{tuple(v) for v in part} - {start} for part in (stops[:half], stops[half:])]
        map = _map(*kinds)
        empty = map.labels == 1
        found = free_space(map, _eye(*start), LOW, HIGH).free
        assert {tuple(int(v) for v in voxel) for voxel in np.argwhere(found)} == _flooded(empty, start)


def test_a_wall_closes_a_room_and_a_door_opens_it():
    wall = [(4, j, k) for j in range(7) for k in range(6)]
    closed = free_space(_map(wall), _eye(1, 3, 2), LOW, HIGH)
    assert closed.free[:4].all()
    assert not closed.free[4:].any()
    opened = free_space(_map([v for v in wall if v != (4, 2, 5)]), _eye(1, 3, 2), LOW, HIGH)
    assert opened.free.sum() == 8 * 42 + 1
    # a robot wider than the door stays
    wide = free_space(_map([v for v in wall if v != (4, 2, 5)]), _eye(1, 3, 2), LOW, HIGH, clearance=0.6)
    assert not wide.free[4:].any()
    assert wide.free[:3].all()


def test_unknown_and_hidden_voxels_are_not_free():
    map = _map([], [(2, 2, 2), (3, 3, 3)])
    space = free_space(map, _eye(0, 0, 0), LOW, HIGH)
    assert not space.free[2, 2, 2]
    assert not space.free[3, 3, 3]
    assert space.free.sum() == np.prod(GRID.shape) - 2


@pytest.mark.parametrize("clearance", [0.0, 0.5, 0.8, 1.3])
def test_clearance_holds_from_every_free_voxel(clearance):
    stops = [(7, 3, 3), (7, 3, 4), (2, 6, 0)]
    space = free_space(_map(stops), _eye(0, 0, 5), LOW, HIGH, clearance)
    free = np.argwhere(space.free)
    away = np.linalg.norm(free[:, None] - np.array(stops), axis=2).min(axis=1) * GRID.cell
    assert (away > clearance).all()
    assert len(free) > 20


def test_views_drawn_are_allowed_and_lie_in_the_box():
    stops = [(4, j, k) for j in range(7) for k in range(5)]
    high = LOW + np.array([4.5, 2.0, 3.0])
    space = free_space(_map(stops), _eye(1, 1, 1), LOW, high)
    parameters = space.spread(500, seed=3)
    poses = space.poses(parameters)
    assert parameters.shape == (500, 5)
    assert np.asarray(space.allowed(poses)).all()
    places = poses[:, :3, 3]
    assert (places >= LOW - 1e-5).all()
    assert (places <= high + 1e-5).all()
    along = np.asarray(space.spiral(80))
    assert along.shape == (80, 5)
    assert np.asarray(space.allowed(space.poses(along))).all()
    # a position outside the map, or inside the wall, is none
    bad = np.tile(np.eye(4), (2, 1, 1))
    bad[0, :3, 3], bad[1, :3, 3] = LOW - 1, _eye(4, 1, 1)
    assert not np.asarray(space.allowed(bad)).any()


def test_a_space_without_free_voxels_in_its_box_has_no_views():
    space = free_space(_map([]), _eye(0, 0, 0), LOW + 50, HIGH + 60)
    assert space.spread(100).shape == (0, 5)
    assert space.spiral(100).shape == (0, 5)


def test_places_turn_to_parameters_and_back():
    space = free_space(_map([]), _eye(0, 0, 0), LOW, HIGH)
    eyes = np.random.default_rng(0).uniform(LOW + 1e-3, HIGH - 1e-3, (50, 3))
    parameters = np.concatenate([space.place_of(eyes), np.zeros((50, 2))], axis=1)
    assert np.allclose(space.poses(parameters)[:, :3, 3], eyes, atol=1e-5)


def test_near_keeps_what_is_within_a_distance():
    space = free_space(_map([(4, 3, 3)]), _eye(0, 0, 0), LOW, HIGH)
    eye = _eye(4, 3, 2)
    near = space.near(eye, 1.1)
    centres = GRID.centres(np.arange(space.free.size)).reshape(*GRID.shape, 3)
    assert np.array_equal(near.free, space.free & (np.linalg.norm(centres - eye, axis=-1) <= 1.1))
    assert 0 < near.free.sum() < space.free.sum()


def test_a_robot_close_to_something_may_leave_it():
    """It stands nearer than its clearance; the empty voxels around it lead to free ones."""
    space = free_space(_map([(0, 3, 3)]), _eye(1, 3, 3), LOW, HIGH, clearance=0.9)
    assert space.free[1, 3, 3]
    assert space.free[5:].all()
    assert not space.free[1, 3, 2]


def test_a_sensor_inside_something_is_refused():
    with pytest.raises(InputError, match="inside something"):
        free_space(_map([(3, 3, 3)]), _eye(3, 3, 3), LOW, HIGH)


def test_a_sensor_outside_the_map_is_refused():
    with pytest.raises(InputError, match="outside the map"):
        free_space(_map([]), LOW - 1, LOW, HIGH)


def test_a_box_turned_inside_out_is_refused():
    for low, high in ((HIGH, LOW), (LOW, HIGH * [1, 1, np.nan])):
        with pytest.raises(InputError, match="low to its high corner"):
            free_space(_map([]), _eye(0, 0, 0), low, high)


@pytest.mark.parametrize("clearance", [-0.1, np.nan])
def test_a_clearance_that_is_none_is_refused(clearance):
    with pytest.raises(InputError, match="clearance"):
        free_space(_map([]), _eye(0, 0, 0), LOW, HIGH, clearance)
