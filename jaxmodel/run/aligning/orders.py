"""The ways to place all views that the experiment compares, each before and after the fit of all points at once."""

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.geometry.se3 import inverse
from jaxmodel.register.multiview.joint_fit import JointFit, fit_all
from jaxmodel.register.multiview.pose_graph import fit_graph
from jaxmodel.register.multiview.variants import VARIANTS, Order, fuse_views
from jaxmodel.register.multiview.view_graph import Edge, placed
from jaxmodel.register.view_of_scan import ViewOfScan

ORDERS = ("graph", "tree", "chain", *VARIANTS)
"""``graph``: all pairs at once, what ``jaxmodel align`` does; ``tree``: along the best pairs; ``chain``: along pairs
drawn at random, as a sequence of pairwise registrations would be; the rest as in ``register/multiview/variants.py``."""


class Way(NamedTuple):
    """One order: poses of the ``members`` before (``T_first``) and after the fit of all points, world frame of the
    first member; NaN for other views; ``order`` of the fusion, where there was one.
    """

    name: str
    T_first: Float[np.ndarray, "n 4 4"]
    T_world_view: Float[np.ndarray, "n 4 4"]
    joint: JointFit | None
    order: Order | None
    seconds: float
    joint_seconds: float


def all_ways(
    names: Sequence[str],
    views: Sequence[ViewOfScan],
    edges: Sequence[Edge],
    members: Int[np.ndarray, " m"],
    length: float,
    seed: int,
) -> list[Way]:
    """Every order named, on the views that hang together (``members``, numbers)."""
    number = {int(view): k for k, view in enumerate(members)}
    inner = [
        e._replace(target=number[e.target], source=number[e.source])
        for e in edges
        if e.target in number and e.source in number
    ]
    chosen = [views[k] for k in members]
    return [_way(name, chosen, inner, members, len(views), length, seed) for name in names]


def _way(
    name: str,
    views: Sequence[ViewOfScan],
    edges: Sequence[Edge],
    members: Int[np.ndarray, " m"],
    count: int,
    length: float,
    seed: int,
) -> Way:
    begun = time.perf_counter()
    centres, order = np.stack([view.centre for view in views]), None
    if name in VARIANTS:
        order = fuse_views([view.surface for view in views], edges, name, length)  # pyright: ignore[reportArgumentType]
        first = order.T_world_view
    else:
        used = _drawn(edges, seed) if name == "chain" else edges
        first = placed(used, centres, length).T_world_view
        if name == "graph":
            first = fit_graph(edges, first, centres, length).T_world_view
    first = inverse(first[0]) @ first
    between = time.perf_counter()
    known = np.asarray(np.isfinite(first).all(axis=(1, 2)))
    joint = fit_all(
        [view.surface for view, is_known in zip(views, known, strict=True) if is_known], first[known], length
    )
    after = np.full_like(first, np.nan)
    after[known] = joint.T_world_view
    ended = time.perf_counter()
    return Way(
        name,
        _spread(first, members, count),
        _spread(after, members, count),
        joint,
        order,
        between - begun,
        ended - between,
    )


def _spread(T: Float[np.ndarray, "m 4 4"], members: Int[np.ndarray, " m"], count: int) -> Float[np.ndarray, "n 4 4"]:
    out = np.full((count, 4, 4), np.nan)
    out[members] = T
    return out


def _drawn(edges: Sequence[Edge], seed: int) -> list[Edge]:
    """Pairs of a spanning tree drawn at random."""
    root = {end: end for e in edges for end in (e.target, e.source)}

    def find(view: int) -> int:
        while root[view] != view:
            view = root[view]
        return view

    tree = []
    for k in np.random.default_rng(seed).permutation(len(edges)):
        a, b = find(edges[k].target), find(edges[k].source)
        if a != b:
            root[a] = b
            tree.append(edges[k])
    return tree
