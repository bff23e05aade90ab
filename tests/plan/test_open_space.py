import numpy as np
import pytest

from jaxmodel.plan.labels import LABELS, Label
from jaxmodel.plan.open_space import FARTHEST, cubes_ahead, octants, space_of

SHAPES = [(6, 5, 7), (1, 9, 2), (1, 1, 1), (11, 3, 8)]


def _mirrored(array, falls):
    return array[tuple(slice(None, None, -1 if f else 1) for f in falls)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("share", [0.02, 0.2, 0.9, 1.0])
def test_the_cube_ahead_is_empty_and_no_larger_one_is(shape, share):
    """What lies beyond the map stops nothing: a cube may stick out of it, at most as wide as the map is long."""
    empty = np.random.default_rng(1).random(shape) >= share
    for edges, falls in zip(cubes_ahead(empty), octants(), strict=True):
        seen = _mirrored(empty, falls)
        for voxel in np.ndindex(shape):
            edge = int(edges[voxel])
            within = lambda n, at=voxel, seen=seen: seen[tuple(slice(i, i + n) for i in at)]  # noqa: E731
            assert within(edge).all() or edge == 0
            assert edge == max(shape) or not within(edge + 1).all()


def test_an_empty_map_is_crossed_in_one_cube_and_a_long_one_in_the_longest():
    assert (cubes_ahead(np.ones((4, 9, 3), bool)) == 9).all()
    assert (cubes_ahead(np.ones((300, 1, 1), bool)) == FARTHEST).all()


def test_codes_hold_the_labels_that_stop_a_ray():
    rng = np.random.default_rng(2)
    labels = np.where(rng.random((5, 4, 6)) < 0.5, rng.integers(0, LABELS, (5, 4, 6)), Label.EMPTY).astype(np.int8)
    normals = rng.normal(size=(5, 4, 6, 3)).astype(np.float32)
    space = space_of(labels, normals)
    tables = np.asarray(space.code).reshape(8, 5, 4, 6)
    for table, falls in zip(tables, octants(), strict=True):
        seen = _mirrored(labels, falls)
        stops = seen != Label.EMPTY
        assert np.array_equal(-table[stops], seen[stops])
        assert (table[~stops] >= 1).all()
    assert np.array_equal(np.asarray(space.normal).T.reshape(normals.shape), normals)
