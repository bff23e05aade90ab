"""From a graph to its chains: the ways between ends and junctions, each as an ordered list of nodes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components


class Chains(NamedTuple):
    """Chain i holds ``nodes[starts[i] : starts[i + 1]]`` in order; ``closed[i]`` when its last precedes its first."""

    nodes: Int[np.ndarray, " n"]
    starts: Int[np.ndarray, " c1"]
    closed: Bool[np.ndarray, " c"]


def chains_of(count: int, ends: Int[np.ndarray, "e 2"]) -> Chains:
    """Cut a graph at its junctions (nodes with three links or more) into chains; every link is in one chain.

    A junction is the end of each chain that meets there. A loop is a closed chain, also when it hangs on a junction.
    Nodes without a link are in none. Time grows with the number of nodes as sorting does.

    Args:
        count: number of nodes.
        ends: the links, no pair twice, no link from a node to itself.
    """
    if len(ends) == 0:
        return Chains(np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=bool))
    # Every link of a junction gets its own copy of it, so no node has more than two links.
    at_junction = np.bincount(ends.ravel(), minlength=count)[ends] >= 3
    links = ends.astype(np.int64)
    links[at_junction] = count + np.arange(np.count_nonzero(at_junction))
    original = np.concatenate([np.arange(count), ends[at_junction]])
    n = len(original)
    chains, number = connected_components(_graph(n, links), directed=False)

    first = np.full(chains, n)
    tips = np.flatnonzero(np.bincount(links.ravel(), minlength=n) == 1)
    np.minimum.at(first, number[tips], tips)
    is_ring = first == n
    on_ring = np.flatnonzero(is_ring[number[links[:, 0]]])
    # A ring is opened at one of the links of its smallest node, and starts there.
    on_ring = on_ring[np.lexsort((links[on_ring].max(axis=1), links[on_ring].min(axis=1)))]
    opened = on_ring[np.unique(number[links[on_ring, 0]], return_index=True)[1]]
    first[number[links[opened, 0]]] = links[opened].min(axis=1)
    first = first[first < n]  # the others are nodes without a link

    from_root = np.stack([np.full(len(first), n), first], axis=1)
    whole = _graph(n + 1, np.concatenate([np.delete(links, opened, axis=0), from_root]))
    order = breadth_first_order(whole, n, directed=False, return_predecessors=False)[1:]
    # The search meets one node of each chain a level, so the chains' lengths tell where its levels begin.
    lengths = np.sort(np.bincount(number)[number[first]])
    at_level = len(lengths) - np.searchsorted(lengths, np.arange(lengths[-1]), side="right")
    order = order[np.lexsort((np.repeat(np.arange(len(at_level)), at_level), number[order]))]

    starts = np.flatnonzero(np.diff(number[order], prepend=-1, append=chains))
    nodes, last = original[order], starts[1:] - 1
    ring = is_ring[number[order[starts[:-1]]]]
    loop = ~ring & (nodes[starts[:-1]] == nodes[last])  # both ends are copies of one junction
    kept = np.ones(len(nodes), dtype=bool)
    kept[last[loop]] = False
    return Chains(nodes[kept], np.concatenate([[0], np.cumsum(kept)])[starts], ring | loop)


def one_sided(chains: Chains, side: Int[np.ndarray, " m"]) -> Chains:
    """Cut chains that pass from one side to the other, before the first node of the other side.

    Where a jump fades out its two lines meet, and are two chains all the same. ``side`` holds -1 or 1 for each node,
    0 where it has none. A closed chain with both sides is opened; a single node cut off is left out.
    """
    nodes = chains.nodes.copy()
    for i in np.flatnonzero(chains.closed):  # the seam goes to a turn, where there is one
        ring = slice(chains.starts[i], chains.starts[i + 1])
        known = np.flatnonzero(side[nodes[ring]])
        turns = known[side[nodes[ring][known]] != side[nodes[ring][np.roll(known, 1)]]]
        if len(turns):
            nodes[ring] = np.roll(nodes[ring], -turns[0])
    chain = np.repeat(np.arange(len(chains.closed)), np.diff(chains.starts))
    known = np.flatnonzero(side[nodes])
    first, second = known[:-1], known[1:]
    cuts = second[(side[nodes[first]] != side[nodes[second]]) & (chain[first] == chain[second])]
    closed = chains.closed.copy()
    closed[chain[cuts]] = False
    starts = np.union1d(chains.starts, cuts)
    long = np.diff(starts) > 1
    kept = np.repeat(long, np.diff(starts))
    return Chains(
        nodes[kept], np.concatenate([[0], np.cumsum(np.diff(starts)[long])]), closed[chain[starts[:-1][long]]]
    )


def _graph(count: int, ends: Int[np.ndarray, "e 2"]) -> csr_matrix:
    return csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
