"""Laws of plane fits to triangles: agreement with an SVD, one surface a triangle, outlines measured in pixels."""

import numpy as np
import pytest
from edge_maps import height_field
from split_scenes import scanned, terrace_heights, waves

from jaxmodel.control_points.image_surfaces import Surfaces, surfaces_of
from jaxmodel.control_points.pixel_triangulation import HORIZON, Pixels, doubled_places, pixels_of, triangulate
from jaxmodel.control_points.triangle_fit import TriangleFit, fit_triangles
from jaxmodel.scan.range_image import RangeImage


def fitted(
    image: RangeImage, pixels: np.ndarray, kept: bool = True
) -> tuple[Surfaces, np.ndarray, Pixels, TriangleFit]:
    """The fit of a triangulation of ``pixels``, every triangle but those at the horizon kept or none."""
    surfaces, shape = surfaces_of(image), (image.valid.shape[0], image.valid.shape[1])
    places, triangles = doubled_places(shape, pixels), triangulate(shape, pixels)
    within = pixels_of(shape, places, triangles)
    which = np.asarray(triangles.min(axis=1) >= HORIZON) & kept
    return surfaces, triangles, within, fit_triangles(surfaces, places, triangles, within, which)


def some(image: RangeImage, count: int, seed: int = 0) -> np.ndarray:
    """Valid pixels, the image's corners among them where they are valid."""
    drawn = np.random.default_rng(seed).permutation(np.argwhere(image.valid))[:count]
    h, w = image.valid.shape
    corners = np.array([[0, 0], [0, w - 1], [h - 1, 0], [h - 1, w - 1]])
    return np.unique(np.concatenate([drawn, corners[image.valid[corners[:, 0], corners[:, 1]]]]), axis=0)


def test_error_is_that_of_a_plane_by_svd() -> None:
    image = height_field(np.random.default_rng(0).normal(size=(40, 50)))
    pixels = some(image, 25)
    _, triangles, within, fit = fitted(image, pixels)
    for i, triangle in enumerate(triangles):
        if triangle.min() < HORIZON:
            assert fit.error[i] == 0 and fit.readings[i] == 0
            continue
        inside = within.pixel[within.start[i] : within.start[i + 1]]
        corner = pixels[triangle - HORIZON]
        points = np.concatenate([image.points.reshape(-1, 3)[inside], image.points[corner[:, 0], corner[:, 1]]])
        centred = points - points.mean(axis=0)
        oracle = np.linalg.svd(centred, compute_uv=False)[2] / np.sqrt(len(points))
        assert fit.error[i] == pytest.approx(oracle, rel=1e-9, abs=1e-12)
        assert fit.readings[i] == len(points)
        assert fit.spacing[i] == pytest.approx(surfaces_of(image).spacing[0, 0])
        assert fit.misplaced[i] == 0


def test_a_plane_far_from_the_origin_has_no_error() -> None:
    y, x = np.indices((30, 40))
    image = height_field(0.4 * x - 0.7 * y + 5000.0)
    # an eigenvalue is known to 1e-16 of the largest, its root to 1e-8 of the triangle's size
    assert fitted(image, some(image, 12))[3].error.max() < 1e-6


def test_only_the_largest_surface_is_fitted_and_the_rest_is_misplaced() -> None:
    z = terrace_heights()
    image = height_field(z)
    corners = np.array([[0, 0], [0, 79], [59, 0], [59, 79]])
    surfaces, triangles, within, fit = fitted(image, corners)
    for i in np.flatnonzero((triangles >= HORIZON).all(axis=1)):
        inside = within.pixel[within.start[i] : within.start[i + 1]]
        high = z.ravel()[inside] > 0
        assert fit.error[i] < 1e-6
        assert fit.readings[i] == np.count_nonzero(~high) + 3
        assert fit.misplaced[i] >= surfaces.depth.ravel()[inside[high]].max() > 10


def test_surfaces_apart_inside_a_triangle_are_two_even_if_joined_outside_it() -> None:
    # a ramp joins the two levels at the top of the image, far from the triangle in question
    z = np.zeros((60, 60))
    z[10:, 35:] = 30.0
    z[:10, 30:] = np.clip(3.0 * (np.arange(30) - 5), 0, 30)
    image = height_field(z)
    pixels = np.array([[20, 2], [59, 30], [20, 58]])
    _, triangles, _, fit = fitted(image, pixels)
    i = int(np.flatnonzero((triangles >= HORIZON).all(axis=1))[0])
    assert fit.error[i] > 1.0  # its third corner is on the other level
    assert fit.misplaced[i] > 5


def test_readings_of_removed_triangles_are_misplaced() -> None:
    image = height_field(np.zeros((30, 40)))
    surfaces, triangles, within, fit = fitted(image, some(image, 20), kept=False)
    assert fit.readings.sum() == 0 and fit.error.max() == 0
    for i in range(len(triangles)):
        inside = within.pixel[within.start[i] : within.start[i + 1]]
        assert fit.misplaced[i] >= surfaces.depth.ravel()[inside].max(initial=0)


def test_a_gap_in_a_triangle_is_measured_by_its_depth() -> None:
    image = waves()
    surfaces, triangles, within, fit = fitted(image, np.array([[0, 0], [0, 59], [49, 0], [49, 59]]))
    holds = int(within.triangle[within.pixel == 20 * 60 + 15][0])
    assert triangles[holds].min() >= HORIZON
    assert fit.misplaced[holds] == surfaces.depth[20, 15] > 5


def test_many_triangles_of_a_real_form_agree_with_a_flood_fill() -> None:
    from scipy.ndimage import label

    image = scanned("block_steps", 120)
    surfaces, triangles, within, fit = fitted(image, some(image, 60))
    h, w = image.valid.shape
    tried = 0
    for i in np.flatnonzero((triangles >= HORIZON).all(axis=1)):
        inside = within.pixel[within.start[i] : within.start[i + 1]]
        if not surfaces.jump.ravel()[inside].any():
            continue
        # pixels and links as a picture of twice the size, cut out by the triangle
        mine = np.zeros(image.valid.size, dtype=bool)
        mine[inside] = ~surfaces.gap.ravel()[inside]
        mine = mine.reshape(h, w)
        picture = np.zeros((2 * h, 2 * w), dtype=bool)
        picture[::2, ::2] = mine
        picture[1:-1:2, ::2] = surfaces.down[:-1] & mine[:-1] & mine[1:]
        picture[::2, 1:-1:2] = surfaces.right[:, :-1] & mine[:, :-1] & mine[:, 1:]
        labels = np.zeros(picture.shape, dtype=np.int64)
        label(picture, output=labels)
        parts = labels[::2, ::2]
        sizes = np.bincount(parts[mine])
        largest = [np.count_nonzero((parts == k) & image.valid) + 3 for k in np.flatnonzero(sizes == sizes.max())]
        assert fit.readings[i] in largest
        tried += 1
    assert tried > 10
