"""Which views belong together: every pair searched, the believed ones an edge, loops that do not close thrown out.

A pair that is wrong may look right by itself; around a triangle of views the three motions must undo each other (thesis
§2.8), and a wrong one does not. Fig. 2.26 joins views with at least 30 % of their field in common.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.register.candidates import PairOfViews
from jaxmodel.register.search import SearchOptions, search_pair
from jaxmodel.register.verdict import CONVINCING, Found, SearchOutcome
from jaxmodel.register.view_of_scan import ViewOfScan

COMMON = 0.3
"""Least share of each view that the other shows, of views joined in Fig. 2.26."""
CLOSES_DEG, CLOSES = 6.0, 0.04
"""Most that a triangle's three motions may turn and move by in all (in the length of the search) to close."""
DOUBT = 3.0
"""Natural logarithm of odds that a triangle which closes speaks for each of its edges, or against where it does not."""


class Edge(NamedTuple):
    """Two views (numbers) registered with each other; ``overlap``: share of the target near the source, and back.

    ``scatter``: root mean square distance to tangent planes where they meet, unit of the data.
    """

    target: int
    source: int
    T_target_source: Float[np.ndarray, "4 4"]
    probability: float
    overlap: tuple[float, float]
    scatter: float

    @property
    def common(self) -> float:
        """The smaller of the two shares."""
        return min(self.overlap)


class Triangle(NamedTuple):
    """Three views, and what going around them leaves: a turn in degrees, a shift of the first's centre."""

    views: tuple[int, int, int]
    turn_deg: float
    shift: float


class Placed(NamedTuple):
    """Poses along the strongest edges: ``T_world_view (n, 4, 4)``, ``part (n,)``: which views hang together (0 the
    largest part), each part in the frame of its first view; ``tree`` and ``doubtful``: numbers of the edges used, and
    of those whose triangles speak against them.
    """

    T_world_view: Float[np.ndarray, "n 4 4"]
    part: Int[np.ndarray, " n"]
    tree: tuple[int, ...]
    doubtful: tuple[int, ...]


def searched_edges(
    views: Sequence[ViewOfScan],
    length: float,
    options: SearchOptions | None = None,
    done: Callable[[int, int, Found], None] | None = None,
) -> list[Edge]:
    """Every pair registered with no first guess; the believed ones. ``done`` hears of each pair."""
    edges = []
    for target, source in combinations(range(len(views)), 2):
        found = search_pair(PairOfViews(views[target], views[source], length), options)
        if done is not None:
            done(target, source, found)
        edges += edge_of(target, source, found)
    return edges


def edge_of(target: int, source: int, found: Found) -> list[Edge]:
    """The pair as an edge, if it is believed: a pose with equals is as likely wrong as right, so it is not."""
    if found.outcome not in (SearchOutcome.FOUND, SearchOutcome.SAME_SCAN) or found.probability < CONVINCING:
        return []
    return [Edge(target, source, found.T_target_source, found.probability, found.overlap, found.scatter)]


def triangles(edges: Sequence[Edge], centres: Float[np.ndarray, "n 3"]) -> list[Triangle]:
    """Every three views joined by three edges. Going around them should change nothing (§2.8)."""
    motion = _motions(edges)
    found = []
    for a, b, c in combinations(range(len(centres)), 3):
        if (a, b) in motion and (b, c) in motion and (c, a) in motion:
            around = motion[a, b] @ motion[b, c] @ motion[c, a]
            moved = around[:3, :3] @ centres[a] + around[:3, 3] - centres[a]
            turn = float(rotation_angle_deg(around[:3, :3]))
            found.append(Triangle((a, b, c), turn, float(np.linalg.norm(moved))))
    return found


def placed(edges: Sequence[Edge], centres: Float[np.ndarray, "n 3"], length: float) -> Placed:
    """Poses along the edges most to be trusted: by their own probability, and by the triangles they close."""
    n = len(centres)
    trust = np.array([np.log(max(e.probability, 1e-6) / max(1 - e.probability, 1e-6)) for e in edges])
    number = {frozenset((e.target, e.source)): k for k, e in enumerate(edges)}
    for triangle in triangles(edges, centres):
        closes = triangle.turn_deg < CLOSES_DEG and triangle.shift < CLOSES * length
        for pair in combinations(triangle.views, 2):
            # one wrong edge opens all its triangles: what does not close is a third of a word against each
            trust[number[frozenset(pair)]] += DOUBT if closes else -DOUBT / 3
    kept = [k for k in range(len(edges)) if trust[k] > 0]
    # more shared surface holds a pose better: ties of trust go to overlap
    cost = [100.0 - min(trust[k], 50.0) - 20 * edges[k].common for k in kept]
    rows, columns = (np.array([getattr(edges[k], end) for k in kept], np.int64) for end in ("target", "source"))
    graph = coo_array((np.array(cost), (rows, columns)), shape=(n, n)).tocsr()
    tree = minimum_spanning_tree(graph).tocoo()
    chosen = [number[frozenset((int(i), int(j)))] for i, j in zip(tree.row, tree.col, strict=True)]
    part = _by_size(connected_components(tree, directed=False)[1])
    motion = _motions([edges[k] for k in chosen])
    T = np.tile(np.eye(4), (n, 1, 1))
    for each in np.unique(part):
        first = int(np.flatnonzero(part == each)[0])
        order, before = breadth_first_order(tree.tocsr(), first, directed=False)
        for view in order[1:]:
            T[view] = T[before[view]] @ motion[int(before[view]), int(view)]
    doubtful = tuple(k for k in range(len(edges)) if trust[k] <= 0)
    return Placed(T, part, tuple(sorted(chosen)), doubtful)


def _motions(edges: Sequence[Edge]) -> dict[tuple[int, int], Float[np.ndarray, "4 4"]]:
    there = {(e.target, e.source): e.T_target_source for e in edges}
    return there | {(e.source, e.target): inverse(e.T_target_source) for e in edges}


def _by_size(part: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Parts numbered from the largest; of equal ones the one with the first view."""
    sizes = np.bincount(part)
    first = [int(np.flatnonzero(part == k)[0]) for k in range(len(sizes))]
    rank = np.empty(len(sizes), np.int64)
    rank[np.lexsort((np.array(first), -sizes))] = np.arange(len(sizes))
    return rank[part]
