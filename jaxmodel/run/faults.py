"""What stands in the way of a fair comparison, found by code and shown with every result it spoils."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

from jaxmodel.view.table import Table

EQUAL = 0.05
"""Numbers of points of two kinds that are compared may differ by this share of the larger."""
_TITLES = {
    "unequal": "Not comparable: numbers of points that differ by more than 5 %",
    "missing": "Kinds that gave no points, counted as not converged",
}


def unequal_counts(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences about kinds that should not be compared: more than 5 % apart in their number of points on one scan.

    Args:
        entries: with ``pair``, ``control_points`` and ``points`` (of ``target`` and ``source``); those with the same
            pair, ``variant`` and ``trial`` (where there are such) are compared. Kinds without points are left out.
    """
    together: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for entry in entries:
        if entry["points"]["target"]:
            together.setdefault((entry["pair"], entry.get("variant", ""), entry.get("trial")), []).append(entry)
    return [
        f"{' '.join(key[:2]).strip()}, {view}: "
        + " and ".join(f"{entry['points'][view]} {entry['control_points']}" for entry in (one, other))
        for key, members in together.items()
        for one, other in combinations(members, 2)
        for view in ("target", "source")
        if abs(one["points"][view] - other["points"][view]) > EQUAL * max(one["points"][view], other["points"][view])
    ]


def without_any(costs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences about the kinds that gave no points."""
    return [
        f"{cost['pair']} {cost['variant']}".strip() + f": no {cost['control_points']} ({cost['note']})"
        for cost in costs
        if not cost["points"]["target"]
    ]


def fault_tables(summary: Mapping[str, Any]) -> list[Table]:
    """A table for each kind of fault that a summary's ``unequal`` and ``missing`` list."""
    return [Table(_TITLES[key], ("trial",), _listed(summary[key])) for key in _TITLES if summary.get(key)]


def _listed(sentences: Sequence[str], most: int = 20) -> list[tuple[str]]:
    rest = len(sentences) - most
    more = [(f"and {rest} more, see summary.json",)] if rest > 0 else []
    return [*((sentence,) for sentence in sentences[:most]), *more]
