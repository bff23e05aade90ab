"""Minimum spanning trees of the edge pixels' graph, and what is cut off them (thesis §2.4.1).

Kruskal's tree keeps the shortest way from pixel to pixel. Real loops are closed again, bridges across the side of a
line are dropped, and barbs go by erosion and dilation.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from jaxmodel.control_points.contour_graph import Links

_NEIGHBOUR_PX = 1.5  # between the diagonal neighbour and the next pixel but one
_RAGGED = 2  # branches of so many pixels are the raggedness of a line, and no line that another one touches


def spanning_forest(count: int, links: Links, least_loop: int) -> Links:
    """The minimum spanning tree of every component by length in space, closed again where the edge is a loop.

    Links over missing pixels between two lines' sides are left out: a gap is crossed from the end of a line only.

    Args:
        count: number of pixels, the rows that ``links`` speaks of.
        links: the graph.
        least_loop: a link that the tree left out comes back when its ends are more than this many steps apart in the
            tree: the shortest one at each such place.
    """
    in_tree = _minimum_spanning(count, links)
    tree = links.take(in_tree)
    degree = np.bincount(tree.ends[_without_barbs(count, tree, _RAGGED)].ravel(), minlength=count)
    bridge = (links.length_px > _NEIGHBOUR_PX) & (degree[links.ends] >= 3).all(axis=1)
    in_tree &= ~bridge
    left_out = np.flatnonzero(~in_tree & ~bridge)
    degree = np.bincount(links.ends[in_tree].ravel(), minlength=count)
    from_an_end = (links.length_px <= _NEIGHBOUR_PX) | (degree[links.ends] <= 1).any(axis=1)
    left_out = left_out[from_an_end[left_out]]
    tree = links.take(in_tree)
    closing = links.take(left_out[_far_apart(count, tree, links.ends[left_out], least_loop)])
    closing = closing.take(_one_a_place(count, tree, closing))
    return Links(*(np.concatenate(pair) for pair in zip(tree, closing, strict=True)))


def prune(count: int, links: Links, layers: int, least: int) -> Links:
    """Take barbs and small trees off a forest with loops.

    Erosion takes ``layers`` times all ends off; a branch of at most so many pixels is gone then. Dilation gives each
    end that is left the deepest of the lines eroded from it back, so no other end is shortened. Then trees of fewer
    than ``least`` pixels are left out.
    """
    links = links.take(_without_barbs(count, links, layers))
    _, tree = connected_components(_matrix(count, links.ends), directed=False)
    return links.take(np.bincount(tree)[tree[links.ends[:, 0]]] >= least)


def _matrix(count: int, ends: Int[np.ndarray, "e 2"], weight: Float[np.ndarray, " e"] | None = None) -> csr_matrix:
    weight = np.ones(len(ends)) if weight is None else weight
    return csr_matrix((weight, (ends[:, 0], ends[:, 1])), shape=(count, count))


def _minimum_spanning(count: int, links: Links) -> Bool[np.ndarray, " e"]:
    """Which links are in the trees. The weight is the link's rank, so equal lengths are told apart by their rows and
    a length of zero is a link too."""
    rank = np.empty(len(links.ends))
    rank[np.lexsort((links.ends[:, 1], links.ends[:, 0], links.length_px, links.length))] = 1 + np.arange(len(rank))
    tree = minimum_spanning_tree(_matrix(count, links.ends, rank)).tocoo()
    return np.isin(rank, tree.data)


def _far_apart(count: int, tree: Links, ends: Int[np.ndarray, "c 2"], steps: int) -> Bool[np.ndarray, " c"]:
    """Which pairs of ends are more than ``steps`` steps apart in the forest, or in two of its trees."""
    if len(ends) == 0:
        return np.zeros(0, dtype=bool)
    components, number = connected_components(_matrix(count, tree.ends), directed=False)
    roots = np.unique(number, return_index=True)[1]
    to_roots = np.stack([np.full(components, count), roots], axis=1)  # one root above all trees
    whole = _matrix(count + 1, np.concatenate([tree.ends, to_roots]))
    parent = breadth_first_order(whole, count, directed=False)[1].astype(np.int64)
    parent[count] = count
    depth = (parent != np.arange(count + 1)).astype(np.int64)
    ancestor = parent.copy()
    while (ancestor != count).any():  # doubling: each round looks twice as far up
        depth += depth[ancestor]
        ancestor = ancestor[ancestor]
    first, second = ends.T.copy()
    for _ in range(steps):
        up = depth[first] >= depth[second]
        met = first == second
        first, second = np.where(up & ~met, parent[first], first), np.where(up | met, second, parent[second])
    return first != second


def _one_a_place(count: int, tree: Links, closing: Links) -> Int[np.ndarray, " k"]:
    """Of closing links whose ends touch one another along the tree, the row of the shortest one."""
    if len(closing.ends) == 0:
        return np.zeros(0, dtype=np.int64)
    is_end = np.zeros(count, dtype=bool)
    is_end[closing.ends] = True
    along = tree.ends[is_end[tree.ends].all(axis=1)]
    _, number = connected_components(_matrix(count, np.concatenate([along, closing.ends])), directed=False)
    place = number[closing.ends[:, 0]]
    order = np.lexsort((closing.ends[:, 1], closing.ends[:, 0], closing.length, place))
    return order[np.unique(place[order], return_index=True)[1]]


def _without_barbs(count: int, links: Links, layers: int) -> Bool[np.ndarray, " e"]:
    """Which links erosion and dilation leave."""
    removed, parent = _erode(count, links, layers)
    kept = removed == 0
    kept[_regrown(count, links, removed, parent, layers)] = True
    return kept[links.ends].all(axis=1)


def _erode(count: int, links: Links, layers: int) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The round in which each pixel was taken off, 0 for those left, and the neighbour it hung on (-1: none)."""
    removed = np.zeros(count, dtype=np.int64)
    parent = np.full(count, -1)
    ends = links.ends
    alone = np.bincount(ends.ravel(), minlength=count) == 0
    for layer in range(1, layers + 1):
        leaf = np.bincount(ends.ravel(), minlength=count) == 1
        hanging = leaf[ends]
        parent[ends[hanging[:, 0], 0]] = ends[hanging[:, 0], 1]
        parent[ends[hanging[:, 1], 1]] = ends[hanging[:, 1], 0]
        removed[leaf] = layer
        ends = ends[~hanging.any(axis=1)]
    removed[alone] = max(layers, 1)
    return removed, parent


def _regrown(
    count: int, links: Links, removed: Int[np.ndarray, " n"], parent: Int[np.ndarray, " n"], layers: int
) -> Int[np.ndarray, " k"]:
    """The eroded pixels that dilation gives back: from each end that is left, down its deepest eroded line.

    A single pixel that is left of a line gets the two deepest back.
    """
    left = removed == 0
    degree = np.bincount(links.ends[left[links.ends].all(axis=1)].ravel(), minlength=count)
    children = np.flatnonzero((removed > 0) & (parent >= 0))
    order = children[np.lexsort((children, -removed[children], parent[children]))]
    first = np.flatnonzero(np.diff(parent[order], prepend=-1))
    deepest = np.full(count, -1)
    deepest[parent[order[first]]] = order[first]
    second = np.setdiff1d(np.arange(len(order)), first)
    second = second[np.isin(second - 1, first)]
    next_deepest = np.full(count, -1)
    next_deepest[parent[order[second]]] = order[second]
    ends = np.flatnonzero(left & (degree <= 1))
    lone = np.flatnonzero(left & (degree == 0))
    front = np.concatenate([deepest[ends], next_deepest[lone]])
    found = []
    for _ in range(layers):
        front = front[front >= 0]
        found.append(front)
        front = deepest[front]
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)
