import itertools

import numpy as np
import pytest
from map_cases import GRIDS, SENSOR, axis_pose, random_image, random_pose
from reference_march import BORDER, OCCUPIED, PLANE, Evidence

from jaxmodel.errors import InputError
from jaxmodel.plan import label_map, map_update
from jaxmodel.plan.label_map import UNIT, unknown_map
from jaxmodel.plan.map_update import RIM, update
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays

ARRAYS = ("points", "nearest", "normal_sum", "crossed", "behind", "shadow_sum")


def _far_from_readings(image):
    """Pixels with no reading within ``RIM`` steps to a side, by definition."""
    rows, columns = np.nonzero(image.valid)
    v, u = np.mgrid[: image.valid.shape[0], : image.valid.shape[1]]
    away = np.abs(v[..., None] - rows) + np.abs(u[..., None] - columns)
    return (away > RIM).all(axis=-1)


def _views(rng, grid):
    size = np.asarray(grid.shape)
    poses = [random_pose(rng, grid, inside) for inside in (False, False, True, True)]
    poses.append(axis_pose(grid, 0, [-3, size[1] // 2, size[2] // 2]))
    poses.append(axis_pose(grid, 2, [2.5, 3, -4]))
    return [(random_image(rng, grid), T) for T in poses]


@pytest.fixture(scope="module", params=[(0, None), (1, None), (0, 2.0), (1, np.inf), (1, 3.0)])
def scene(request):
    """A map, the reference's evidence, the grid and the views, after six views; with and without the sensor's model."""
    which, reach = request.param
    grid = GRIDS[which]
    rng = np.random.default_rng(which + 10 * (reach is not None))
    sensor = None
    if reach is not None:
        sensor = Sensor(13, 11, field_of_view_deg=70.0, maximum_range=None if np.isinf(reach) else reach)
    map, slow = unknown_map(grid, open_outside=which == 1), Evidence(grid.shape)
    views = _views(rng, grid)
    for image, T in views:
        map = update(map, image, T, sensor)
        free = pixel_rays(SENSOR).directions[_far_from_readings(image)] if sensor else np.zeros((0, 3))
        slow.add(grid, image, T, free, np.full(len(free), reach))
    return map, slow, grid, views, sensor


def test_evidence_is_that_of_the_reference(scene):
    map, slow, grid, views, _ = scene
    assert np.array_equal(map.points, slow.points)
    assert np.array_equal(map.nearest, slow.nearest)
    assert np.array_equal(map.crossed, slow.crossed)
    assert np.array_equal(map.behind, [[[len(slow.eyes[x, y, z]) for z in range(grid.shape[2])]
                                        for y in range(grid.shape[1])] for x in range(grid.shape[0])])  # fmt: skip
    assert map.outside == slow.outside > 0
    assert map.full == 0
    assert map.views == len(views)
    assert map.points.sum() + map.outside == sum(int(image.valid.sum()) for image, _ in views)


def test_labels_are_those_of_the_reference(scene):
    map, slow, *_ = scene
    assert np.array_equal(map.labels, slow.labels(map.open_outside))
    assert len(np.unique(map.labels)) >= 5


def test_mean_normals_are_those_of_the_reference(scene):
    map, slow, *_ = scene
    normals, held = map.normals(), np.argwhere(map.points > 0)
    compared = 0
    for voxel in map_keys(held):
        total = slow.mean_normal(voxel)
        rounding = 0.5 / UNIT * len(slow.normals[voxel])
        assert np.abs(map.normal_sum[voxel] / UNIT - total).max() <= rounding * (1 + 1e-9)
        length = np.linalg.norm(total)
        if length > 20 * rounding:
            assert np.abs(normals[voxel] - total / length).max() <= 2 * rounding / length + 1e-6
            compared += 1
    assert compared > 0.9 * len(held)


def test_occlusion_planes_face_the_empty_side_across_their_rays(scene):
    map, slow, grid, *_ = scene
    labels, normals = map.labels, map.normals()
    planes = np.argwhere(labels == PLANE)
    compared = 0
    for voxel in map_keys(planes):
        expected = slow.plane_normal(grid, voxel, labels, map.open_outside)
        length = np.linalg.norm(expected) / len(slow.eyes[voxel])
        if length > 0.02:
            assert np.abs(normals[voxel] - expected / np.linalg.norm(expected)).max() <= 2e-3 / length
            compared += 1
    assert compared > 0.6 * len(planes) > 0
    unknown = ~np.isin(labels, (OCCUPIED, BORDER, PLANE))
    assert not normals[unknown].any()


def map_keys(rows):
    return [tuple(int(v) for v in row) for row in rows]


def test_one_view_makes_planes_perpendicular_to_its_rays():
    grid, rng = GRIDS[0], np.random.default_rng(5)
    across, known = [], []
    for _ in range(12):
        T = random_pose(rng, grid, False)
        map = update(unknown_map(grid), random_image(rng, grid), T)
        planes = np.argwhere(map.labels == PLANE)
        ray = grid.origin + (planes + 0.5) * grid.cell - T[:3, 3]
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        normal = map.normals()[tuple(planes.T)]
        across.append(np.sum(normal * ray, axis=1))
        known.append(np.linalg.norm(normal, axis=1) > 0)
    across, known = np.abs(np.concatenate(across)), np.concatenate(known)
    assert known.sum() > 100
    assert known.mean() > 0.9
    assert np.quantile(across[known], 0.95) <= 1e-3
    assert across.max() <= 0.1


def test_any_order_of_views_gives_the_same_map(scene):
    map, _, grid, views, sensor = scene
    rng = np.random.default_rng(0)
    for order in (range(5, -1, -1), rng.permutation(6), rng.permutation(6)):
        other = unknown_map(grid, map.open_outside)
        for image, T in (views[i] for i in order):
            other = update(other, image, T, sensor)
        for name in ARRAYS:
            assert np.array_equal(getattr(other, name), getattr(map, name)), name
        assert (other.outside, other.full, other.views) == (map.outside, map.full, map.views)
        assert np.array_equal(other.normals(), map.normals())


def test_evidence_only_grows_and_the_map_before_is_kept(scene):
    _, _, grid, views, sensor = scene
    map = unknown_map(grid)
    for image, T in views:
        kept = {name: getattr(map, name).copy() for name in ARRAYS}
        after = update(map, image, T, sensor)
        assert all(np.array_equal(kept[name], getattr(map, name)) for name in ARRAYS)
        assert (after.points >= map.points).all()
        assert (after.nearest <= map.nearest).all()
        assert (after.crossed >= map.crossed).all()
        assert (after.behind >= map.behind).all()
        map = after


def test_each_view_adds_the_same_to_any_map(scene):
    """Incremental equals batch: what two views tell together is the sum and the union of what each tells alone."""
    _, _, grid, views, sensor = scene
    for one, two in itertools.pairwise(views):
        alone = [update(unknown_map(grid), image, T, sensor) for image, T in (one, two)]
        both = update(alone[0], two[0], two[1], sensor)
        for name in ("points", "normal_sum", "behind", "shadow_sum"):
            assert np.array_equal(getattr(both, name), getattr(alone[0], name) + getattr(alone[1], name))
        assert np.array_equal(both.crossed, alone[0].crossed | alone[1].crossed)
        assert np.array_equal(both.nearest, np.minimum(alone[0].nearest, alone[1].nearest))


def test_a_full_voxel_counts_no_more_and_says_so(monkeypatch):
    monkeypatch.setattr(map_update, "MOST", 7)
    grid = label_map.VoxelGrid(np.array([-2.0, -2.0, 0.0]), 1.0, (4, 4, 4))
    directions = pixel_rays(SENSOR).directions
    wall = RangeImage(directions / directions[..., 2:] * 2.5, np.ones((11, 13), bool))
    map = unknown_map(grid)
    for views in (1, 2):
        map = update(map, wall, np.eye(4))
        assert map.points.max() == 7
        assert map.points.sum() + map.full + map.outside == views * 143
        assert map.full > 0
    assert map.behind.max() == 2
    for _ in range(9):
        map = update(map, wall, np.eye(4))
    assert map.behind.max() == 7
    assert np.abs(map.shadow_sum).max() <= 7 * UNIT


@pytest.mark.parametrize("pose", [np.full((4, 4), np.nan), np.diag([1, 1, 1, np.inf])])
def test_a_pose_that_is_none_is_refused(pose):
    with pytest.raises(InputError, match="pose"):
        update(unknown_map(GRIDS[0]), random_image(np.random.default_rng(0), GRIDS[0]), pose)


def test_an_image_of_another_sensor_is_refused():
    with pytest.raises(InputError, match="13 x 11"):
        update(unknown_map(GRIDS[0]), random_image(np.random.default_rng(0), GRIDS[0]), np.eye(4), Sensor(12, 11))


def test_an_image_without_a_reading_tells_of_nothing_unless_its_rays_are_known():
    grid = GRIDS[0]
    nothing = RangeImage(np.full((11, 13, 3), np.nan), np.zeros((11, 13), bool))
    T = random_pose(np.random.default_rng(0), grid, True)
    silent = update(unknown_map(grid), nothing, T)
    assert not silent.labels.any()
    assert silent.views == 1
    told = update(unknown_map(grid), nothing, T, SENSOR)
    slow = Evidence(grid.shape)
    slow.add(grid, nothing, T, pixel_rays(SENSOR).directions.reshape(-1, 3), np.full(143, np.inf))
    assert np.array_equal(told.labels, slow.labels(False))
    assert told.crossed.any()


def test_an_orthographic_image_is_a_pinhole_image_from_far_away():
    grid, rng = GRIDS[0], np.random.default_rng(2)
    v, u = np.mgrid[:11, :13]
    points = np.stack([(u - 6.1) * 0.22, (v - 5.3) * 0.23, 0.1 + 0.7 * rng.random(u.shape)], axis=-1)
    T = np.eye(4)
    T[:3, 3] = grid.origin + 1.5
    flat = update(unknown_map(grid), RangeImage(points, u > 1, np.array([0.0, 0, -1, 0])), T)
    away = T.copy()
    away[2, 3] -= 500
    distant = update(unknown_map(grid), RangeImage(points + np.array([0, 0, 500]), u > 1), away)
    assert np.array_equal(flat.points, distant.points)
    assert (flat.labels == distant.labels).mean() > 0.99
    assert len(np.unique(flat.labels)) >= 5
