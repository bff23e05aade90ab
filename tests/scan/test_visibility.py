"""What a sensor sees of a surface: against a formula written out, and against its own scans."""

from itertools import pairwise

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh
from jaxmodel.scan.visibility import Occluders, seen_points

PINHOLE = Sensor(80, 70, field_of_view_deg=40.0)
ORTHOGRAPHIC = Sensor(80, 70, "orthographic", window=1.5)


def middles(mesh: ObjectMesh) -> tuple[np.ndarray, np.ndarray]:
    """A point inside each triangle, and the triangle's unit normal."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners.mean(axis=1), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def blocked_by_formula(mesh: ObjectMesh, points: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Whether the segment from each point along its whole way meets a triangle off the point: float64, all pairs."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    side, rise = b - a, c - a
    blocked = []
    for point, way in zip(points, ways, strict=True):
        p = np.cross(way, rise)
        volume = np.einsum("ma,ma->m", side, p)
        volume = np.where(volume == 0, np.inf, volume)
        u = np.einsum("ma,ma->m", point - a, p) / volume
        q = np.cross(point - a, side)
        v, t = q @ way / volume, np.einsum("ma,ma->m", q, rise) / volume
        blocked.append(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-5) & (t < 1)).any())
    return np.array(blocked)


@pytest.mark.parametrize("name", ["valve", "boulder", "block_curved"])
@pytest.mark.parametrize("eye", [(2.2, 0.3, 0.4), (0.1, -0.7, 0.9), (0.0, 0.62, 0.0)])
def test_occlusion_is_that_of_the_formula(name: str, eye: tuple[float, float, float]) -> None:
    """From far, near, and so near that part of the object lies behind the sensor."""
    mesh = object_mesh(name)
    points, normals = middles(mesh)
    chosen = np.random.default_rng(1).permutation(len(points))[:600]
    points, normals = points[chosen], normals[chosen]
    wide = Sensor(80, 80, field_of_view_deg=100.0)
    T = look_at(np.array(eye), np.zeros(3))
    seen = seen_points(points, normals, Occluders(mesh.vertices, mesh.faces), wide, T)
    ways = np.array(eye) - points
    local = (points - T[:3, 3]) @ T[:3, :3]
    limit = np.tan(np.deg2rad(50)) * local[:, 2]
    cosine = np.sum(normals * ways, axis=1) / np.linalg.norm(ways, axis=1)
    candidate = (local[:, 2] > 0) & (np.abs(local[:, :2]).max(axis=1) <= limit) & (cosine > np.cos(np.deg2rad(80)))
    np.testing.assert_array_equal(seen, candidate & ~blocked_by_formula(mesh, points, ways))
    assert 10 < seen.sum() < 0.6 * len(points)


@pytest.mark.parametrize("sensor", [PINHOLE, ORTHOGRAPHIC], ids=lambda sensor: sensor.projection)
@pytest.mark.parametrize("name", ["valve", "gourd", "y_pipe"])
def test_every_reading_of_a_scan_is_a_point_that_is_seen(sensor: Sensor, name: str) -> None:
    """Readings carry the normal of their triangle; those beyond the grazing limit are the only ones not seen."""
    mesh = object_mesh(name)
    T = look_at(np.array([1.5, 1.4, 0.8]), np.zeros(3))
    image = scan_mesh(mesh.vertices, mesh.faces, sensor, T)
    points = image.points[image.valid] @ T[:3, :3].T + T[:3, 3]
    corners = mesh.vertices[mesh.faces]
    _, normals = middles(mesh)
    # The triangle of a reading: least sum of plane distance and barycentric excess.
    gap = np.abs(np.einsum("ma,nma->nm", normals, points[:, None] - corners[:, 0]))
    for k in range(3):
        edge = corners[:, (k + 1) % 3] - corners[:, k]
        outward = np.cross(edge, normals)
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        gap = np.maximum(gap, np.einsum("ma,nma->nm", outward, points[:, None] - corners[:, k]))
    face = gap.argmin(axis=1)
    assert gap.min(axis=1).max() < 1e-6
    towards = T[:3, 3] - points if sensor.projection == "pinhole" else np.broadcast_to(-T[:3, 2], points.shape)
    incidence = np.sum(normals[face] * towards, axis=1) / np.linalg.norm(towards, axis=1)
    seen = seen_points(points, normals[face], Occluders(mesh.vertices, mesh.faces), sensor, T)
    firm = np.abs(incidence - np.cos(np.deg2rad(80))) > 1e-6
    on_edge = np.sort(gap, axis=1)[:, 1] < 1e-4  # the triangle of such a reading is not certain
    clear = firm & ~on_edge
    assert clear.sum() > 0.8 * len(points)
    np.testing.assert_array_equal(seen[clear], incidence[clear] > np.cos(np.deg2rad(80)))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("sensor", [PINHOLE, ORTHOGRAPHIC], ids=lambda sensor: sensor.projection)
def test_the_unit_and_a_far_origin_change_nothing(sensor: Sensor, scale: float) -> None:
    mesh = object_mesh("y_pipe")
    points, normals = middles(mesh)
    T = look_at(np.array([1.5, 1.4, 0.8]), np.zeros(3))
    before = seen_points(points, normals, Occluders(mesh.vertices, mesh.faces), sensor, T)
    shift = np.array([700.0, -300.0, 50.0])
    moved = T.copy()
    moved[:3, 3] = scale * (T[:3, 3] + shift)
    scaled = Sensor(sensor.width, sensor.height, sensor.projection, sensor.field_of_view_deg, scale * sensor.window)
    occluders = Occluders(scale * (mesh.vertices + shift), mesh.faces)
    after = seen_points(scale * (points + shift), normals, occluders, scaled, moved)
    np.testing.assert_array_equal(after, before)
    assert 0.1 < before.mean() < 0.5


def test_range_limits_are_of_the_distance_along_the_ray() -> None:
    sphere = icosphere(4)
    points, normals = middles(sphere)
    occluders = Occluders(sphere.vertices, sphere.faces)
    eye = np.array([3.0, 0.5, 0.0])
    T = look_at(eye, np.zeros(3))
    whole = seen_points(points, normals, occluders, Sensor(field_of_view_deg=60.0), T)
    distance = np.linalg.norm(points - eye, axis=1)
    low, high = np.quantile(distance[whole], [0.3, 0.7]) + 1e-7  # no point lies on a limit
    limited = Sensor(field_of_view_deg=60.0, minimum_range=float(low), maximum_range=float(high))
    np.testing.assert_array_equal(
        seen_points(points, normals, occluders, limited, T), whole & (distance >= low) & (distance <= high)
    )


def test_what_lies_beside_the_image_or_behind_the_sensor_is_not_seen() -> None:
    cube = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), 6)
    points, normals = middles(cube)
    occluders = Occluders(cube.vertices, cube.faces)
    for sensor in (PINHOLE, ORTHOGRAPHIC):
        eye = np.array([3.0, 0.0, 0.0])
        assert seen_points(points, normals, occluders, sensor, look_at(eye, np.zeros(3))).any()
        assert not seen_points(points, normals, occluders, sensor, look_at(eye, 2 * eye)).any()
        assert not seen_points(points, normals, occluders, sensor, look_at(eye, eye + np.array([0.0, 5.0, 0.0]))).any()


def test_a_triangle_turned_either_way_hides_what_is_behind() -> None:
    target = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), 4)
    points, normals = middles(target)
    T = look_at(np.array([0.0, 0.0, 3.0]), np.zeros(3))
    corners = np.array([(-2.0, -2, 1), (2, -2, 1), (2, 2, 1), (-2, 2, 1)])
    for order in ([(0, 1, 2), (0, 2, 3)], [(0, 2, 1), (0, 3, 2)]):
        both = join(target, ObjectMesh(corners, np.array(order)))
        assert not seen_points(points, normals, Occluders(both.vertices, both.faces), PINHOLE, T).any()


def test_a_steeper_limit_only_adds_and_ninety_degrees_is_all_front_faces() -> None:
    sphere = icosphere(3)
    points, normals = middles(sphere)
    occluders = Occluders(sphere.vertices, sphere.faces)
    eye = np.array([0.0, -4.0, 1.0])
    T = look_at(eye, np.zeros(3))
    views = [seen_points(points, normals, occluders, PINHOLE, T, limit) for limit in (20, 50, 80, 90)]
    assert all((before <= after).all() and before.sum() < after.sum() for before, after in pairwise(views))
    np.testing.assert_array_equal(views[-1], np.sum(normals * (eye - points), axis=1) > 0)


def test_bad_input_is_refused() -> None:
    cube = box((0, 0, 0), (1, 1, 1))
    points, normals = middles(cube)
    with pytest.raises(InputError, match="no faces"):
        Occluders(cube.vertices, cube.faces[:0])
    with pytest.raises(InputError, match="not finite"):
        Occluders(np.where(cube.vertices > 0, np.nan, 0.0), cube.faces)
    with pytest.raises(InputError, match="no extent"):
        Occluders(np.ones((3, 3)), np.array([(0, 1, 2)]))
    for limit in (0, 91, float("nan")):
        with pytest.raises(InputError, match="grazing_deg"):
            seen_points(points, normals, Occluders(cube.vertices, cube.faces), PINHOLE, np.eye(4), limit)
