"""The virtual scanner: points on the surface, on their rays, in the stated frames."""

import jax
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.objects import OBJECTS, object_mesh
from jaxmodel.scan.range_image import grid_triangles, normals, to_cloud
from jaxmodel.scan.sensor import Sensor, project
from jaxmodel.scan.triangle_mesh import box, icosphere
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh, turntable_poses

SENSORS = [Sensor(60, 50), Sensor(60, 50, "orthographic", window=2.4)]


def in_world(image, T):
    points = image.points[image.valid]
    return points @ T[:3, :3].T + T[:3, 3]


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.projection)
def test_a_plane_is_recovered_exactly(sensor):
    """The wall x = 0.5 of a box, seen at a slant."""
    cube = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    T = look_at(np.array([4.0, 0.7, 0.5]), np.zeros(3))
    world = in_world(scan_mesh(cube.vertices, cube.faces, sensor, T), T)
    gap = np.abs(np.abs(world).max(axis=1) - 0.5)  # on the cube's surface, whichever face
    assert len(world) > 300 and gap.max() < 1e-12


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.projection)
def test_a_sphere_is_recovered_to_its_facets_and_nearest_side(sensor):
    sphere = icosphere(5)
    T = look_at(np.array([1.0, -5.0, 2.0]), np.zeros(3))
    image = scan_mesh(sphere.vertices, sphere.faces, sensor, T)
    world = in_world(image, T)
    radius = np.linalg.norm(world, axis=1)
    assert radius.max() <= 1 + 1e-12 and radius.min() > np.cos(0.03)
    towards = T[:3, 3] - world if sensor.projection == "pinhole" else np.broadcast_to(-T[:3, 2], world.shape)
    assert (np.sum(world * towards, axis=1) > -0.05).all()  # the far side is never seen
    facing = np.sum(normals(image)[image.valid] @ T[:3, :3].T * world, axis=1)
    assert np.median(facing) > 0.999


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.projection)
def test_each_reading_projects_to_its_pixel(sensor):
    mesh = object_mesh("boulder")
    image = scan_mesh(mesh.vertices, mesh.faces, sensor, look_at(np.array([3.0, 0, 0]), np.zeros(3)))
    rows, columns = np.nonzero(image.valid)
    np.testing.assert_allclose(project(sensor, image.points[image.valid]), np.stack([columns, rows], 1), atol=1e-9)
    assert np.isnan(image.points[~image.valid]).all()


def test_moving_object_and_sensor_together_changes_nothing():
    mesh = object_mesh("valve")
    T = look_at(np.array([2.0, 2.0, 1.0]), np.zeros(3))
    G = look_at(np.array([0.3, -0.8, 0.5]), np.array([1.0, 2.0, 3.0]))
    still = scan_mesh(mesh.vertices, mesh.faces, SENSORS[0], T)
    moved = scan_mesh(mesh.vertices @ G[:3, :3].T + G[:3, 3], mesh.faces, SENSORS[0], G @ T)
    assert (still.valid != moved.valid).mean() < 2e-3  # rays along an edge may fall on either side
    both = still.valid & moved.valid
    off = np.linalg.norm(still.points[both] - moved.points[both], axis=1)
    assert np.quantile(off, 0.99) < 1e-6


def test_look_at_is_a_rotation_with_the_view_along_z_and_up_upwards():
    rng = np.random.default_rng(0)
    for _ in range(20):
        eye, target = rng.normal(size=(2, 3))
        T = look_at(eye, target)
        R = T[:3, :3]
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) > 0
        seen = R.T @ (target - T[:3, 3])
        np.testing.assert_allclose(seen, [0.0, 0.0, float(np.linalg.norm(target - eye))], atol=1e-12)
        assert R[2, 1] < 0 and abs(R[2, 0]) < 1e-12  # rows run down, columns level


def test_looking_straight_down_still_gives_a_rotation():
    R = look_at(np.array([0.0, 0.0, 3.0]), np.zeros(3))[:3, :3]
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R[:, 2], [0, 0, -1])


def test_look_at_itself_is_refused():
    with pytest.raises(InputError, match="coincide"):
        look_at(np.ones(3), np.ones(3))


def test_turntable_poses_look_at_the_origin_from_the_stated_places():
    poses = turntable_poses([0.0, 90.0, 200.0], 3.0, 30.0)
    np.testing.assert_allclose(poses[0, :3, 3], [3 * np.cos(np.pi / 6), 0, 1.5], atol=1e-12)
    np.testing.assert_allclose(poses[1, :3, 3], [0, 3 * np.cos(np.pi / 6), 1.5], atol=1e-12)
    np.testing.assert_allclose(3.0 * poses[:, :3, 2], -poses[:, :3, 3], atol=1e-12)
    assert turntable_poses([], 1.0).shape == (0, 4, 4)


def test_ranges_outside_the_limits_are_not_given():
    sphere = icosphere(3)
    T = look_at(np.array([4.0, 0, 0]), np.zeros(3))
    full = scan_mesh(sphere.vertices, sphere.faces, Sensor(40, 40, field_of_view_deg=35.0), T)
    cut = Sensor(40, 40, field_of_view_deg=35.0, minimum_range=3.1, maximum_range=3.5)
    distance = np.linalg.norm(full.points, axis=-1)
    expected = full.valid & (distance >= 3.1) & (distance <= 3.5)
    assert 0 < expected.sum() < full.valid.sum()
    np.testing.assert_array_equal(scan_mesh(sphere.vertices, sphere.faces, cut, T).valid, expected)


def test_noise_is_keyed_and_sized_by_the_object():
    sphere = icosphere(4)
    T = look_at(np.array([6.0, 0, 0]), np.zeros(3))
    model = Laser(sigma=0.005, growth=0.0)
    key = jax.random.key(3)
    first, second = (scan_mesh(sphere.vertices, sphere.faces, SENSORS[0], T, model, key) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)
    exact = scan_mesh(sphere.vertices, sphere.faces, SENSORS[0], T)
    error = np.linalg.norm(first.points, axis=-1) - np.linalg.norm(exact.points, axis=-1)
    assert np.nanstd(error) == pytest.approx(0.005 * 2.0, rel=0.1)  # a fraction of the diameter


@pytest.mark.parametrize("name", list(OBJECTS))
def test_the_default_view_holds_the_whole_object(name):
    mesh = object_mesh(name)
    for T in turntable_poses(range(0, 360, 60), 3.0, 20.0):
        image = scan_mesh(mesh.vertices, mesh.faces, Sensor(), T)
        assert image.valid.sum() > 3000
        assert not (image.valid[[0, -1]].any() or image.valid[:, [0, -1]].any())
        assert len(grid_triangles(image)) > 1.5 * image.valid.sum()
        assert len(to_cloud(image)) == image.valid.sum()


def test_bad_meshes_and_noise_without_a_key_are_refused():
    sphere, T = icosphere(1), np.eye(4)
    with pytest.raises(InputError, match="no faces"):
        scan_mesh(sphere.vertices, sphere.faces[:0], SENSORS[0], T)
    with pytest.raises(InputError, match="not finite"):
        scan_mesh(sphere.vertices * np.nan, sphere.faces, SENSORS[0], T)
    with pytest.raises(InputError, match="random key"):
        scan_mesh(sphere.vertices, sphere.faces, SENSORS[0], T, Laser())
