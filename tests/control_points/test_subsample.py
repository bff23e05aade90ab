"""Laws of plain subsampling: how many points, which ones, and what must not change them."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxmodel.control_points import farthest_point_subsample, random_subsample, voxel_subsample
from jaxmodel.errors import InputError

KINDS = {
    "voxel": voxel_subsample,
    "random": lambda points, count: random_subsample(points, count, jax.random.key(0)),
    "farthest": farthest_point_subsample,
}


def bumpy_sheet(seed: int, n: int = 3000) -> np.ndarray:
    """A curved sheet sampled three times as densely on one side as on the other."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 1.0, n) ** 1.5
    y = rng.uniform(0.0, 2.0, n)
    return np.stack([x, y, 0.2 * np.sin(3 * x) * np.cos(2 * y)], axis=1)


@pytest.mark.parametrize("how", KINDS)
@given(seed=st.integers(0, 1000), count=st.integers(1, 400))
def test_exact_count_of_distinct_sorted_indices(how: str, seed: int, count: int) -> None:
    kept = KINDS[how](bumpy_sheet(seed, 500), count)
    assert kept.shape == (count,)
    assert np.all(np.diff(kept) > 0)
    assert kept[0] >= 0 and kept[-1] < 500


@pytest.mark.parametrize("how", KINDS)
@pytest.mark.parametrize("count", [50, 51, 10_000])
def test_asking_more_than_present_gives_all(how: str, count: int) -> None:
    np.testing.assert_array_equal(KINDS[how](bumpy_sheet(1, 50), count), np.arange(50))


@pytest.mark.parametrize("how", KINDS)
def test_coincident_points_still_give_the_count(how: str) -> None:
    points = np.repeat(bumpy_sheet(2, 10), 5, axis=0)
    assert len(np.unique(KINDS[how](points, 30))) == 30


@pytest.mark.parametrize("how", KINDS)
def test_points_all_equal_still_give_the_count(how: str) -> None:
    assert len(np.unique(KINDS[how](np.ones((20, 3)), 7))) == 7


@pytest.mark.parametrize("how", ["voxel", "farthest"])
def test_distinct_places_come_before_repetitions(how: str) -> None:
    points = np.repeat(bumpy_sheet(2, 10), 5, axis=0)
    assert len(np.unique(points[KINDS[how](points, 10)], axis=0)) == 10


@pytest.mark.parametrize("how", KINDS)
@pytest.mark.parametrize("count", [0, -5])
def test_counts_below_one_are_refused(how: str, count: int) -> None:
    with pytest.raises(InputError, match=f"count is {count}"):
        KINDS[how](bumpy_sheet(3, 20), count)


@pytest.mark.parametrize("how", KINDS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_points_that_are_not_finite_are_named(how: str, value: float) -> None:
    points = bumpy_sheet(3, 20)
    points[7, 1] = value
    with pytest.raises(InputError, match="point 7 "):
        KINDS[how](points, 5)


@pytest.mark.parametrize("how", KINDS)
def test_unit_does_not_matter(how: str) -> None:
    points = bumpy_sheet(4)
    np.testing.assert_array_equal(KINDS[how](points, 200), KINDS[how](1024.0 * points, 200))


def test_inexact_voxel_count_is_within_a_few_percent() -> None:
    for count in (30, 100, 300, 1000):
        found = len(voxel_subsample(bumpy_sheet(5), count, exact=False))
        assert abs(found - count) <= 0.03 * count


def test_voxels_even_out_the_density() -> None:
    points = bumpy_sheet(6)
    spread = {}
    for how in ("voxel", "random"):
        chosen = points[KINDS[how](points, 300)]
        nearest = KDTree(chosen).query(chosen, k=2)[0][:, 1]
        spread[how] = nearest.std() / nearest.mean()
    assert spread["voxel"] < 0.7 * spread["random"]


def test_each_voxel_is_represented_by_the_point_nearest_to_its_mean() -> None:
    # Five small groups far apart: five voxels hold one group each, and a group's first point is its mean.
    centres = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 1.0], [0.0, 5.0, 2.0], [5.0, 5.0, 3.0], [9.5, 1.0, 0.0]])
    group = 0.01 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    points = (centres[:, None] + group).reshape(-1, 3)
    np.testing.assert_array_equal(voxel_subsample(points, 5), np.arange(0, 25, 5))


@given(seed=st.integers(0, 1000))
def test_random_is_by_key_and_nested(seed: int) -> None:
    points = bumpy_sheet(7, 400)
    key = jax.random.key(seed)
    small, large = random_subsample(points, 40, key), random_subsample(points, 90, key)
    assert set(small) < set(large)
    np.testing.assert_array_equal(large, random_subsample(points, 90, key))
    assert set(large) != set(random_subsample(points, 90, jax.random.fold_in(key, 1)))


def test_random_is_uniform() -> None:
    draws = [random_subsample(bumpy_sheet(8, 20), 5, jax.random.key(i)) for i in range(400)]
    hits = np.bincount(np.concatenate(draws), minlength=20)
    # Each point is hit 100 times in the mean with a standard deviation of 8.7.
    assert hits.min() > 60 and hits.max() < 140


@given(seed=st.integers(0, 1000), count=st.integers(2, 100))
def test_farthest_points_are_apart_at_least_as_far_as_they_reach(seed: int, count: int) -> None:
    points = bumpy_sheet(seed, 300)
    chosen = points[farthest_point_subsample(points, count)]
    apart = KDTree(chosen).query(chosen, k=2)[0][:, 1].min()
    reach = KDTree(chosen).query(points)[0].max()
    assert apart >= reach - 1e-12


@given(seed=st.integers(0, 1000))
def test_farthest_points_follow_a_rigid_motion(seed: int) -> None:
    points = bumpy_sheet(seed, 300)
    moved = points @ Rotation.random(rng=np.random.default_rng(seed)).as_matrix().T + [5.0, -3.0, 1.0]
    np.testing.assert_array_equal(farthest_point_subsample(points, 40), farthest_point_subsample(moved, 40))
