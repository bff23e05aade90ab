"""The table *published | ours | command* for MISSION row 1.8, in both ways of counting."""

from collections.abc import Mapping, Sequence
from typing import Any

from jaxmodel.io.strict_yaml import config_files, read_yaml


def published_table(name: str) -> dict[str, Any]:
    """A published table, typed in under ``configs/published``."""
    return read_yaml(config_files() / "published" / f"{name}.yaml")


def published_rows(cases: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Published success rates beside ours.

    Args:
        cases: the ``cases`` of a summary; those without the truth do not count.

    Returns:
        One entry for each published row: ``what``, ``published`` (point kind -> rate), ``ours`` (point kind -> the
        pooled counts ``all_pairs`` and ``pairs_with_success``: pairs where at least one kind ever converged, as the
        thesis counts). ``ours`` is empty where nothing of that family was run.
    """
    data = published_table("convergence")
    known = [case for case in cases if case.get("success")]
    converged = {case["pair"] for case in known if case["success"]["count"]}
    rows = []
    for row in data["rows"]:
        family = [case for case in known if case["family"] == row["family"]]
        ours = {
            kind: {
                "all_pairs": _pooled([c for c in family if c["control_points"] == kind]),
                "pairs_with_success": _pooled(
                    [c for c in family if c["control_points"] == kind and c["pair"] in converged]
                ),
            }
            for kind in dict.fromkeys(case["control_points"] for case in family)
        }
        rows.append({"what": row["what"], "published": row["published"], "source": data["source"], "ours": ours})
    return rows


def published_lines(rows: Sequence[Mapping[str, Any]], command: str) -> list[tuple[str, str, str, str, str]]:
    """The rows as text: what, published, ours over all pairs, ours over pairs with a success, command."""
    return [
        (
            row["what"],
            ", ".join(f"{kind} {_percent(rate)}" for kind, rate in row["published"].items()),
            ", ".join(f"{kind} {_counted(count['all_pairs'])}" for kind, count in row["ours"].items()) or "not run",
            ", ".join(f"{kind} {_counted(c['pairs_with_success'])}" for kind, c in row["ours"].items()) or "not run",
            command,
        )
        for row in rows
    ]


COLUMNS = ("success rate (thesis §2.9.2)", "published", "ours, all pairs", "ours, pairs with any success", "command")


def _pooled(cases: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    count = sum(case["success"]["count"] for case in cases)
    total = sum(case["success"]["total"] for case in cases)
    return {"pairs": len(cases), "count": count, "total": total, "rate": count / total if total else None}


def _percent(rate: float) -> str:
    return f"{100 * rate:.3g} %"


def _counted(pooled: Mapping[str, Any]) -> str:
    if not pooled["total"]:
        return "none"
    pairs = f"{pooled['pairs']} pair{'' if pooled['pairs'] == 1 else 's'}"
    return f"{_percent(pooled['rate'])} ({pooled['count']} of {pooled['total']}, {pairs})"
