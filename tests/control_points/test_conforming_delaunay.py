"""Laws of segments in a triangulation: each becomes a chain of edges near its line, on its own side of a jump."""

import numpy as np
import pytest
from edge_maps import height_field
from hypothesis import given
from hypothesis import strategies as st
from split_scenes import terrace_heights

from jaxmodel.control_points.conforming_delaunay import Conforming, Pieces, check_segments, conform
from jaxmodel.control_points.image_surfaces import surfaces_of
from jaxmodel.control_points.pixel_triangulation import HORIZON, edges_of, triangulate
from jaxmodel.errors import InputError

PLANE = surfaces_of(height_field(np.zeros((40, 60))))


def chains(mesh: Conforming, segments: np.ndarray) -> list[np.ndarray]:
    """For each segment the pixels from its first end to its last along its pieces, which must be edges of the mesh."""
    count = len(mesh.pixels) + HORIZON
    edges = set(edges_of(mesh.triangles, count).tolist())
    number = {tuple(pixel): i + HORIZON for i, pixel in enumerate(mesh.pixels.tolist())}
    found = []
    for i, (first, last) in enumerate(segments.tolist()):
        following = {tuple(a): tuple(b) for a, b in mesh.pieces.ends[mesh.pieces.segment == i].tolist()}
        chain = [tuple(first)]
        while chain[-1] != tuple(last):
            a, b = number[chain[-1]], number[following[chain[-1]]]
            assert min(a, b) * count + max(a, b) in edges
            chain.append(following.pop(chain[-1]))
        assert not following
        found.append(np.array(chain))
    return found


def from_line(chain: np.ndarray) -> float:
    """Largest distance, in pixels, of a chain's pixels from the line between its ends."""
    along = chain[-1] - chain[0]
    offset = chain - chain[0]
    return float(np.abs(offset[:, 0] * along[1] - offset[:, 1] * along[0]).max() / np.linalg.norm(along))


def drawn_segments(count: int, seed: int) -> np.ndarray:
    ends = np.random.default_rng(seed).integers(0, [40, 60], (count, 2, 2))
    return ends[(ends[:, 0] != ends[:, 1]).any(axis=1)]


def inserted(segments: np.ndarray, others: np.ndarray) -> Conforming:
    pixels = np.unique(np.concatenate([segments.reshape(-1, 2), others]), axis=0)
    return conform(PLANE, pixels, Pieces.of(segments))


@given(st.integers(1, 12), st.integers(0, 200), st.integers(0, 99))
def test_segments_that_cross_at_will_are_chains_of_edges_near_their_lines(count: int, others: int, seed: int) -> None:
    segments = drawn_segments(count, seed)
    mesh = inserted(segments, np.random.default_rng(seed).integers(0, [40, 60], (others, 2)))
    assert mesh.lost == 0
    for chain in chains(mesh, segments):
        assert from_line(chain) <= 2.0
    np.testing.assert_array_equal(mesh.triangles, triangulate((40, 60), mesh.pixels))  # still Delaunay
    assert len(np.unique(mesh.pixels, axis=0)) == len(mesh.pixels)


def test_among_all_pixels_segments_are_chains_of_neighbours() -> None:
    everything = np.argwhere(PLANE.valid)
    segments = drawn_segments(10, 0)
    for chain in chains(conform(PLANE, everything, Pieces.of(segments)), segments):
        assert np.abs(np.diff(chain, axis=0)).max() <= 1
        assert from_line(chain) <= 2.0


def test_a_segment_alone_is_one_edge() -> None:
    segments = np.array([[[3, 4], [30, 50]]])
    mesh = inserted(segments, np.zeros((0, 2), dtype=np.int64))
    assert len(mesh.pieces.ends) == 1 and len(mesh.pixels) == 2


def test_segments_given_twice_or_backwards_share_their_chain() -> None:
    one = drawn_segments(6, 3)
    others = np.random.default_rng(3).integers(0, [40, 60], (150, 2))
    both = np.concatenate([one, one, one[:, ::-1]])
    np.testing.assert_array_equal(
        np.unique(inserted(both, others).pixels, axis=0), np.unique(inserted(one, others).pixels, axis=0)
    )


def test_a_segment_beside_a_jump_stays_on_its_side() -> None:
    # the block's edge, turned a little: pixels on the line fall on both sides of the jump
    y, x = np.indices((60, 80))
    high = x > 20 + y / 4
    surfaces = surfaces_of(height_field(np.where(high, 25.0, 0.0)))
    first, last = [int(np.argmax(high[row])) for row in (4, 56)]
    segments = np.array([[[4, first], [56, last]], [[4, first - 1], [56, last - 1]]])
    others = np.random.default_rng(0).integers(0, [60, 80], (400, 2))
    mesh = conform(surfaces, np.unique(np.concatenate([segments.reshape(-1, 2), others]), axis=0), Pieces.of(segments))
    near, far = chains(mesh, segments)
    assert len(near) > 3 and len(far) > 3
    assert high[near[:, 0], near[:, 1]].all()
    assert not high[far[:, 0], far[:, 1]].any()


def test_a_segment_across_a_gap_is_lost_only_there() -> None:
    z = terrace_heights()
    z[:] = 0.0
    z[20:40, 30:50] = np.nan
    surfaces = surfaces_of(height_field(z))
    segments = np.array([[[30, 5], [30, 75]]])
    others = np.argwhere(surfaces.valid)[::3]
    mesh = conform(surfaces, np.unique(np.concatenate([segments.reshape(-1, 2), others]), axis=0), Pieces.of(segments))
    assert mesh.lost > 0
    assert surfaces.valid[mesh.pixels[:, 0], mesh.pixels[:, 1]].all()


def test_segments_without_length_are_left_out() -> None:
    pieces = check_segments(PLANE, np.array([[[3, 3], [3, 3]], [[3, 3], [9, 9]]]))
    np.testing.assert_array_equal(pieces.ends, [[[3, 3], [9, 9]]])
    assert len(check_segments(PLANE, None).ends) == 0


@pytest.mark.parametrize("end", [[-1, 0], [0, 60], [40, 0], [12, 12]])
def test_ends_without_a_reading_are_refused(end: list[int]) -> None:
    z = np.zeros((40, 60))
    z[12, 12] = np.nan
    with pytest.raises(InputError, match="segment 1: its end"):
        check_segments(surfaces_of(height_field(z)), np.array([[[1, 1], [5, 5]], [[1, 1], end]]))
