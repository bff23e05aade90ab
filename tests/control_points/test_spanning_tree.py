"""Laws of the spanning forest and of pruning it: lengths, loops, barbs, ends."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from jaxmodel.control_points.contour_graph import Links
from jaxmodel.control_points.spanning_tree import prune, spanning_forest

NEVER = 10_000


def links(ends: np.ndarray, points: np.ndarray) -> Links:
    ends = np.asarray(ends, dtype=np.int64)
    length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    return Links(ends, length, np.ones(len(ends)))


def path(n: int) -> np.ndarray:
    return np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)


def kruskal(count: int, graph: Links) -> float:
    """Reference: the length of the minimum spanning forest by the textbook's union of sets."""
    root = list(range(count))

    def find(i: int) -> int:
        while root[i] != i:
            i = root[i]
        return i

    total = 0.0
    for row in np.argsort(graph.length):
        a, b = map(find, graph.ends[row])
        if a != b:
            root[a] = b
            total += float(graph.length[row])
    return total


@given(seed=st.integers(0, 10_000), count=st.integers(4, 60))
def test_forest_spans_every_component_at_the_least_length(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    simplices = Delaunay(points[:, :2]).simplices
    ends = np.unique(np.sort(simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    graph = links(ends[rng.random(len(ends)) < 0.6], points)
    forest = spanning_forest(count, graph, NEVER)
    np.testing.assert_allclose(forest.length.sum(), kruskal(count, graph), rtol=1e-12)
    parts = [
        connected_components(csr_matrix((np.ones(len(e)), (e[:, 0], e[:, 1])), shape=(count, count)))[0]
        for e in (graph.ends, forest.ends)
    ]
    assert parts[0] == parts[1] == count - len(forest.ends)


def test_links_of_no_length_are_links() -> None:
    forest = spanning_forest(5, links(path(5), np.zeros((5, 3))), NEVER)
    assert len(forest.ends) == 4


@pytest.mark.parametrize(("around", "closed"), [(12, False), (13, False), (14, True), (40, True)])
def test_loops_longer_than_the_least_are_closed_again(around: int, closed: bool) -> None:
    angle = 2 * np.pi * np.arange(around) / around
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    ring = links(np.concatenate([path(around), [[0, around - 1]]]), points)
    assert len(spanning_forest(around, ring, 12).ends) == around - (not closed)


def test_a_loop_that_can_be_closed_in_several_ways_is_closed_once_by_the_shortest() -> None:
    n = 40
    angle = 2 * np.pi * np.arange(n) / n
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    second = np.stack([np.arange(n), (np.arange(n) + 2) % n], axis=1)
    first = np.stack([np.arange(n), (np.arange(n) + 1) % n], axis=1)
    forest = spanning_forest(n, links(np.concatenate([second, first]), points), 12)
    assert len(forest.ends) == n
    np.testing.assert_allclose(forest.length, forest.length[0])


def test_a_gap_is_crossed_from_an_end_and_not_from_side_to_side() -> None:
    # Two parallel lines three pixels apart, and a third that goes on after a gap of the same width.
    row = np.arange(20)
    points = np.concatenate([np.stack([row, 0 * row, 0 * row], 1), np.stack([row, 0 * row + 3, 0 * row], 1)])
    points = np.concatenate([points, [[22, 0, 0], [23, 0, 0]]]).astype(float)
    rungs = np.stack([row, row + 20], axis=1)[3:17]
    ends = np.concatenate([path(20), path(20) + 20, rungs, [[19, 40], [40, 41]]])
    graph = links(ends, points)
    graph = Links(graph.ends, graph.length, graph.length)
    forest = spanning_forest(42, graph, 12)
    assert set(map(tuple, forest.ends.tolist())) == set(map(tuple, [*path(20), *(path(20) + 20), (19, 40), (40, 41)]))


@given(seed=st.integers(0, 10_000), layers=st.integers(0, 6))
def test_pruning_takes_all_barbs_off_and_leaves_the_line_whole(seed: int, layers: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2 * layers + 3, 80))
    ends, count = [*map(tuple, path(n))], n
    # Barbs hang where they are shorter than both ways to the line's ends: else the line's end is the barb.
    for at in range(layers + 1, n - layers - 1):
        if rng.random() < 0.3 and layers:
            nodes = [at, *range(count, count + int(rng.integers(1, layers + 1)))]
            ends += pairwise(nodes)
            count += len(nodes) - 1
    kept = prune(count, links(np.array(ends), np.zeros((count, 3))), layers, 2)
    np.testing.assert_array_equal(np.sort(kept.ends, axis=0), path(n))


@pytest.mark.parametrize("layers", [0, 1, 4])
@pytest.mark.parametrize("n", [9, 10, 11, 30])
def test_pruning_a_bare_line_changes_nothing(layers: int, n: int) -> None:
    kept = prune(n, links(path(n), np.zeros((n, 3))), layers, 2)
    np.testing.assert_array_equal(np.sort(kept.ends, axis=0), path(n))


def test_an_end_that_forks_goes_on_along_its_deeper_branch() -> None:
    fork = np.concatenate([path(20), [[16, 20]], [[20, 21]]])  # 3 pixels on along the line, 2 on the fork
    kept = prune(22, links(fork, np.zeros((22, 3))), 4, 2)
    np.testing.assert_array_equal(np.sort(kept.ends, axis=0), path(20))


def test_a_branch_longer_than_a_barb_is_kept_whole() -> None:
    branch = np.concatenate([path(30), [[15, 30]], path(5) + 30])  # 5 pixels: one more than the layers
    kept = prune(35, links(branch, np.zeros((35, 3))), 4, 2)
    assert len(kept.ends) == len(branch)


def test_small_trees_are_left_out_and_rings_are_not_eroded() -> None:
    ring = np.concatenate([path(12), [[0, 11]]])
    graph = links(np.concatenate([ring, path(11) + 12, path(12) + 23]), np.zeros((40, 3)))
    kept = prune(40, graph, 4, 12)
    assert set(np.unique(kept.ends)) == set(range(12)) | set(range(23, 35))


def test_an_empty_graph_stays_empty() -> None:
    none = links(np.zeros((0, 2)), np.zeros((3, 3)))
    assert len(prune(3, spanning_forest(3, none, 12), 4, 2).ends) == 0
