"""Laws of surfaces in range images: where they are linked, torn, missing, and how far a pixel is from an outline."""

import numpy as np
import pytest
from edge_maps import height_field
from split_scenes import scanned, terrace_heights

from jaxmodel.control_points.image_surfaces import as_range_image, surfaces_of
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage, borders


def test_a_plane_is_one_surface_with_the_image_edge_as_its_outline() -> None:
    found = surfaces_of(height_field(np.zeros((20, 30))))
    assert found.down[:-1].all() and not found.down[-1].any()
    assert found.right[:, :-1].all() and not found.right[:, -1].any()
    assert not found.jump.any() and not found.gap.any()
    row, column = np.indices((20, 30))
    from_edge = np.minimum.reduce([row, 19 - row, column, 29 - column])
    np.testing.assert_array_equal(found.outline, from_edge == 0)
    np.testing.assert_allclose(found.depth, from_edge)
    np.testing.assert_allclose(found.spacing, 1.0)
    assert found.noise == 0.0


def test_both_sides_of_a_jump_are_outline_and_not_linked() -> None:
    z = terrace_heights()
    found = surfaces_of(height_field(z))
    high = z > 0
    np.testing.assert_array_equal(found.down[:-1], high[:-1] == high[1:])
    np.testing.assert_array_equal(found.right[:, :-1], high[:, :-1] == high[:, 1:])
    beside = np.zeros_like(high)
    for axis in (0, 1):
        a, b = np.swapaxes(high, 0, axis), np.swapaxes(beside, 0, axis)
        b[:-1] |= a[:-1] != a[1:]
        b[1:] |= a[:-1] != a[1:]
    np.testing.assert_array_equal(found.jump, beside)


@pytest.mark.parametrize("name", ["block_steps", "boulder"])
def test_outlines_are_the_borders_of_the_range_image_where_nothing_drops_out(name: str) -> None:
    image = scanned(name, 120)
    found = surfaces_of(image)
    # a narrow place without readings is a border of the image, and here a dropout
    narrow = ~image.valid & ~found.gap
    beside = np.zeros_like(narrow)
    beside[1:] |= narrow[:-1]
    beside[:-1] |= narrow[1:]
    beside[:, 1:] |= narrow[:, :-1]
    beside[:, :-1] |= narrow[:, 1:]
    both = image.valid & ~beside
    missed = borders(image)[both] & ~found.outline[both]  # a jump that the noise explains
    assert not (found.outline[both] & ~borders(image)[both]).any()
    assert missed.sum() <= 0.01 * found.outline.sum()


def test_wide_gaps_are_gaps_and_dropouts_are_reached_across() -> None:
    z = np.zeros((30, 40))
    z[10:16, 10:18] = np.nan
    z[5, 30] = z[20:22, 30] = np.nan
    found = surfaces_of(height_field(z))
    expected = np.zeros(z.shape, dtype=bool)
    expected[10:16, 10:18] = True
    np.testing.assert_array_equal(found.gap, expected)
    assert found.right[5, 29:31].all() and found.down[19:22, 30].all()
    assert not found.outline[4:7, 29:32].any()
    np.testing.assert_array_equal(found.valid, np.isfinite(z))
    assert found.depth[13, 13] == 3.0 and found.depth[10, 10] == 1.0
    assert found.outline[9, 12] and found.outline[16, 12]


def test_nearest_readings_stand_in_for_missing_ones() -> None:
    z = np.zeros((8, 9))
    z[3, 4] = np.nan
    found = surfaces_of(height_field(z))
    row, column = divmod(int(found.nearest[3, 4]), 9)
    assert abs(row - 3) + abs(column - 4) == 1
    np.testing.assert_array_equal(found.points[3, 4], found.points[row, column])
    np.testing.assert_array_equal(np.delete(found.nearest.ravel(), 31), np.delete(np.arange(72), 31))


def test_noise_does_not_tear_a_surface() -> None:
    z = 3.0 * np.random.default_rng(0).standard_normal((60, 60))
    found = surfaces_of(height_field(z))
    assert found.noise == pytest.approx(3.0, rel=0.05)
    assert found.right[:, :-1].mean() > 0.999


def test_unit_and_precision_do_not_matter() -> None:
    z = np.where(np.indices((20, 30))[1] < 12, 0.0, 9.0)
    plain, small = surfaces_of(height_field(z)), surfaces_of(height_field(z, 1 / 1024))
    for a, b in zip(plain, small, strict=True):
        if isinstance(a, np.ndarray) and a.dtype != np.float64:
            np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(plain.depth, small.depth)
    np.testing.assert_allclose(1024 * small.spacing, plain.spacing)
    image = height_field(z)
    single = RangeImage(image.points.astype(np.float32), image.valid, image.eye)
    np.testing.assert_array_equal(surfaces_of(single).jump, plain.jump)


def test_valid_pixels_without_a_finite_point_do_not_count() -> None:
    image = height_field(np.zeros((10, 12)))
    image.points[4, 5] = np.nan
    assert not surfaces_of(image).valid[4, 5]


def test_a_reading_at_the_sensor_is_none() -> None:
    image = scanned("boulder", 60)
    row, column = np.argwhere(image.valid)[200]
    image.points[row, column] = 0.0
    found = surfaces_of(image)
    assert not found.valid[row, column] and found.valid.sum() == image.valid.sum() - 1


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (height_field(np.zeros((1, 9))), "1 x 9 pixels"),
        (height_field(np.zeros((9, 1))), "9 x 1 pixels"),
        (height_field(np.full((5, 6), np.nan)), "no valid pixel"),
        (height_field(np.where(np.indices((9, 9)).sum(axis=0) % 2 == 0, 0.0, np.nan)), "neighbours"),
        (RangeImage(np.ones((5, 6, 3)), np.ones((5, 6), dtype=bool)), "neighbours"),
    ],
)
def test_bad_input_is_refused(image: RangeImage, says: str) -> None:
    with pytest.raises(InputError, match=says):
        surfaces_of(image)


def test_only_a_range_image_is_one() -> None:
    image = height_field(np.zeros((3, 3)))
    assert as_range_image(image) is image
    with pytest.raises(InputError, match="needs a range image"):
        as_range_image(Cloud(np.eye(3)))
