import equinox as eqx
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.plan.label_map import MOST, UNIT, object_map, unknown_map
from jaxmodel.plan.labels import Label

GRID = VoxelGrid(np.array([1.0, -2.0, 0.5]), 0.5, (3, 5, 4))


def test_nothing_is_known_of_a_new_map():
    map = unknown_map(GRID)
    assert map.labels.shape == GRID.shape
    assert not map.labels.any()
    assert map.share(Label.UNKNOWN) == 1
    assert not map.normals().any()
    assert np.isinf(map.nearest).all()
    assert (map.outside, map.full, map.views) == (0, 0, 0)


def test_of_an_object_only_the_ball_around_it_is_unknown():
    centre, size = np.array([0.3, -1.0, 20.0]), 3.0
    map = object_map(centre, size, cells=24)
    assert map.grid.shape == (24, 24, 24)
    assert np.allclose(map.grid.origin + 12 * map.grid.cell, centre)
    labels = map.labels
    assert set(np.unique(labels)) == {Label.UNKNOWN, Label.EMPTY}
    rng = np.random.default_rng(0)
    inside = rng.normal(size=(5000, 3))
    inside *= (size / 2 * rng.random((5000, 1)) ** (1 / 3)) / np.linalg.norm(inside, axis=1, keepdims=True)
    assert (map.label_at(centre + inside) == Label.UNKNOWN).all()
    away = np.linalg.norm(map.grid.centres(np.arange(24**3)) - centre, axis=1)
    assert (away[labels.reshape(-1) == Label.UNKNOWN] <= size / 2 + map.grid.cell * np.sqrt(3) / 2).all()


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf])
def test_an_object_without_a_size_is_refused(size):
    with pytest.raises(InputError, match="size of the object"):
        object_map(np.zeros(3), size)


@pytest.mark.parametrize("margin", [-0.1, np.nan, np.inf])
def test_a_margin_that_is_none_is_refused(margin):
    with pytest.raises(InputError, match="margin"):
        object_map(np.zeros(3), 1.0, margin=margin)


@pytest.mark.parametrize("cells", [1, 0, -3])
def test_voxels_larger_than_the_object_are_refused(cells):
    with pytest.raises(InputError, match="larger than the object"):
        object_map(np.zeros(3), 1.0, cells=cells)


def test_a_label_is_that_of_the_voxel_a_point_lies_in():
    map = unknown_map(GRID)
    points = map.points.copy()
    points[2, 4, 0] = 3
    map = eqx.tree_at(lambda m: m.points, map, points)
    where = GRID.origin + np.array([[1.25, 2.25, 0.1], [1.25, 2.25, 0.6], [1.6, 2.25, 0.1], [-9, 0, 0]])
    assert map.label_at(where).tolist() == [Label.BORDER, Label.UNKNOWN, Label.UNKNOWN, Label.UNKNOWN]
    opened = eqx.tree_at(lambda m: m.points, unknown_map(GRID, open_outside=True), points)
    assert opened.label_at(where)[2:].tolist() == [Label.EMPTY, Label.EMPTY]


def test_a_mean_shorter_than_its_rounding_is_no_normal():
    map = unknown_map(GRID)
    points, total = map.points.copy(), map.normal_sum.copy()
    points[0, 0, :3] = 2, 1000, 1000
    total[0, 0, :3] = [0, 0, 0], [300, -300, 300], [3000, 0, -4000]
    normals = eqx.tree_at(lambda m: (m.points, m.normal_sum), map, (points, total)).normals()
    assert not normals[0, 0, :2].any()
    assert normals[0, 0, 2] == pytest.approx([0.6, 0, -0.8], abs=1e-6)


def test_sums_hold_what_the_most_readings_add():
    """Unit directions and their products are at most ``UNIT`` each."""
    assert MOST * UNIT < 2**31
    assert (MOST + 2) * UNIT > 2**31


def test_a_plane_normal_survives_any_number_of_views():
    """The mean over views does not depend on how often one view is repeated."""
    map = unknown_map(GRID)
    crossed, behind, shadow = map.crossed.copy(), map.behind.copy(), map.shadow_sum.copy()
    crossed[1, 2, 3], crossed[0, 2, 2] = True, True
    ray = np.array([0.0, 0.6, 0.8])
    found = []
    for times in (1, 7, MOST):
        behind[1, 2, 2] = times
        x, y, z = ray
        shadow[1, 2, 2] = np.rint(np.array([x * x, x * y, x * z, y * y, y * z, z * z]) * UNIT).astype(int) * times
        one = eqx.tree_at(lambda m: (m.crossed, m.behind, m.shadow_sum), map, (crossed, behind, shadow))
        assert one.labels[1, 2, 2] == Label.OCCLUSION_PLANE
        found.append(one.normals()[1, 2, 2])
    towards = np.array([-1.0, 0, 1])
    expected = towards - (towards @ ray) * ray
    assert np.allclose(found, expected / np.linalg.norm(expected), atol=3e-4)
    assert np.array_equal(found[0], found[1])
