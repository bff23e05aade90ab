"""The score against maps whose rightness is known by construction."""

import numpy as np
import pytest
from edge_maps import edge_map
from known_views import view

from jaxmodel.control_points.edge_score import EdgeTruth, edge_score
from jaxmodel.control_points.edges import EdgeKind

SHAPE = (40, 50)


def truth(step: float = 0.25) -> EdgeTruth:
    """A crease down column 20 and an outline down column 40 that is a jump, both over all rows, a sample every step."""
    rows = np.arange(0, 40, step)
    crease, outline = (np.stack([np.full(len(rows), column), rows], axis=1) for column in (20.0, 40.0))
    jumps = np.array([(column, row) for row in range(40) for column in (40, 41)], dtype=float)
    is_crease = np.repeat([True, False], len(rows))
    return EdgeTruth(np.concatenate([crease, outline]), is_crease, is_crease, jumps)


def map_of(creases: list[int], jumps: list[int], rows: slice = slice(None)):
    kind = np.zeros(SHAPE, dtype=np.int8)
    kind[rows, creases] = EdgeKind.CREASE
    kind[rows, jumps] = EdgeKind.DEPTH
    return edge_map(kind)


def test_a_right_map_has_all() -> None:
    score = edge_score(map_of([20], [40, 41]), truth())
    assert score == (1.0, 1.0, 1.0, 1.0, 40)


@pytest.mark.parametrize(("column", "right"), [(18, True), (22, True), (17, False), (23, False)])
def test_two_pixels_off_is_right_and_three_is_not(column: int, right: bool) -> None:
    # samples in the rows' middles, so that the distance is the one across the edge
    score = edge_score(map_of([column], []), truth(step=1.0))
    assert score.precision == (1.0 if right else 0.0)
    assert score.crease_recall == (1.0 if right else 0.0)


def test_half_an_edge_and_as_many_strays_make_halves() -> None:
    score = edge_score(map_of([20, 5], [40, 41], slice(0, 20)), truth())
    assert score.recall == pytest.approx(0.5, abs=0.06)
    assert score.crease_recall == pytest.approx(0.5, abs=0.06)
    assert score.precision == 0.75
    assert score.labels == 1.0


def test_exchanged_labels_are_seen() -> None:
    score = edge_score(map_of([40], [20]), truth())
    assert score.precision == 1.0 and score.labels == 0.0


def test_borders_count_as_found_but_not_as_right_or_wrong() -> None:
    kind = np.zeros(SHAPE, dtype=np.int8)
    kind[:, 20] = EdgeKind.BORDER
    score = edge_score(edge_map(kind), truth())
    assert score.recall == pytest.approx(0.5)
    assert np.isnan(score.precision) and np.isnan(score.labels)
    assert score.crease_recall == 0.0


def test_an_empty_map_and_an_empty_truth() -> None:
    none = EdgeTruth(np.zeros((0, 2)), np.zeros(0, dtype=bool), np.zeros(0, dtype=bool), np.zeros((0, 2)))
    score = edge_score(map_of([], []), none)
    assert np.isnan(score[:4]).all() and score.creases == 0
    assert edge_score(map_of([20], []), none).precision == 0.0
    assert edge_score(map_of([], []), truth()).recall == 0.0


def test_the_truth_of_a_view_keeps_what_the_sensor_reads() -> None:
    image, of = view("stepped_block", 0.0, 0)
    column, row = np.round(of.sharp).astype(int).T
    near = [image.valid[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2].any() for r, c in zip(row, column, strict=True)]
    assert all(near)
    assert of.inner.any() and not (of.inner & ~of.crease).any()
