"""Laws of control points on contours: exact counts, measured points of the kinds asked for, clear refusals."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from edge_maps import all_pixels, height_field, scanned, steps_image
from scipy.spatial import KDTree

from jaxmodel.control_points import contour_control_points, find_contours
from jaxmodel.control_points.contours import ALL_KINDS
from jaxmodel.control_points.edges import EdgeKind, find_edges
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage, to_cloud


@pytest.mark.parametrize("kinds", [(EdgeKind.CREASE,), ALL_KINDS])
@pytest.mark.parametrize("count", [3, 40, 150])
def test_control_points_are_exactly_as_many_measured_points_of_those_kinds(
    kinds: Sequence[EdgeKind], count: int
) -> None:
    image = scanned("block_steps", noise=0.0005)
    edges = find_edges(image)
    cloud = contour_control_points(image, count, kinds)
    assert len(cloud) == count
    measured = to_cloud(image)
    assert measured.normals is not None and measured.border is not None
    distance, row = map(np.asarray, KDTree(measured.points).query(cloud.points))
    assert distance.max() == 0.0 and (np.diff(row) > 0).all()
    np.testing.assert_array_equal(cloud.normals, measured.normals[row])
    at = tuple(np.argwhere(image.valid)[row].T)
    assert set(edges.kind[at]) <= set(map(int, kinds))
    assert not edges.far[at].any()
    if EdgeKind.BORDER in kinds:
        assert cloud.border is not None and not cloud.border.any()
    else:
        np.testing.assert_array_equal(cloud.border, measured.border[row])


def test_fewer_control_points_are_part_of_more_and_all_are_the_contours() -> None:
    image = scanned("block_steps", noise=0.0005)
    sets = [{tuple(p) for p in contour_control_points(image, count).points} for count in (10, 60, 200, 100_000)]
    assert all(small <= large for small, large in pairwise(sets))
    pixels = all_pixels(find_contours(image, find_edges(image), (EdgeKind.CREASE,)))
    assert sets[-1] == {tuple(p) for p in image.points[tuple(pixels.T)]}


def test_control_points_do_not_depend_on_the_unit() -> None:
    image = scanned("block_steps")
    large = RangeImage(1024.0 * image.points, image.valid, image.eye)
    np.testing.assert_array_equal(
        contour_control_points(large, 90).points, 1024.0 * contour_control_points(image, 90).points
    )


@pytest.mark.parametrize("count", [-1, 2])
def test_counts_below_three_are_refused(count: int) -> None:
    with pytest.raises(InputError, match=f"count is {count}"):
        contour_control_points(steps_image(), count)


def dome() -> RangeImage:
    row, column = np.indices((60, 80))
    return height_field(-0.01 * ((row - 30.0) ** 2 + (column - 40.0) ** 2))


def test_an_image_without_contours_is_refused_with_the_reason() -> None:
    with pytest.raises(InputError, match=r"no crease contour .* single smooth surface.*use the kind subsample"):
        contour_control_points(dome(), 10)
    assert len(contour_control_points(dome(), 10, ALL_KINDS)) == 10
    with pytest.raises(InputError, match="the range image is empty"):
        contour_control_points(height_field(np.full((60, 80), np.nan)), 10)


@pytest.mark.parametrize("shape", [(1, 60), (60, 1), (1, 1), (2, 2)])
def test_an_image_with_one_row_or_column_is_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=r"no crease contour|has only|no extent"):
        contour_control_points(height_field(np.zeros(shape)), 10)
