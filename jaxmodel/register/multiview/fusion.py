"""Views fused into one: registered views as one surface, to be registered with other views or fused ones (§2.8)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.geometry.se3 import inverse
from jaxmodel.register.multiview.view_graph import Edge
from jaxmodel.register.refine_pair import Surface, refine, surface_of
from jaxmodel.scan.cloud import Cloud

POINTS = 40_000
"""Of a fused surface, evenly spread: views that overlap need not be held twice."""


class Fused(NamedTuple):
    """``members`` (numbers of views) with ``T_fused_view (k, 4, 4)`` and their surface in the frame of the first."""

    members: tuple[int, ...]
    T_fused_view: Float[np.ndarray, "k 4 4"]
    surface: Surface

    def pose_of(self, view: int) -> Float[np.ndarray, "4 4"]:
        """T_fused_view of a member."""
        return self.T_fused_view[self.members.index(view)]


def single(view: int, surface: Surface) -> Fused:
    """One view, not yet fused with any."""
    return Fused((view,), np.eye(4)[None], surface)


def likeness(a: Fused, b: Fused, edges: Sequence[Edge]) -> float:
    """How much surface two share, by the pairs between their members: the larger the surer their registration."""
    return float(sum(e.common for e in edges if _between(e, a, b)))


def first_guess(a: Fused, b: Fused, edges: Sequence[Edge]) -> Float[np.ndarray, "4 4"] | None:
    """T_a_b by the pair between their members that shares most; None where no pair joins them."""
    joining = [e for e in edges if _between(e, a, b)]
    if not joining:
        return None
    best = max(joining, key=lambda e: e.common)
    if best.target in a.members:
        return a.pose_of(best.target) @ best.T_target_source @ inverse(b.pose_of(best.source))
    return a.pose_of(best.source) @ inverse(best.T_target_source) @ inverse(b.pose_of(best.target))


def fuse(a: Fused, b: Fused, T_a_b: Float[np.ndarray, "4 4"], length: float, fit: bool = True) -> Fused:
    """Both as one, in a's frame, b registered onto a from ``T_a_b`` first if ``fit``."""
    T = refine(a.surface, b.surface, T_a_b, length).T_target_source if fit else T_a_b
    points = np.concatenate([a.surface.points, b.surface.points @ T[:3, :3].T + T[:3, 3]])
    normals = np.concatenate([a.surface.normals, b.surface.normals @ T[:3, :3].T])
    kept = voxel_subsample(points, POINTS)
    surface = surface_of(Cloud(points[kept], normals[kept]))
    return Fused((*a.members, *b.members), np.concatenate([a.T_fused_view, T @ b.T_fused_view]), surface)


def _between(edge: Edge, a: Fused, b: Fused) -> bool:
    ends = edge.target, edge.source
    return (ends[0] in a.members and ends[1] in b.members) or (ends[1] in a.members and ends[0] in b.members)
