import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from map_cases import GRIDS, axis_pose, random_pose
from reference_march import BORDER, EMPTY, OCCUPIED, UNKNOWN, first_met, walk

from jaxmodel.errors import InputError
from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.lanes import Engine, _cores
from jaxmodel.plan.label_map import unknown_map
from jaxmodel.plan.labels import LABELS
from jaxmodel.plan.map_update import update
from jaxmodel.plan.open_space import space_of
from jaxmodel.plan.ray_march import in_cells, look, march, march_kernel, ready, run_views
from jaxmodel.plan.seen import NOTHING
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays

SENSOR = Sensor(12, 9, field_of_view_deg=75.0)
VIEWS = 24


def _scene(which: int, density: float, seed: int):
    """A grid, random labels in it, random unit normals (none of unknown voxels), and poses of every kind."""
    rng = np.random.default_rng(seed)
    grid = GRIDS[which]
    labels = np.where(rng.random(grid.shape) < density, rng.integers(0, LABELS, grid.shape), EMPTY).astype(np.int8)
    normals = rng.normal(size=(*grid.shape, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = np.where(np.isin(labels, (UNKNOWN, EMPTY))[..., None], 0, normals).astype(np.float32)
    size = np.asarray(grid.shape)
    poses = [random_pose(rng, grid, inside) for inside in (True, False) for _ in range(VIEWS // 2 - 3)]
    for axis in range(3):
        poses += [axis_pose(grid, axis, size // 2), axis_pose(grid, axis, size // 2 - 0.5 - 20 * np.eye(3)[axis])]
    return grid, labels, normals, np.stack(poses)


def _expected(grid, labels, normals, poses, sensor, distinct=False):
    """Counts and cosines by the slow reference, and the first voxel of each ray (key, -1 for none) with its time."""
    kernel = march_kernel(unknown_map(grid), sensor, space_of(labels, normals))
    origins, directions = np.asarray(kernel.origins), np.asarray(kernel.directions)
    low, high = np.asarray(kernel.nearest), np.asarray(kernel.farthest)
    counts, cosines, keys, times = [], [], [], []
    for item in in_cells(unknown_map(grid), poses):
        count, cosine, seen = np.zeros(LABELS, int), np.zeros(LABELS), set()
        for ray in range(directions.shape[1]):
            turned = [_turned(item[:3, :3], rows[:, ray]) for rows in (origins, directions)]
            voxel, time = first_met(turned[0] + item[:3, 3], turned[1], labels, low, high)
            keys.append(-1 if voxel is None else int(np.ravel_multi_index(voxel, grid.shape)))
            times.append(time)
            if voxel is None or (distinct and voxel in seen):
                continue
            seen.add(voxel)
            count[labels[voxel]] += 1
            cosine[labels[voxel]] += max(0.0, -float(normals[voxel].astype(float) @ turned[1].astype(float)))
        counts.append(count)
        cosines.append(cosine)
    return np.stack(counts), np.stack(cosines), np.reshape(keys, (len(poses), -1)), np.reshape(times, (len(poses), -1))


def _turned(R, row):
    """float32, summed in the order of the axes."""
    return np.asarray([(R[a, 0] * row[0] + R[a, 1] * row[1]) + R[a, 2] * row[2] for a in range(3)], np.float32)


def _looked(grid, labels, normals, poses, sensor, distinct=False, engine=None):
    return look(unknown_map(grid), poses, sensor, distinct, space_of(labels, normals), engine)


CASES = [(which, density, seed) for which in (0, 1) for seed, density in enumerate((0.01, 0.05, 0.3, 1.0))]


@pytest.mark.parametrize(("which", "density", "seed"), CASES)
def test_each_ray_meets_the_voxel_of_the_reference(which, density, seed):
    grid, labels, normals, poses = _scene(which, density, seed)
    kernel = march_kernel(unknown_map(grid), SENSOR, space_of(labels, normals), keep_rays=True)
    label, key, entered = run_views(kernel, in_cells(unknown_map(grid), poses))
    _, _, keys, times = _expected(grid, labels, normals, poses, SENSOR)
    assert np.array_equal(key, keys)
    # a compiler may join the product and the sum where rays are turned: their last bit, and that of a time
    assert np.allclose(entered[keys >= 0], times[keys >= 0], rtol=1e-6, atol=1e-6)
    assert np.array_equal(label, np.where(key >= 0, labels.reshape(-1)[key], NOTHING))


@pytest.mark.parametrize("distinct", [False, True])
@pytest.mark.parametrize(("which", "density", "seed"), CASES[1:4] + CASES[5:7])
def test_counts_and_cosines_are_those_of_the_reference(which, density, seed, distinct):
    grid, labels, normals, poses = _scene(which, density, seed)
    seen = _looked(grid, labels, normals, poses, SENSOR, distinct)
    counts, cosines, keys, _ = _expected(grid, labels, normals, poses, SENSOR, distinct)
    assert np.array_equal(seen.counts, counts)
    if distinct:
        assert np.array_equal(seen.counts.sum(axis=1), [len(set(row) - {-1}) for row in keys.tolist()])
        # one ray stands for a voxel, whichever: its cosine lies between the least and the greatest
        assert (seen.cosines <= seen.counts).all()
    else:
        assert np.allclose(seen.cosines, cosines, atol=1e-4)
    assert seen.total == 108
    assert np.array_equal(seen.shares, seen.counts / 108)
    assert np.array_equal(seen.cosines[:, UNKNOWN], np.zeros(len(poses)))
    assert not seen.counts[:, EMPTY].any()


@pytest.mark.parametrize("distinct", [False, True])
@pytest.mark.parametrize(("low", "high"), [(None, 2.0), (1.0, None), (0.75, 1.5), (0.5, 0.50001), (30.0, 31.0)])
def test_range_limits(low, high, distinct):
    grid, labels, normals, poses = _scene(0, 0.1, 7)
    sensor = Sensor(12, 9, field_of_view_deg=75.0, minimum_range=low, maximum_range=high)
    seen = _looked(grid, labels, normals, poses, sensor, distinct)
    counts, *_ = _expected(grid, labels, normals, poses, sensor, distinct)
    assert np.array_equal(seen.counts, counts)


def test_limits_part_the_rays():
    """Every ray that meets something does so nearer than a limit or beyond it: the limits take away, never add."""
    grid, labels, normals, poses = _scene(1, 0.1, 8)
    whole = _looked(grid, labels, normals, poses, SENSOR).counts
    near = _looked(grid, labels, normals, poses, Sensor(12, 9, field_of_view_deg=75.0, maximum_range=2.3456)).counts
    far = _looked(grid, labels, normals, poses, Sensor(12, 9, field_of_view_deg=75.0, minimum_range=2.3456)).counts
    assert np.array_equal(near + far, whole)
    assert near.any()
    assert far.any()


def test_crossed_limits_are_refused():
    with pytest.raises(InputError, match="minimum_range < maximum_range"):
        Sensor(12, 9, minimum_range=2.0, maximum_range=1.0)


def test_a_map_entered_beyond_the_farthest_distance_is_not_seen():
    grid = GRIDS[0]
    pose = axis_pose(grid, 2, [6.3, 6.3, -10])[None]
    reach = 10 * grid.cell
    for factor, sees in ((0.99, False), (1.3, True)):
        sensor = Sensor(12, 9, field_of_view_deg=20.0, maximum_range=factor * reach)
        assert march(unknown_map(grid), pose, sensor).any() == sees


def test_orthographic_rays():
    grid, labels, normals, poses = _scene(0, 0.05, 9)
    sensor = Sensor(12, 9, projection="orthographic", window=2.7)
    seen = _looked(grid, labels, normals, poses, sensor)
    assert np.array_equal(seen.counts, _expected(grid, labels, normals, poses, sensor)[0])


def test_a_sensor_inside_something_sees_only_that():
    grid = GRIDS[0]
    labels = np.full(grid.shape, EMPTY, np.int8)
    labels[5, 6, 7] = OCCUPIED
    pose = axis_pose(grid, 1, [5.4, 6.5, 7.7])[None]
    for distinct, count in ((False, 108), (True, 1)):
        seen = _looked(grid, labels, np.zeros((*grid.shape, 3), np.float32), pose, SENSOR, distinct)
        assert seen.counts.tolist() == [[0, 0, count, 0, 0, 0]]


def test_a_map_without_anything_stops_no_ray():
    grid, _, normals, poses = _scene(1, 0.1, 1)
    seen = _looked(grid, np.full(grid.shape, EMPTY, np.int8), normals, poses, SENSOR)
    assert not seen.counts.any()
    assert not seen.cosines.any()
    assert not seen.quality.any()


def test_a_map_not_yet_seen_is_unknown_where_rays_enter_it():
    grid, _, _, poses = _scene(0, 0.1, 1)
    counts = march(unknown_map(grid), poses, SENSOR)
    rays = pixel_rays(SENSOR).directions.reshape(-1, 3)
    for pose, count in zip(poses, counts, strict=True):
        eye = (pose[:3, 3] - grid.origin) / grid.cell
        meets = sum(any(True for _ in walk(eye, direction, grid.shape)) for direction in rays @ pose[:3, :3].T)
        assert count.tolist() == [meets, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("views", [1, 7, 150, 153])
def test_a_view_counts_the_same_whatever_the_others(views):
    """Grouped or alone, padded or not, in any order, by cores or by lanes."""
    grid, labels, normals, poses = _scene(0, 0.05, 3)
    many = np.tile(poses, (8, 1, 1))[:views]
    alone = _looked(grid, labels, normals, poses, SENSOR, engine=Engine(chunk=1))
    seen = _looked(grid, labels, normals, many, SENSOR)
    rows = np.arange(views) % len(poses)
    assert np.array_equal(seen.counts, alone.counts[rows])
    assert np.array_equal(seen.cosines, alone.cosines[rows])
    back = _looked(grid, labels, normals, many[::-1], SENSOR, distinct=True)
    forth = _looked(grid, labels, normals, many, SENSOR, distinct=True)
    assert np.array_equal(back.counts[::-1], forth.counts)
    lanes = _looked(grid, labels, normals, many, SENSOR, engine=Engine("lanes", lanes=3, chunk=5))
    assert np.array_equal(lanes.counts, seen.counts)


def test_skipping_changes_no_bit():
    """Steps of one voxel, cubes of every size: the same voxels at the same times."""
    grid, labels, normals, poses = _scene(0, 0.01, 4)
    kernel = march_kernel(unknown_map(grid), SENSOR, space_of(labels, normals), keep_rays=True)
    fast = run_views(kernel, in_cells(unknown_map(grid), poses))
    one = jnp.minimum(kernel.space.code, 1)
    slow = eqx.tree_at(lambda k: k.space.code, kernel, one)
    for a, b in zip(fast, run_views(slow, in_cells(unknown_map(grid), poses)), strict=True):
        assert np.array_equal(a, b)


def test_what_a_scan_has_met_is_met_again():
    """A map of one wall, looked at from where it was scanned: every ray meets the wall, at its own angle."""
    grid = GRIDS[0]
    T = np.eye(4)
    T[:3, 3] = grid.origin + np.array([1.5, 1.5, -1.0])
    sensor = Sensor(12, 9, field_of_view_deg=40.0)
    directions = pixel_rays(sensor).directions
    wall = RangeImage(directions / directions[..., 2:] * 2.2, np.ones(directions.shape[:2], bool))
    map = update(unknown_map(grid, open_outside=True), wall, T, sensor)
    seen = look(map, T[None], sensor, space=ready(map))
    assert seen.counts[0, OCCUPIED] + seen.counts[0, BORDER] == 108
    assert seen.cosines[0].sum() == pytest.approx(directions[..., 2].sum(), rel=1e-5)


def test_poses_that_are_none_are_refused():
    grid, _, _, poses = _scene(0, 0.1, 1)
    bad = poses.copy()
    bad[3, 1, 2] = np.nan
    with pytest.raises(InputError, match="Pose 3"):
        march(unknown_map(grid), bad, SENSOR)
    bad[3, 1, 2] = np.inf
    with pytest.raises(InputError, match="not finite"):
        march(unknown_map(grid), bad, SENSOR)


def test_no_views_give_no_rows():
    assert march(unknown_map(GRIDS[0]), np.zeros((0, 4, 4)), SENSOR).shape == (0, LABELS)


def test_a_map_too_long_for_the_state_of_a_ray_is_refused():
    grid = VoxelGrid(np.zeros(3), 1.0, (2, 2000, 2))
    with pytest.raises(InputError, match="1023"):
        march(unknown_map(grid), np.eye(4)[None], SENSOR)


def test_one_program_serves_maps_poses_and_limits():
    """Nothing is compiled again for another map, other views or other limits."""
    program = _cores(len(jax.devices()), False)
    _looked(*_scene(0, 0.05, 3), SENSOR)
    before = program._cache_size()
    grid, labels, normals, poses = _scene(0, 0.5, 11)
    limited = Sensor(12, 9, field_of_view_deg=60.0, minimum_range=0.5, maximum_range=2.0)
    _looked(grid, labels, normals, poses[:20], limited)
    assert program._cache_size() == before
