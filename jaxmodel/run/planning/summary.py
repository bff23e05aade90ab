"""What the runs of ``next_view_objects`` come to: coverage by planner, areas under the curves, registrations."""

from typing import Any

import numpy as np
import polars

FEW, MANY = 10, 20
GROUP = ("planner", "noise", "registered")


def summarised(table: polars.DataFrame, views: int) -> dict[str, Any]:
    """``runs``: one for each object, planner, noise and first view, with its curve; ``planners``: means over them.

    A run that ended early stays at its last coverage.
    """
    runs = []
    for (name, planner, noise, registered, start), rows in table.group_by(
        ["object", *GROUP, "start"], maintain_order=True
    ):
        curve = rows["coverage"].to_list()
        runs.append(
            {
                "object": name,
                "planner": planner,
                "noise": noise,
                "registered": registered,
                "start": start,
                "coverage": curve,
                "views": len(curve),
                "ending": rows["ending"][-1],
                "placed": int(rows["placed"].sum()),
                "useless": _useless(curve),
                "right": int((rows["placed"] & rows["right"]).sum()),
                "error_deg": _largest(rows["error_deg"]),
                "error_shift": _largest(rows["error_shift"]),
                "seconds_a_view": float(np.median(rows["seconds"].to_numpy()[1:])) if len(rows) > 1 else 0.0,
            }
        )
    planners = []
    for key in dict.fromkeys(tuple(run[of] for of in GROUP) for run in runs):
        mine = [run for run in runs if tuple(run[of] for of in GROUP) == key]
        curves = np.array([held(run["coverage"], views) for run in mine])
        planners.append(
            {
                **dict(zip(GROUP, key, strict=True)),
                "runs": len(mine),
                "coverage": curves.mean(axis=0).tolist(),
                "area_few": float(curves[:, :FEW].mean()),
                "area_many": float(curves[:, :MANY].mean()),
                "worst_few": float(curves[:, : min(FEW, views)][:, -1].min()),
                "views": float(np.mean([run["views"] for run in mine])),
                "placed": sum(run["placed"] for run in mine) / sum(run["views"] for run in mine),
                "seconds_a_view": float(np.median([run["seconds_a_view"] for run in mine])),
            }
        )
    return {"runs": runs, "planners": planners}


def held(curve: list[float], views: int) -> list[float]:
    """A curve as long as ``views``, at its last value where the run had ended."""
    return [*curve[:views], *[curve[-1]] * (views - len(curve))]


def _useless(curve: list[float], least: float = 0.01) -> int:
    """Views at the end of a run that each added less than ``least`` of the reachable surface."""
    count = 0
    for before, after in zip(curve[-2::-1], curve[:0:-1], strict=True):
        if after - before >= least:
            break
        count += 1
    return count


def _largest(column: polars.Series) -> float | None:
    values = column.to_numpy()
    values = values[np.isfinite(values)]
    return float(values.max()) if len(values) else None
