"""Laws of pixel triangulations: they cover the image once, are Delaunay, and hand out every pixel once."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.control_points.pixel_triangulation import (
    HORIZON,
    doubled_areas,
    doubled_places,
    edges_of,
    pixels_of,
    triangulate,
)


def drawn(shape: tuple[int, int], count: int, seed: int) -> np.ndarray:
    """Distinct pixels, in a random order."""
    flat = np.random.default_rng(seed).permutation(shape[0] * shape[1])[:count]
    return np.stack(np.divmod(flat, shape[1]), axis=1)


CASES = [
    ((30, 40), 0),
    ((30, 40), 1),
    ((30, 40), 60),
    ((30, 40), 1200),  # every pixel: all circles tie
    ((1, 9), 9),
    ((9, 1), 9),
    ((200, 300), 2000),
]


@pytest.mark.parametrize(("shape", "count"), CASES)
def test_triangles_cover_the_plane_between_the_horizon_once(shape: tuple[int, int], count: int) -> None:
    pixels = drawn(shape, count, 0)
    places = doubled_places(shape, pixels)
    triangles = triangulate(shape, pixels)
    areas = doubled_areas(places, triangles)
    assert areas.min() > 0
    height, width = (np.ptp(places, axis=0) / 2).tolist()
    assert areas.sum() == 8 * height * width
    assert height >= 16 * shape[0] and width >= 16 * shape[1]
    assert len(triangles) == 2 * count + 2  # Euler, with four vertices on the hull
    assert np.unique(triangles).tolist() == list(range(count + HORIZON))
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges = Counter(map(tuple, np.sort(sides, axis=1).tolist()))
    assert {edge for edge, times in edges.items() if times == 1} == {(0, 1), (1, 2), (2, 3), (0, 3)}
    assert set(edges.values()) <= {1, 2}
    assert len(edges_of(triangles, len(places))) == len(edges)


@pytest.mark.parametrize(("shape", "count"), CASES[:-1])
def test_no_vertex_lies_in_the_circle_of_a_triangle_but_for_ties(shape: tuple[int, int], count: int) -> None:
    places = doubled_places(shape, drawn(shape, count, 1))
    triangles = triangulate(shape, drawn(shape, count, 1))
    a, b, c = (places[triangles[:, k]].astype(float) for k in range(3))
    u, v = b - a, c - a
    twice = 2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    uu, vv = np.sum(u * u, axis=1), np.sum(v * v, axis=1)
    centre = a + np.stack([v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu], axis=1) / twice[:, None]
    radius = np.linalg.norm(centre - a, axis=1)
    distance = np.linalg.norm(places[None] - centre[:, None], axis=2)
    assert (radius[:, None] - distance).max() < 1e-3 * max(shape)


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 144), st.integers(0, 99))
def test_every_pixel_is_in_one_triangle_that_holds_it(rows: int, columns: int, count: int, seed: int) -> None:
    shape = (rows, columns)
    pixels = drawn(shape, min(count, rows * columns), seed)
    places, triangles = doubled_places(shape, pixels), triangulate(shape, pixels)
    within = pixels_of(shape, places, triangles)
    np.testing.assert_array_equal(np.sort(within.pixel), np.arange(rows * columns))
    np.testing.assert_array_equal(np.repeat(np.arange(len(triangles)), np.diff(within.start)), within.triangle)
    place = 2 * np.stack(np.divmod(within.pixel, columns), axis=1)
    corner = places[triangles[within.triangle]]
    for k in range(3):
        side, to = corner[:, k] - corner[:, k - 1], place - corner[:, k - 1]
        assert (side[:, 0] * to[:, 1] - side[:, 1] * to[:, 0]).min() >= 0


def test_pixels_are_row_major_in_each_triangle() -> None:
    shape = (20, 30)
    pixels = drawn(shape, 25, 3)
    within = pixels_of(shape, doubled_places(shape, pixels), triangulate(shape, pixels))
    later = np.diff(within.pixel) > 0
    assert later[np.diff(within.triangle) == 0].all()


def test_order_of_the_pixels_does_not_matter() -> None:
    shape = (20, 30)
    pixels = drawn(shape, 300, 4)
    order = np.random.default_rng(5).permutation(300)

    def corners(given: np.ndarray) -> set[tuple[int, ...]]:
        places = doubled_places(shape, given) @ [1000, 1]
        return {tuple(sorted(row)) for row in places[triangulate(shape, given)].tolist()}

    assert corners(pixels) == corners(pixels[order])
