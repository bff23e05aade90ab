"""Coverage: closed forms, what can never be reached, and the laws of the curve."""

from itertools import combinations

import jax
import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.plan.coverage import CoverageCurve, coverage, exposed, greedy_views, reachable, visible
from jaxmodel.plan.surface_samples import sample_surface
from jaxmodel.plan.viewpoints import ObservationSphere
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.rooms import cube_room
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh

KEY = jax.random.key(0)
WIDE = Sensor(100, 100, field_of_view_deg=70.0)
AXES = np.concatenate([np.eye(3), -np.eye(3)])
FROM_SIX_SIDES = np.stack([look_at(3 * axis, np.zeros(3)) for axis in AXES])


def uniform_views(sphere: ObservationSphere, count: int) -> np.ndarray:
    return sphere.poses(sphere.spread(count))


SPHERE = ObservationSphere(np.zeros(3), 2.2)


@pytest.mark.parametrize("grazing_deg", [30.0, 60.0, 80.0])
@pytest.mark.parametrize("distance", [1.6, 2.5, 9.0])
def test_of_a_sphere_the_cap_up_to_the_grazing_limit_is_seen(distance: float, grazing_deg: float) -> None:
    """Where the incidence is i, the angle at the centre is i - asin(sin i / distance): the law of sines."""
    sphere = icosphere(5)
    samples = sample_surface(sphere, KEY)
    pose = look_at(distance * np.array([0.6, -0.48, 0.64]), np.zeros(3))
    seen = visible(samples, sphere, pose[None], Sensor(field_of_view_deg=100.0), grazing_deg)[0]
    limit = np.deg2rad(grazing_deg)
    cap = limit - np.arcsin(np.sin(limit) / distance)
    assert samples.weights[seen].sum() / samples.weights.sum() == pytest.approx((1 - np.cos(cap)) / 2, abs=2e-3)


def test_of_a_sphere_an_orthographic_sensor_sees_the_cap_of_the_grazing_angle_from_any_distance() -> None:
    sphere = icosphere(5)
    samples = sample_surface(sphere, KEY)
    sensor = Sensor(projection="orthographic", window=2.2)
    for distance in (1.5, 40.0):
        pose = look_at(np.array([0.0, distance, 0.0]), np.zeros(3))
        share = visible(samples, sphere, pose[None], sensor, 70)[0].mean()
        assert share == pytest.approx((1 - np.cos(np.deg2rad(70))) / 2, abs=2e-3)


def test_of_a_box_six_views_see_one_side_each_and_together_everything() -> None:
    cube = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), 3)
    samples = sample_surface(cube, KEY, 5000)
    seen = visible(samples, cube, FROM_SIX_SIDES, WIDE)
    np.testing.assert_array_equal(seen.T, samples.normals @ AXES.T > 0.5)


def test_of_a_convex_solid_every_front_side_within_the_limit_is_seen() -> None:
    """No point of a convex solid is hidden by another."""
    solid = icosphere(1)
    solid = ObjectMesh(solid.vertices * np.array([1.0, 0.6, 0.4]), solid.faces)
    samples = sample_surface(solid, KEY, 5000)
    poses = uniform_views(ObservationSphere(np.zeros(3), 3.0), 20)
    towards = poses[:, None, :3, 3] - samples.points
    cosine = np.sum(towards * samples.normals, axis=2) / np.linalg.norm(towards, axis=2)
    np.testing.assert_array_equal(visible(samples, solid, poses, WIDE), cosine > np.cos(np.deg2rad(80)))


def test_the_walls_of_a_closed_cavity_are_never_reached() -> None:
    inner = box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2), 2)
    hollow = join(box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5), 2), ObjectMesh(inner.vertices, inner.faces[:, ::-1]))
    samples = sample_surface(hollow, KEY, 4000)
    seen = reachable(samples, hollow, uniform_views(SPHERE, 300), WIDE)
    np.testing.assert_array_equal(seen, np.abs(samples.points).max(axis=1) > 0.4)
    assert 0.1 < (~seen).mean() < 0.2


def test_a_sensor_inside_sees_every_wall_of_a_cube_and_not_what_a_block_hides() -> None:
    room = cube_room(2.0)
    eye = np.array([-0.7, 0.0, 0.0])
    poses = np.stack([look_at(eye, eye + axis) for axis in AXES])
    wide = Sensor(100, 100, field_of_view_deg=91.0)
    samples = sample_surface(room.mesh, KEY, 3000)
    assert reachable(samples, room.mesh, poses, wide, 90).all()
    blocked = join(room.mesh, box((0.0, -0.2, -0.2), (0.1, 0.2, 0.2)))
    seen = reachable(samples, blocked, poses, wide, 90)
    # Its face at x = 0, 0.7 before the eye, throws a square shadow on the wall x = 1, at 1.7.
    shadow = (samples.points[:, 0] > 0.999) & (np.abs(samples.points[:, 1:]).max(axis=1) < 0.2 * 1.7 / 0.7)
    np.testing.assert_array_equal(seen, ~shadow)
    assert shadow.sum() > 50


@pytest.mark.parametrize("name", ["valve", "torso"])
def test_the_points_of_a_scan_lie_near_samples_that_are_seen_and_the_other_way_round(name: str) -> None:
    mesh = object_mesh(name)
    samples = sample_surface(mesh, KEY)
    sensor = Sensor(200, 200, field_of_view_deg=40.0)
    pose = look_at(np.array([1.4, -1.5, 0.9]), np.zeros(3))
    image = scan_mesh(mesh.vertices, mesh.faces, sensor, pose)
    points = image.points[image.valid] @ pose[:3, :3].T + pose[:3, 3]
    seen = samples.points[visible(samples, mesh, pose[None], sensor, 90)[0]]
    spacing = float(np.sqrt(samples.weights[0]))
    assert KDTree(seen).query(points)[0].max() < 5 * spacing
    pixel = 2.3 / sensor.focal_px
    steep = KDTree(points).query(samples.points[visible(samples, mesh, pose[None], sensor, 60)[0]])[0]
    # On a side at 60 degrees pixels lie twice as far apart; a sample beside an outline may have no pixel on its side.
    assert np.quantile(steep, 0.99) < 2 * pixel and steep.max() < 8 * pixel


def test_reachable_is_the_union_of_the_views_in_any_order() -> None:
    mesh = object_mesh("y_pipe")
    samples = sample_surface(mesh, KEY, 6000)
    poses = uniform_views(SPHERE, 30)
    each = visible(samples, mesh, poses, WIDE)
    union = reachable(samples, mesh, poses, WIDE)
    np.testing.assert_array_equal(union, each.any(axis=0))
    np.testing.assert_array_equal(union, reachable(samples, mesh, poses[::-1], WIDE))
    more = reachable(samples, mesh, uniform_views(SPHERE, 60), WIDE)
    assert union.mean() < more.mean() + 0.01
    none = np.zeros((0, 4, 4))
    assert visible(samples, mesh, none, WIDE).shape == (0, 6000) and not reachable(samples, mesh, none, WIDE).any()


def test_what_is_buried_in_another_part_is_not_exposed() -> None:
    """Two overlapping boxes, one box's faces inside the other, against the formula."""
    first, second = box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)), box((-0.2, -0.3, 0.1), (0.9, 0.3, 0.8))
    samples = sample_surface(join(first, second), KEY, 4000)
    in_first = np.abs(samples.points).max(axis=1) < 0.5 - 1e-9
    in_second = (np.abs(samples.points - [0.35, 0.0, 0.45]) < np.array([0.55, 0.3, 0.35]) - 1e-9).all(axis=1)
    np.testing.assert_array_equal(exposed(samples, join(first, second)), ~(in_first | in_second))
    assert 0.1 < (in_first | in_second).mean() < 0.4
    inner = box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))
    hollow = join(first, ObjectMesh(inner.vertices, inner.faces[:, ::-1]))
    assert exposed(sample_surface(hollow, KEY, 2000), hollow).all()  # a cavity is outside the matter


@pytest.mark.parametrize("name", ["valve", "y_pipe", "gourd"])
def test_whatever_is_seen_is_exposed(name: str) -> None:
    mesh = object_mesh(name)
    samples = sample_surface(mesh, KEY, 6000)
    out = exposed(samples, mesh)
    assert not (reachable(samples, mesh, uniform_views(SPHERE, 100), WIDE) & ~out).any()
    assert out.all() == (name == "gourd")


def test_millimetres_and_metres_agree() -> None:
    mesh = object_mesh("valve")
    thousand = ObjectMesh(1000 * mesh.vertices, mesh.faces)
    near, far = 1.8, 2.4
    limited = Sensor(100, 100, field_of_view_deg=40.0, minimum_range=near, maximum_range=far)
    scaled = Sensor(100, 100, field_of_view_deg=40.0, minimum_range=1000 * near, maximum_range=1000 * far)
    metres = visible(sample_surface(mesh, KEY, 5000), mesh, uniform_views(SPHERE, 8), limited)
    poses = uniform_views(ObservationSphere(np.zeros(3), 2200.0), 8)
    millimetres = visible(sample_surface(thousand, KEY, 5000), thousand, poses, scaled)
    np.testing.assert_array_equal(metres, millimetres)
    assert 0.1 < metres.mean() < 0.5


@pytest.mark.parametrize(("low", "high"), [(None, 2.0), (2.0, None), (1.9, 2.1), (9.0, None)])
def test_readings_outside_the_range_limits_are_not_seen(low: float | None, high: float | None) -> None:
    mesh = object_mesh("boulder")
    samples = sample_surface(mesh, KEY, 4000)
    poses = uniform_views(SPHERE, 6)
    distance = np.linalg.norm(poses[:, None, :3, 3] - samples.points, axis=2)
    limited = Sensor(100, 100, field_of_view_deg=70.0, minimum_range=low, maximum_range=high)
    within = (distance >= (low or 0.0)) & (distance <= (high or np.inf))
    np.testing.assert_array_equal(visible(samples, mesh, poses, limited), visible(samples, mesh, poses, WIDE) & within)


def test_the_order_of_views_changes_the_curve_but_neither_its_end_nor_its_rise() -> None:
    mesh = object_mesh("valve")
    samples = sample_surface(mesh, KEY, 5000)
    views = visible(samples, mesh, uniform_views(SPHERE, 12), WIDE)
    target = reachable(samples, mesh, uniform_views(SPHERE, 200), WIDE)
    rng = np.random.default_rng(0)
    curves = [
        CoverageCurve.start(target, samples.weights).after_all(views[rng.permutation(12)]).shares for _ in range(5)
    ]
    assert len({curve[-1] for curve in curves}) == 1 and len({curve[0] for curve in curves}) > 1
    for curve in curves:
        assert len(curve) == 12 and (np.diff(curve) >= 0).all() and 0 < curve[0] < curve[-1] <= 1


def test_coverage_is_the_share_by_weight_of_what_can_be_reached() -> None:
    weights = np.array([1.0, 2.0, 3.0, 10.0])
    can = np.array([True, True, True, False])
    assert coverage(np.array([False, False, True, True]), can, weights) == 0.5
    assert coverage(np.array([True, True, True, False]), can, weights) == 1.0
    assert coverage(np.zeros(4, dtype=bool), can, weights) == 0.0
    assert np.isnan(coverage(np.ones(4, dtype=bool), np.zeros(4, dtype=bool), weights))


def test_the_measures_of_a_curve() -> None:
    can = np.ones(10, dtype=bool)
    views = np.zeros((4, 10), dtype=bool)
    for row, stop in zip(views, (5, 3, 8, 10), strict=True):
        row[:stop] = True
    start = CoverageCurve.start(can, np.ones(10))
    curve = start.after_all(views)
    np.testing.assert_allclose(curve.shares, [0.5, 0.5, 0.8, 1.0])
    assert curve.views_needed(0.5) == 1 and curve.views_needed(0.6) == 3 and curve.views_needed(1.0) == 4
    assert curve.area(2) == pytest.approx(0.5) and curve.area(4) == pytest.approx(0.7)
    assert curve.area(8) == pytest.approx((2.8 + 4) / 8)  # held at its end
    assert start.shares == () and start.area(3) == 0.0 and start.views_needed(0.5) is None
    assert start.after(views[2]).views_needed(0.81) is None


def test_greedy_views_gain_less_and_less_and_lose_to_no_order_by_more_than_their_bound() -> None:
    rng = np.random.default_rng(4)
    views = rng.random((14, 60)) < 0.15
    can = rng.random(60) < 0.9
    weights = rng.random(60)
    curve = CoverageCurve.start(can, weights).after_all(views[greedy_views(views, can, weights, 4)])
    gains = np.diff([0.0, *curve.shares])
    assert (np.diff(gains) <= 1e-12).all()
    best = max(coverage(np.asarray(views[list(four)].any(axis=0)), can, weights) for four in combinations(range(14), 4))
    assert (1 - 1 / np.e) * best <= curve.shares[-1] <= best
    all_of_it = greedy_views(views, can, weights, 99)
    assert len(set(all_of_it.tolist())) == len(all_of_it) <= 14
    np.testing.assert_array_equal(views[all_of_it].any(axis=0) & can, views.any(axis=0) & can)
    assert len(greedy_views(views[:0], can, weights, 3)) == 0


def test_bad_input_is_refused() -> None:
    weights = np.ones(3)
    with pytest.raises(InputError, match="No part of the surface"):
        CoverageCurve.start(np.zeros(3, dtype=bool), weights)
    with pytest.raises(InputError, match="views"):
        CoverageCurve.start(np.ones(3, dtype=bool), weights).area(0)
    cube = box((0, 0, 0), (1, 1, 1))
    with pytest.raises(InputError, match="grazing_deg"):
        visible(sample_surface(cube, KEY, 10), cube, FROM_SIX_SIDES, WIDE, 120.0)
