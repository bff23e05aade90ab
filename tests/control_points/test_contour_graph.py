"""Laws of the graph of edge pixels: what is linked, and what never is."""

import numpy as np
import pytest
from edge_maps import digital_line, edge_map, height_field
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from jaxmodel.control_points.contour_graph import edge_pixels, surface_links
from jaxmodel.control_points.edges import EdgeKind

FLAT = np.zeros((40, 50))
GAP, JUMP = 4.0, 6.0


def components(count: int, ends: np.ndarray) -> np.ndarray:
    graph = csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]


@given(seed=st.integers(0, 10_000), density=st.sampled_from([0.001, 0.02, 0.05, 0.2, 1.0]))
def test_on_one_plane_the_components_are_those_of_all_pairs_within_the_gap(seed: int, density: float) -> None:
    mask = np.random.default_rng(seed).random(FLAT.shape) < density
    mask[3, 4] = True
    pixels = np.argwhere(mask)
    links = surface_links(height_field(FLAT), edge_map(mask.astype(int)), pixels, GAP, JUMP)
    every_pair = KDTree(pixels).query_pairs(GAP, output_type="ndarray")
    found, wanted = components(len(pixels), links.ends), components(len(pixels), every_pair)
    assert len(set(zip(found, wanted, strict=True))) == len(set(found)) == len(set(wanted))
    assert (links.length_px <= GAP).all()
    np.testing.assert_allclose(links.length, links.length_px)


@pytest.mark.parametrize("end", [(20, 45), (37, 10), (37, 27), (20, 10)])
def test_pixels_in_one_line_and_a_single_pixel_are_linked_too(end: tuple[int, int]) -> None:
    pixels = digital_line(FLAT.shape, (20, 10), end)
    pixels = pixels[np.lexsort((pixels[:, 1], pixels[:, 0]))]
    kind = np.zeros(FLAT.shape, dtype=int)
    kind[tuple(pixels.T)] = EdgeKind.CREASE
    links = surface_links(height_field(FLAT), edge_map(kind), pixels, GAP, JUMP)
    if len(pixels) > 1 and len(set(pixels[:, 0])) in (1, len(pixels)) and 27 not in end:
        assert set(map(tuple, links.ends.tolist())) == {(i, i + 1) for i in range(len(pixels) - 1)}
    assert components(len(pixels), links.ends).max() == 0


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 45.0, 77.0, 90.0, 130.0])
@pytest.mark.parametrize("height", [8.0, 100.0])
def test_no_link_crosses_a_jump_labelled_or_not(angle_deg: float, height: float) -> None:
    row, column = np.indices(FLAT.shape)
    turn = np.deg2rad(angle_deg)
    above = (column - 25) * np.cos(turn) + (row - 20) * np.sin(turn) > 0
    image = height_field(np.where(above, height, 0.0))
    near = np.abs((column - 25) * np.cos(turn) + (row - 20) * np.sin(turn)) < 2.5
    pixels = np.argwhere(near)
    for kind in (EdgeKind.CREASE, EdgeKind.DEPTH):
        links = surface_links(image, edge_map(near * int(kind), far=~above), pixels, GAP, JUMP)
        side = above[tuple(pixels.T)]
        assert (side[links.ends[:, 0]] == side[links.ends[:, 1]]).all()
        assert components(len(pixels), links.ends).max() == 1


def test_the_two_sides_of_a_low_jump_are_apart_by_their_labels() -> None:
    column = np.indices(FLAT.shape)[1]
    above = column >= 25
    image = height_field(np.where(above, 0.5, 0.0))
    kind = np.where(np.isin(column, (24, 25)), int(EdgeKind.DEPTH), 0)
    pixels = np.argwhere(kind > 0)
    apart = surface_links(image, edge_map(kind, far=~above), pixels, GAP, JUMP)
    joined = surface_links(image, edge_map(kind), pixels, GAP, JUMP)
    assert components(len(pixels), apart.ends).max() == 1
    assert components(len(pixels), joined.ends).max() == 0


@pytest.mark.parametrize("turned", [False, True])
def test_no_link_passes_over_a_thin_wall_between_two_ends_on_one_plane(turned: bool) -> None:
    z = np.where(np.indices(FLAT.shape)[1] == 25, 30.0, 0.0)
    kind = np.zeros(FLAT.shape, dtype=int)
    kind[20, 10:25] = kind[20, 26:40] = EdgeKind.CREASE
    z, kind = (z.T, kind.T) if turned else (z, kind)
    pixels = np.argwhere(kind > 0)
    assert components(len(pixels), surface_links(height_field(z), edge_map(kind), pixels, GAP, JUMP).ends).max() == 1
    flat = surface_links(height_field(0 * z), edge_map(kind), pixels, GAP, JUMP)
    assert components(len(pixels), flat.ends).max() == 0


def test_a_gap_without_readings_is_crossed_on_a_surface_and_not_over_a_jump() -> None:
    column = np.indices(FLAT.shape)[1]
    for height, count in ((0.0, 1), (5.9, 2)):
        z = np.where(column > 25, height, 0.0)
        z[:, 24:26] = np.nan
        kind = np.zeros(FLAT.shape, dtype=int)
        kind[20, :24] = kind[20, 26:] = EdgeKind.CREASE
        image = height_field(z)
        pixels = np.argwhere(kind > 0)
        links = surface_links(image, edge_map(kind, valid=image.valid), pixels, GAP, JUMP)
        assert components(len(pixels), links.ends).max() == count - 1


def test_a_steep_surface_is_no_jump() -> None:
    column = np.indices(FLAT.shape)[1]
    kind = np.zeros(FLAT.shape, dtype=int)
    kind[20] = EdgeKind.CREASE
    pixels = np.argwhere(kind > 0)[::2]  # every second pixel
    image = height_field(np.where(column < 25, 0.0, 3.0 * (column - 25)))
    assert components(len(pixels), surface_links(image, edge_map(kind), pixels, GAP, JUMP).ends).max() == 0


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_a_wide_line_is_thinned_to_one_pixel_each_side_of_a_jump_apart(width: int) -> None:
    kind = np.zeros(FLAT.shape, dtype=int)
    far = np.zeros(FLAT.shape, dtype=bool)
    kind[5:35, 20 : 20 + 2 * width] = EdgeKind.DEPTH
    far[5:35, 20 : 20 + width] = True
    pixels = edge_pixels(edge_map(kind, far=far), (EdgeKind.DEPTH,))
    for side in (True, False):
        rows = pixels[far[tuple(pixels.T)] == side, 0]
        assert (np.bincount(rows) <= 1).all()
        assert len(rows) >= 30 - 2 * (width - 1)


def test_only_the_kinds_asked_for_and_readings_that_are_not_mixed_count() -> None:
    kind = np.zeros(FLAT.shape, dtype=int)
    kind[10], kind[20], kind[30] = EdgeKind.CREASE, EdgeKind.DEPTH, EdgeKind.BORDER
    valid = np.ones(FLAT.shape, dtype=bool)
    valid[:, 7] = False
    edges = edge_map(kind, valid=valid)
    for kinds in ((EdgeKind.CREASE,), (EdgeKind.DEPTH, EdgeKind.BORDER)):
        pixels = edge_pixels(edges, kinds)
        assert set(kind[tuple(pixels.T)]) == set(map(int, kinds))
        assert len(pixels) == 49 * len(kinds) and 7 not in pixels[:, 1]
