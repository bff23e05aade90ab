"""Clouds: what is refused and named, resolution, motion."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud, as_cloud, resolution
from jaxmodel.scan.range_image import RangeImage


def test_resolution_of_a_lattice_is_its_step_and_ignores_repeats():
    lattice = np.stack(np.meshgrid(*[np.arange(5) * 0.25] * 3), axis=-1).reshape(-1, 3)
    assert resolution(lattice) == 0.25
    assert resolution(np.concatenate([lattice, lattice])) == 0.25


def test_resolution_scales_with_the_cloud():
    points = np.random.default_rng(0).normal(size=(200, 3))
    assert resolution(8.0 * points) == 8.0 * resolution(points)


def test_resolution_of_one_place_is_refused():
    with pytest.raises(InputError, match="two distinct points"):
        resolution(np.ones((5, 3)))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), "is empty"),
        (np.zeros((2, 3)), "has only 2 points"),
        (np.zeros((1, 3)), "has only 1 point:"),
        (np.ones((7, 3)), "all 7 points are equal"),
        (np.zeros((5, 2)), r"shape \(n, 3\)"),
        (np.zeros((4, 5, 3)), r"shape \(n, 3\)"),
        (np.array([["a", "b", "c"]] * 4), r"shape \(n, 3\)"),
        ([[1, 2, 3], [4, 5]], "not an array of points"),
    ],
)
def test_a_cloud_without_content_is_refused(points, message):
    with pytest.raises(InputError, match=message):
        as_cloud(points)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_the_first_point_that_is_not_finite_is_named(value):
    points = np.random.default_rng(1).normal(size=(20, 3))
    points[13, 1] = value
    points[17, 0] = value
    with pytest.raises(InputError, match=r"left\.ply: point 13 .*2 of 20"):
        as_cloud(points, "left.ply")
    with pytest.raises(InputError, match="point 13 "):
        as_cloud(Cloud(points=points))


def test_a_range_image_of_two_readings_is_refused():
    points = np.full((4, 4, 3), np.nan)
    points[0, 0], points[2, 1] = (0, 0, 1), (0, 1, 1)
    with pytest.raises(InputError, match="only 2 points"):
        as_cloud(RangeImage(points, np.isfinite(points[..., 0])))


def test_integer_points_become_floats():
    cloud = as_cloud(np.arange(12).reshape(4, 3))
    assert cloud.points.dtype == np.float64
    assert len(cloud) == 4


def test_a_checked_cloud_comes_back_as_it_is():
    cloud = Cloud(points=np.random.default_rng(2).normal(size=(9, 3)))
    assert as_cloud(cloud) is cloud


def test_take_and_moved_carry_normals_and_borders():
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(6, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = Cloud(rng.normal(size=(6, 3)), normals, np.arange(6) % 2 == 0)
    T = np.array([[0, -1, 0, 5.0], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
    part = cloud.moved(T).take(np.array([4, 1]))
    assert part.normals is not None and part.border is not None
    np.testing.assert_allclose(part.points, cloud.points[[4, 1]] @ T[:3, :3].T + T[:3, 3])
    np.testing.assert_allclose(part.normals, normals[[4, 1]] @ T[:3, :3].T)
    assert part.border.tolist() == [True, False]
