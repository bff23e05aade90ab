"""Environments seen from inside: closed, facing the free space, and of the measures they state."""

from dataclasses import replace

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.scan.rooms import Environment, TwoRooms, cube_room, two_rooms
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh

SMALL = TwoRooms(
    left_length=5.0,
    right_length=3.0,
    passage_length=0.4,
    passage_width=0.7,
    width=4.5,
    height=2.2,
    dome_radius=1.5,
    dome_rise=1.5,
    column_radius=0.1,
    column_offset=1.4,
    sensor_height=1.0,
)
ROOMS = {"cube": cube_room(), "large cube": cube_room(4.0, (0.2, -0.3, 0.1)), "two": two_rooms()}
ROOMS |= {"small two": two_rooms(SMALL)}
PLANS = {"two": TwoRooms(), "small two": SMALL}


def crossings(mesh: ObjectMesh, points: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """How many triangles the ray from each point along ``direction`` crosses, by Moeller and Trumbore's formula."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    side, rise = b - a, c - a
    p = np.cross(direction, rise)
    volume = np.einsum("ma,ma->m", side, p)
    volume = np.where(volume == 0, np.inf, volume)
    offset = points[:, None] - a
    u = np.einsum("nma,ma->nm", offset, p) / volume
    q = np.cross(offset, side)
    v = q @ direction / volume
    t = np.einsum("nma,ma->nm", q, rise) / volume
    return ((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).sum(axis=1)


def triangles(mesh: ObjectMesh) -> tuple[np.ndarray, np.ndarray]:
    """Corners of each triangle, and its normal with length twice its area."""
    corners = mesh.vertices[mesh.faces]
    return corners, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@pytest.mark.parametrize("room", ROOMS.values(), ids=ROOMS.keys())
def test_the_surface_is_closed_with_every_edge_shared_by_two_triangles_that_agree(room: Environment) -> None:
    sides = room.mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    along = {tuple(side) for side in sides.tolist()}
    assert len(along) == len(sides)
    assert along == {tuple(side) for side in sides[:, ::-1].tolist()}
    assert set(room.mesh.faces.ravel().tolist()) == set(range(len(room.mesh.vertices)))


@pytest.mark.parametrize("room", ROOMS.values(), ids=ROOMS.keys())
def test_every_triangle_faces_the_free_space(room: Environment) -> None:
    corners, normals = triangles(room.mesh)
    step = 0.02 * room.mesh.size() / 12 * normals / np.linalg.norm(normals, axis=1, keepdims=True)
    middle = corners.mean(axis=1)
    direction = np.array([0.312, 0.571, -0.759])
    assert (crossings(room.mesh, middle + step, direction) % 2 == 1).all()
    assert (crossings(room.mesh, middle - step, direction) % 2 == 0).all()
    assert room.inside(middle + step).all()
    assert not room.inside(middle - step).any()


@pytest.mark.parametrize("room", ROOMS.values(), ids=ROOMS.keys())
def test_inside_by_formula_is_inside_by_the_parity_of_a_ray(room: Environment) -> None:
    """Equal everywhere but within the sagitta of the round parts, here at most 2 cm of 10 m."""
    low, high = room.mesh.vertices.min(axis=0), room.mesh.vertices.max(axis=0)
    points = np.random.default_rng(3).uniform(low - 0.1, high + 0.1, (1500, 3))
    by_ray = crossings(room.mesh, points, np.array([0.42, -0.33, 0.85])) % 2 == 1
    wrong = points[by_ray != room.inside(points)]
    assert 0.2 < by_ray.mean() < 0.9
    jump = 0.02 * np.concatenate([np.eye(3), -np.eye(3)])
    assert all(len(set(room.inside(np.vstack([point, point + jump])).tolist())) == 2 for point in wrong)
    assert len(wrong) <= 3


@pytest.mark.parametrize(("name", "edge"), [("cube", 1.0), ("large cube", 4.0)])
def test_a_cube_has_its_edge(name: str, edge: float) -> None:
    corners, normals = triangles(ROOMS[name].mesh)
    assert np.linalg.norm(normals, axis=1).sum() / 2 == pytest.approx(6 * edge**2)
    assert np.sum(corners[:, 0] * normals) / 6 == pytest.approx(-(edge**3))  # negative: the normals point inwards


def flat_part(m: TwoRooms, sides: int) -> tuple[float, float]:
    """Volume of the rooms below the ceiling, area of all but the dome: columns are prisms over regular polygons."""
    angle = 2 * np.pi / sides
    column = sides / 2 * m.column_radius**2 * np.sin(angle)
    around = sides * 2 * m.column_radius * np.sin(angle / 2)
    plan = (m.left_length + m.right_length) * m.width + m.passage_length * m.passage_width - 4 * column
    outline = 4 * m.width + 2 * (m.left_length + m.right_length + m.passage_length) - 2 * m.passage_width
    opening = sides * m.dome_radius**2 * np.sin(angle / 2)  # a polygon of twice as many sides
    return plan * m.height, 2 * plan + (outline + 4 * around) * m.height - opening


@pytest.mark.parametrize("m", PLANS.values(), ids=PLANS)
def test_two_rooms_have_the_volume_and_area_of_their_measures(m: TwoRooms) -> None:
    """Flat parts exactly; the dome's facets miss the cap by a quarter as much when they are half as long."""
    cap = np.pi * m.dome_rise * (3 * m.dome_radius**2 + m.dome_rise**2) / 6
    skin = np.pi * (m.dome_radius**2 + m.dome_rise**2)
    missing = []
    for segments in (48, 96):
        corners, normals = triangles(two_rooms(m, segments).mesh)
        volume, area = flat_part(m, segments // 2)
        dome_volume = -np.sum(corners[:, 0] * normals) / 6 - volume
        dome_area = np.linalg.norm(normals, axis=1).sum() / 2 - area
        missing.append((1 - dome_volume / cap, 1 - dome_area / skin))
    coarse, fine = np.array(missing)
    assert (fine > 0).all() and (fine < 0.004).all()
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.02)


@pytest.mark.parametrize("name", PLANS)
def test_the_passage_is_as_wide_and_as_long_as_stated(name: str) -> None:
    m = PLANS[name]
    room = ROOMS[name]
    one_pixel = Sensor(1, 1)
    for x in np.linspace(-0.49, 0.49, 5) * m.passage_length:
        eye = np.array([x, 0.0, m.height / 3])
        for side in (-1.0, 1.0):
            view = scan_mesh(room.mesh.vertices, room.mesh.faces, one_pixel, look_at(eye, eye + np.array([0, side, 0])))
            assert np.linalg.norm(view.points) == pytest.approx(m.passage_width / 2, abs=1e-6)
    for x, way in ((-0.51 * m.passage_length, -1.0), (0.51 * m.passage_length, 1.0)):
        eye = np.array([x + way * 0.01, 0.0, m.height / 3])
        view = scan_mesh(room.mesh.vertices, room.mesh.faces, one_pixel, look_at(eye, eye + np.array([0, 1.0, 0])))
        assert np.linalg.norm(view.points) == pytest.approx(m.width / 2, abs=1e-6)


@pytest.mark.parametrize("room", ROOMS.values(), ids=ROOMS.keys())
def test_the_sensor_starts_in_free_space_and_meets_a_wall_on_every_ray(room: Environment) -> None:
    assert room.inside(room.T_world_start[None, :3, 3]).all()
    assert scan_mesh(
        room.mesh.vertices, room.mesh.faces, Sensor(40, 40, field_of_view_deg=100.0), room.T_world_start
    ).valid.all()


def test_the_start_looks_where_it_is_told() -> None:
    for heading in (0.0, 75.0, 180.0):
        T = two_rooms(heading_deg=heading).T_world_start
        angle = np.deg2rad(heading)
        np.testing.assert_allclose(T[:3, 2], [np.cos(angle), np.sin(angle), 0.0], atol=1e-12)
        np.testing.assert_allclose(T[:3, 1], [0, 0, -1], atol=1e-12)  # image rows run down


def test_the_dome_is_a_part_of_its_sphere_over_the_left_room() -> None:
    m = TwoRooms()
    vertices = two_rooms().mesh.vertices
    dome = vertices[vertices[:, 2] > m.height + 1e-9]
    centre = np.array([*m.dome_centre, m.height + m.dome_rise - m.dome_sphere_radius])
    np.testing.assert_allclose(np.linalg.norm(dome - centre, axis=1), m.dome_sphere_radius, atol=1e-12)
    assert dome[:, 2].max() == pytest.approx(m.height + m.dome_rise)
    assert m.ends[0] < dome[:, 0].min() and dome[:, 0].max() < m.ends[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0.0}, "width"),
        ({"height": float("nan")}, "height"),
        ({"passage_width": 6.0}, "narrower than the rooms"),
        ({"dome_radius": 3.0}, "fit over the left room"),
        ({"dome_rise": 2.5}, "half sphere"),
        ({"column_offset": 2.8}, "clear of the walls"),
        ({"column_offset": 1.5}, "clear of the dome"),
        ({"sensor_height": 3.0}, "below the ceiling"),
    ],
)
def test_measures_that_do_not_fit_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(TwoRooms(), **change)


def test_other_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="edge"):
        cube_room(0)
    with pytest.raises(InputError, match="inside the cube"):
        cube_room(2, (0.5, 0, 0))
    with pytest.raises(InputError, match="segments"):
        two_rooms(segments=4)
