"""Laws of the three filters: nothing real is removed from a smooth surface, nothing spans a gap or a jump."""

import numpy as np
import pytest
from edge_maps import height_field
from split_scenes import terrace_heights, waves

from jaxmodel.control_points.image_surfaces import surfaces_of
from jaxmodel.control_points.mesh_filters import Filtered, filter_triangles
from jaxmodel.control_points.pixel_triangulation import HORIZON, doubled_places, pixels_of, triangulate
from jaxmodel.scan.range_image import RangeImage


def filtered(image: RangeImage, pixels: np.ndarray, shape: float = 0.0) -> tuple[np.ndarray, Filtered]:
    """Triangles of ``pixels`` and what is left of them."""
    surfaces, size = surfaces_of(image), (image.valid.shape[0], image.valid.shape[1])
    places, triangles = doubled_places(size, pixels), triangulate(size, pixels)
    within = pixels_of(size, places, triangles)
    return triangles, filter_triangles(surfaces, places, triangles, within, 0.5, shape)


def lattice(rows: range, columns: range) -> np.ndarray:
    return np.array([(row, column) for row in rows for column in columns])


@pytest.mark.parametrize("slope", [0.0, 1.0, 3.0])
def test_only_the_horizon_is_removed_from_a_plane(slope: float) -> None:
    _, x = np.indices((40, 60)).astype(float)
    triangles, left = filtered(height_field(slope * x), lattice(range(0, 40, 3), range(0, 60, 5)))
    np.testing.assert_array_equal(left.kept, triangles.min(axis=1) >= HORIZON)
    assert left.horizon == np.count_nonzero(~left.kept) and left.density == left.shape == 0


def test_nothing_is_removed_from_a_bent_surface_with_dropouts() -> None:
    image = waves()
    lost = np.random.default_rng(0).random(image.valid.shape) < 0.05
    points = np.where(lost[..., None], np.nan, image.points)
    dropped = RangeImage(points, image.valid & ~lost, image.eye)
    pixels = np.argwhere(dropped.valid & (np.indices(lost.shape)[1] > 25))[::7]
    triangles, left = filtered(dropped, pixels)
    np.testing.assert_array_equal(left.kept, triangles.min(axis=1) >= HORIZON)


def test_no_triangle_is_left_over_a_gap() -> None:
    image = waves()
    pixels = np.argwhere(image.valid)[::3]
    triangles, left = filtered(image, pixels)
    places = doubled_places((50, 60), pixels)
    within = pixels_of((50, 60), places, triangles)
    gap = surfaces_of(image).gap.ravel()[within.pixel]
    share = np.bincount(within.triangle[gap], minlength=len(triangles)) / np.maximum(np.diff(within.start), 1)
    assert left.kept[share == 0].sum() == np.count_nonzero((triangles.min(axis=1) >= HORIZON) & (share == 0))
    assert not left.kept[(share > 0.5) & (np.diff(within.start) > 2)].any()
    assert not left.kept[within.triangle[within.pixel == 20 * 60 + 15]].any()


@pytest.mark.parametrize("step", [1, 2, 5])
def test_no_triangle_is_left_across_a_jump(step: int) -> None:
    z = terrace_heights()
    pixels = lattice(range(0, 60, step), range(0, 80, step))
    triangles, left = filtered(height_field(z), pixels)
    level = np.append(np.full(HORIZON, np.nan), z[pixels[:, 0], pixels[:, 1]])[triangles]
    inside = triangles.min(axis=1) >= HORIZON
    np.testing.assert_array_equal(left.kept, inside & (np.ptp(level, axis=1) == 0))
    assert left.density == np.count_nonzero(inside & (np.ptp(level, axis=1) > 0))


def test_slivers_are_removed_by_their_shape_alone() -> None:
    image = height_field(np.zeros((40, 60)))
    pixels = lattice(range(0, 40, 13), range(60))  # right triangles, 13 times as long as wide: 0.0089
    triangles, left = filtered(image, pixels, shape=0.0088)
    assert left.shape == 0
    triangles, left = filtered(image, pixels, shape=0.0090)
    long = np.ptp(np.append(np.full(HORIZON, -1), pixels[:, 0])[triangles], axis=1) == 13
    inside = triangles.min(axis=1) >= HORIZON
    np.testing.assert_array_equal(left.kept, inside & ~long)
    assert left.shape == np.count_nonzero(inside & long) > 300


def test_counts_add_up() -> None:
    image = height_field(terrace_heights())
    triangles, left = filtered(image, np.argwhere(image.valid)[::5], shape=0.03)
    assert left.horizon + left.density + left.shape + left.kept.sum() == len(triangles)
    assert min(left.horizon, left.density, left.shape) > 0
