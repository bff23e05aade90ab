"""Laws of the segments contours give a split mesh: within their share of vertices, along the edges, on readings."""

import numpy as np
import pytest
from edge_maps import height_field
from split_scenes import scanned, terrace_heights

from jaxmodel.control_points.conforming_delaunay import Pieces, conform
from jaxmodel.control_points.contour_segments import contour_segments
from jaxmodel.control_points.edges import EdgeKind, find_edges
from jaxmodel.control_points.image_surfaces import surfaces_of


@pytest.mark.parametrize("most", [10, 40, 150, 600])
def test_segments_take_no_more_vertices_than_allowed(most: int) -> None:
    image = scanned("block_steps", 150)
    surfaces = surfaces_of(image)
    segments = contour_segments(image, surfaces, most)
    assert len(segments) > 0
    pixels = np.unique(segments.reshape(-1, 2), axis=0)
    assert len(conform(surfaces, pixels, Pieces.of(segments)).pixels) <= most
    assert image.valid[pixels[:, 0], pixels[:, 1]].all()
    kind = find_edges(image).kind
    assert (kind[pixels[:, 0], pixels[:, 1]] != EdgeKind.NONE).all()
    assert (segments[:, 0] != segments[:, 1]).any(axis=1).all()


def test_more_vertices_are_used_where_the_contours_have_them() -> None:
    image = scanned("block_steps", 150)
    surfaces = surfaces_of(image)
    sizes = [len(contour_segments(image, surfaces, most)) for most in (20, 80, 320)]
    assert sizes == sorted(set(sizes))
    assert sizes[-1] > 100


def test_both_sides_of_a_jump_have_segments() -> None:
    z = terrace_heights()
    image = height_field(z)
    segments = contour_segments(image, surfaces_of(image), 200)
    level = z[segments[..., 0], segments[..., 1]]
    assert (level[:, 0] == level[:, 1]).all()
    assert set(np.unique(level)) == {0.0, 25.0}


@pytest.mark.parametrize("most", [0, 1])
def test_no_vertices_no_segments(most: int) -> None:
    image = height_field(terrace_heights())
    assert contour_segments(image, surfaces_of(image), most).shape == (0, 2, 2)
