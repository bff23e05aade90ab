"""The thesis's orders in which views are fused (§2.8, Fig. 2.25; §5.4.3, Table 5.3).

``incremental``: the next view onto all before it (a). ``cycle_views``: three views around a closed cycle, then the
others one by one (b, c). ``cycle_of_cycles``: all views in cycles of three as far as they go, then these (e).
``tournament``: pairs by likeness, pairs of pairs, and so on; the last four incrementally, as the pump was. Each starts
from the pairs found by search, and registers fused surfaces.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.geometry.se3 import inverse
from jaxmodel.register.multiview.cycles import Cycle, best_cycle, fuse_cycle
from jaxmodel.register.multiview.fusion import Fused, first_guess, fuse, likeness, single
from jaxmodel.register.multiview.view_graph import Edge
from jaxmodel.register.refine_pair import Surface

Variant = Literal["incremental", "cycle_views", "cycle_of_cycles", "tournament"]
VARIANTS: tuple[Variant, ...] = ("incremental", "cycle_views", "cycle_of_cycles", "tournament")
LAST = 4
"""Fused parts from which a tournament goes on incrementally."""


class Order(NamedTuple):
    """``T_world_view (n, 4, 4)`` in the frame of view 0, NaN where a view joined none; ``steps``: which views were
    fused with which, phase by phase; ``cycles``: those that were closed.
    """

    T_world_view: Float[np.ndarray, "n 4 4"]
    steps: tuple[tuple[tuple[int, ...], ...], ...]
    cycles: tuple[tuple[tuple[int, ...], Cycle], ...]


def fuse_views(surfaces: Sequence[Surface], edges: Sequence[Edge], variant: Variant, length: float) -> Order:
    """All views that hang together in one frame, fused in the order of ``variant``.

    ``edges``: believed pairs; ``length`` of the search, unit of the data.
    """
    parts = [single(k, surface) for k, surface in enumerate(surfaces)]
    steps: list[tuple[tuple[int, ...], ...]] = []
    cycles: list[tuple[tuple[int, ...], Cycle]] = []
    if variant == "tournament":
        parts = _tournament(parts, edges, length, steps)
    if variant in ("cycle_views", "cycle_of_cycles"):
        parts = _in_cycles(parts, edges, length, 1 if variant == "cycle_views" else len(parts), steps, cycles)
    if variant == "cycle_of_cycles":
        whole = [part for part in parts if len(part.members) > 1]
        left = [part for part in parts if len(part.members) == 1]
        parts = [*_in_cycles(whole, edges, length, 1, steps, cycles), *left]
    parts = _incremental(parts, edges, length, steps)
    T = np.full((len(surfaces), 4, 4), np.nan)
    with_first = next(part for part in parts if 0 in part.members)
    for view in with_first.members:
        T[view] = inverse(with_first.pose_of(0)) @ with_first.pose_of(view)
    return Order(T, tuple(steps), tuple(cycles))


def _incremental(
    parts: list[Fused], edges: Sequence[Edge], length: float, steps: list[tuple[tuple[int, ...], ...]]
) -> list[Fused]:
    """From the part with most views on (then that shares most), the part that shares most with all before."""
    if len(parts) < 2:
        return parts
    shared = [sum(likeness(a, b, edges) for b in parts if b is not a) for a in parts]
    first = max(range(len(parts)), key=lambda k: (len(parts[k].members), shared[k]))
    left = [part for k, part in enumerate(parts) if k != first]
    whole = parts[first]
    while left:
        k = max(range(len(left)), key=lambda k: likeness(whole, left[k], edges))
        guess = first_guess(whole, left[k], edges)
        if guess is None:
            break
        part = left.pop(k)
        whole = fuse(whole, part, guess, length)
        steps.append((part.members,))
    return [whole, *left]


def _tournament(
    parts: list[Fused], edges: Sequence[Edge], length: float, steps: list[tuple[tuple[int, ...], ...]]
) -> list[Fused]:
    while len(parts) > LAST:
        pairs, paired = [], set()
        alike = [
            (likeness(parts[i], parts[j], edges), i, j) for i in range(len(parts)) for j in range(i + 1, len(parts))
        ]
        for value, i, j in sorted(alike, key=lambda item: -item[0]):
            if value > 0 and i not in paired and j not in paired:
                pairs.append((i, j))
                paired |= {i, j}
        if not pairs:
            break
        fused = []
        for i, j in pairs:
            guess = first_guess(parts[i], parts[j], edges)
            assert guess is not None
            fused.append(fuse(parts[i], parts[j], guess, length))
        steps.append(tuple(part.members for part in fused))
        parts = [*fused, *(part for k, part in enumerate(parts) if k not in paired)]
    return parts


def _in_cycles(
    parts: list[Fused],
    edges: Sequence[Edge],
    length: float,
    most: int,
    steps: list[tuple[tuple[int, ...], ...]],
    cycles: list[tuple[tuple[int, ...], Cycle]],
) -> list[Fused]:
    """At most so many cycles of three parts fused, the strongest first."""
    waiting, done = list(parts), []
    while len(done) < most and (three := best_cycle(waiting, edges)) is not None:
        a, b, c = (waiting[k] for k in three)
        found = fuse_cycle(a, b, c, edges, length)
        if found is None:
            break
        whole, cycle = found
        done.append(whole)
        steps.append((whole.members,))
        cycles.append((whole.members, cycle))
        waiting = [part for k, part in enumerate(waiting) if k not in three]
    return [*done, *waiting]
