"""Laws of cutting a graph into chains, on random graphs and on the shapes that a line can have."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.control_points.chains import Chains, chains_of, one_sided


def lists(chains: Chains) -> list[list[int]]:
    return [chains.nodes[i:j].tolist() for i, j in zip(chains.starts[:-1], chains.starts[1:], strict=True)]


def links_of(chains: Chains) -> list[tuple[int, int]]:
    found = []
    for nodes, closed in zip(lists(chains), chains.closed, strict=True):
        found += list(zip(nodes, nodes[1:] + nodes[:1] if closed else nodes[1:], strict=False))
    return sorted((min(pair), max(pair)) for pair in found)


@st.composite
def graphs(draw: st.DrawFn) -> tuple[int, np.ndarray]:
    """A few paths and rings that share nodes, with numbers in any order."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    count = draw(st.integers(2, 40))
    pairs = set()
    for _ in range(draw(st.integers(1, 6))):
        nodes = rng.permutation(count)[: rng.integers(2, count + 1)]
        ring = bool(rng.integers(2)) and len(nodes) > 2
        for a, b in zip(nodes, np.append(nodes[1:], nodes[0]) if ring else nodes[1:], strict=False):
            pairs.add((min(a, b), max(a, b)))
    return count, rng.permutation(np.array(sorted(pairs)))


@given(graph=graphs())
def test_every_link_is_in_one_chain_and_chains_turn_at_junctions_alone(graph: tuple[int, np.ndarray]) -> None:
    count, ends = graph
    degree = np.bincount(ends.ravel(), minlength=count)
    chains = chains_of(count, ends)
    assert links_of(chains) == sorted(map(tuple, ends.tolist()))
    for nodes, closed in zip(lists(chains), chains.closed, strict=True):
        assert len(nodes) >= 2
        assert (degree[nodes[1:-1]] == 2).all()
        if not closed:
            assert (degree[[nodes[0], nodes[-1]]] != 2).all()
        else:
            assert degree[nodes[-1]] == 2 and degree[nodes[0]] >= 2


@given(graph=graphs())
def test_the_order_of_the_links_does_not_matter(graph: tuple[int, np.ndarray]) -> None:
    count, ends = graph
    chains, turned = chains_of(count, ends), chains_of(count, ends[::-1, ::-1])
    for closed in (False, True):
        one, other = (
            sorted(tuple(sorted(nodes)) for nodes, c in zip(lists(of), of.closed, strict=True) if c == closed)
            for of in (chains, turned)
        )
        assert one == other


def test_path_ring_and_loop_on_a_stalk() -> None:
    path = chains_of(6, np.array([[4, 1], [1, 3], [3, 0]]))
    assert lists(path) in ([[0, 3, 1, 4]], [[4, 1, 3, 0]]) and not path.closed.any()
    ring = chains_of(5, np.array([[4, 1], [1, 3], [3, 0], [0, 4]]))
    assert sorted(lists(ring)[0]) == [0, 1, 3, 4] and ring.closed.all()
    stalk = chains_of(5, np.array([[0, 1], [1, 2], [2, 3], [3, 1]]))
    assert sorted(zip(map(sorted, lists(stalk)), stalk.closed.tolist(), strict=True)) == [
        ([0, 1], False),
        ([1, 2, 3], True),
    ]
    assert lists(stalk)[int(np.argmax(stalk.closed))][0] == 1


def test_no_link_gives_no_chain() -> None:
    assert lists(chains_of(3, np.zeros((0, 2), dtype=np.int64))) == []


def test_a_chain_with_one_side_alone_is_left_whole() -> None:
    chains = chains_of(6, np.array([[0, 1], [1, 2], [2, 3], [4, 5]]))
    kept = one_sided(chains, np.array([0, 1, 0, 1, -1, -1]))
    assert lists(kept) == lists(chains) and not kept.closed.any()


def test_a_chain_is_cut_where_the_side_changes() -> None:
    chains = chains_of(7, np.stack([np.arange(6), np.arange(1, 7)], axis=1))
    assert lists(one_sided(chains, np.array([1, 1, 0, -1, 0, -1, 1]))) == [[0, 1, 2], [3, 4, 5]]


@pytest.mark.parametrize("shift", range(8))
def test_a_ring_with_both_sides_is_opened_at_both_turns(shift: int) -> None:
    ring = chains_of(8, np.stack([np.arange(8), np.roll(np.arange(8), -1)], axis=1))
    side = np.roll(np.array([1, 1, 1, 0, -1, -1, -1, 0]), shift)
    cut = one_sided(ring, side)
    assert len(cut.closed) == 2 and not cut.closed.any() and len(cut.nodes) == 8
    assert all(abs(int(side[nodes].sum())) == 3 for nodes in lists(cut))
    assert one_sided(ring, np.abs(side)).closed.tolist() == [True]
