"""What a finished alignment comes to: the pairs, the graph they make, the views, and each order of fusion."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars
from jaxtyping import Float

from jaxmodel.geometry.se3 import rotation_angle_deg
from jaxmodel.register.multiview.joint_fit import disagreement
from jaxmodel.register.multiview.view_graph import COMMON, Edge, Placed, Triangle
from jaxmodel.register.verdict import SearchOutcome
from jaxmodel.register.view_of_scan import ViewOfScan
from jaxmodel.run.aligning.orders import Way


def summarised(
    names: Sequence[str],
    views: Sequence[ViewOfScan],
    length: float,
    table: polars.DataFrame,
    edges: Sequence[Edge],
    first: Placed,
    triangles: Sequence[Triangle],
    ways: Sequence[Way],
    true: Float[np.ndarray, "n 4 4"] | None,
) -> dict[str, Any]:
    """The summary's tree; ``true``: poses relative to the first view that is placed, or None."""
    doubtful = {(edges[k].target, edges[k].source) for k in first.doubtful}
    tree = {(edges[k].target, edges[k].source) for k in first.tree}
    joined = {(e.target, e.source): e for e in edges}
    pairs = []
    for row in table.iter_rows(named=True):
        ends = names.index(row["target"]), names.index(row["source"])
        told = ("target", "source", "probability", "overlap_target", "overlap_source", "contradicted", "equivalents")
        pairs.append(
            {
                **{key: row[key] for key in told},
                "outcome": SearchOutcome(row["outcome"]).name.lower(),
                "joined": ends in joined,
                "common": ends in joined and joined[ends].common >= COMMON,
                "doubtful": ends in doubtful,
                "tree": ends in tree,
                "seconds": round(row["seconds"], 3),
            }
        )
    main = ways[0]
    return {
        "experiment": "multiview",
        "length": length,
        "views": [_view(k, name, first, main, views, true) for k, name in enumerate(names)],
        "left_out": [name for k, name in enumerate(names) if first.part[k] != 0],
        "pairs": pairs,
        "triangles": [
            {"views": [names[k] for k in t.views], "turn_deg": t.turn_deg, "shift": t.shift} for t in triangles
        ],
        "orders": [_order(names, way, views, length, true) for way in ways],
    }


def _view(
    number: int, name: str, first: Placed, way: Way, views: Sequence[ViewOfScan], true: np.ndarray | None
) -> dict[str, Any]:
    T, placed = way.T_world_view[number], first.part[number] == 0
    members = np.flatnonzero(first.part == 0)
    told: dict[str, Any] = {"name": name, "placed": bool(placed), "T_world_view": T.tolist() if placed else None}
    if placed and way.joint is not None:
        inner = int(np.searchsorted(members, number))
        told |= {"deviation_deg": float(way.joint.deviation_deg[inner]), "deviation": float(way.joint.deviation[inner])}
    if placed and true is not None:
        turn, shift = _errors(T[None], true[number][None], views[number : number + 1])
        told |= {"turn_deg": float(turn[0]), "shift": float(shift[0])}
    return told


def _order(
    names: Sequence[str], way: Way, views: Sequence[ViewOfScan], length: float, true: np.ndarray | None
) -> dict[str, Any]:
    known = np.flatnonzero(np.isfinite(way.T_world_view).all(axis=(1, 2)))
    chosen = [views[int(k)] for k in known]
    surfaces = [view.surface for view in chosen]
    told: dict[str, Any] = {
        "name": way.name,
        "views": len(known),
        "apart_first": disagreement(surfaces, way.T_first[known], length),
        "apart": disagreement(surfaces, way.T_world_view[known], length),
        "kept_first": way.joint is not None and not way.joint.improved,
        "seconds": round(way.seconds, 3),
        "joint_seconds": round(way.joint_seconds, 3),
    }
    if way.order is not None:
        told["steps"] = [[[names[v] for v in part] for part in step] for step in way.order.steps]
        told["cycles"] = [
            {"views": [names[v] for v in members], "opening_deg": cycle.opening_deg, "opening": cycle.opening}
            for members, cycle in way.order.cycles
        ]
    if true is not None:
        for key, T in (("first", way.T_first), ("", way.T_world_view)):
            turn, shift = _errors(T[known], true[known], chosen)
            after = f"_{key}" if key else ""
            # the first view is where it is by definition
            told |= {
                f"turn_median{after}": float(np.median(turn[1:])),
                f"turn_worst{after}": float(turn.max()),
                f"shift_median{after}": float(np.median(shift[1:])),
                f"shift_worst{after}": float(shift.max()),
            }
    return told


def _errors(T: np.ndarray, true: np.ndarray, views: Sequence[ViewOfScan]) -> tuple[np.ndarray, np.ndarray]:
    """Turn in degrees, and shift of each view's centre, unit of the data."""
    turn = rotation_angle_deg(np.swapaxes(T[:, :3, :3], 1, 2) @ true[:, :3, :3])
    centres = np.stack([view.centre for view in views])
    off = np.einsum("nab,nb->na", T[:, :3, :3] - true[:, :3, :3], centres) + T[:, :3, 3] - true[:, :3, 3]
    return np.asarray(turn), np.linalg.norm(off, axis=1)
