"""Rows and summary of a convergence sweep: what each start gave, and what the truth and the plateau say of it."""

from pathlib import Path
from typing import Any

import numpy as np
import polars
from jaxtyping import Bool, Float, Int

from jaxmodel.errors import RunError
from jaxmodel.register import Sweep, basin, claims
from jaxmodel.register.outcome import Outcome
from jaxmodel.run.cases import Case
from jaxmodel.run.config import Claims, Right

POSE = tuple(f"T_{row}{column}" for row in range(3) for column in range(4))
"""Columns with the upper three rows of T_target_source, row by row."""
_REAL = ("error", "matched_fraction", "shared_rate")
_WHOLE = ("steps", "switch_1", "switch_2", "increases", "outcome")


def chunk_rows(indices: Int[np.ndarray, " c"], sweep: Sweep) -> polars.DataFrame:
    """One finished chunk as a table: the start's number and everything ``Sweep`` holds of it."""
    poses = np.asarray(sweep.T_target_source, dtype=np.float64)[:, :3, :].reshape(-1, 12)
    columns: dict[str, np.ndarray] = {"start": np.asarray(indices, dtype=np.int32)}
    columns |= {name: poses[:, i] for i, name in enumerate(POSE)}
    columns |= {name: np.asarray(getattr(sweep, name), dtype=np.float64) for name in _REAL}
    columns |= {name: np.asarray(getattr(sweep, name), dtype=np.int32) for name in _WHOLE}
    return polars.DataFrame(columns)


def case_rows(parts: dict[int, polars.DataFrame], starts: int, where: Path) -> polars.DataFrame:
    """All chunks of a sweep in start order. ``RunError`` if they do not hold every start exactly once."""
    table = polars.concat([parts[number] for number in sorted(parts)], how="vertical")
    if not table["start"].is_sorted():
        table = table.sort("start")
    if not np.array_equal(table["start"].to_numpy(), np.arange(starts)):
        raise RunError(
            f"{where}: the parts hold other starts than the {starts} asked for; delete the folder, run again"
        )
    return table


def poses(table: polars.DataFrame) -> Float[np.ndarray, "s 4 4"]:
    """T_target_source of each row."""
    T = np.tile(np.eye(4), (len(table), 1, 1))
    for place, name in enumerate(POSE):
        T[:, place // 4, place % 4] = table[name].to_numpy()
    return T


def as_sweep(table: polars.DataFrame) -> Sweep:
    """The ``Sweep`` a table of rows was made from, in start order."""
    return Sweep(T_target_source=poses(table), **{name: table[name].to_numpy() for name in (*_REAL, *_WHOLE)})


def finish_case(
    case: Case,
    method: str,
    rows: polars.DataFrame,
    right: Right,
    wanted: Claims,
    seed: int,
    chosen: Int[np.ndarray, " c"],
    offset: polars.DataFrame | None,
) -> tuple[polars.DataFrame, dict[str, Any]]:
    """The case's rows of ``results.parquet`` and its entry in ``summary.json``.

    ``chosen`` and ``offset`` are the starts run again with a random translation, and what came of them.
    """
    sweep = as_sweep(rows)
    plateau = basin.plateau(sweep, case.source_centroid, case.size)
    labels = basin.labels(sweep.T_target_source, sweep.error, case.source_centroid, case.size)
    table = rows.with_columns(
        polars.lit(case.pair.name).alias("pair"),
        polars.lit(case.control_points).alias("control_points"),
        polars.lit(method).alias("method"),
        polars.col("outcome").replace_strict(
            {int(code): code.name.lower() for code in Outcome}, return_dtype=polars.String
        ),
        polars.Series("basin", np.asarray(labels, dtype=np.int32)),
        polars.Series("plateau", np.asarray(plateau.members, dtype=bool)),
    ).select("pair", "control_points", "method", polars.exclude("pair", "control_points", "method"))
    best = sweep.best
    entry: dict[str, Any] = {
        "pair": case.pair.name,
        "family": case.pair.family,
        "control_points": case.control_points,
        "method": method,
        "points": {"target": len(case.target.points), "source": len(case.source.points)},
        "starts": len(rows),
        "distinct_starts": basin.distinct(case.starts),
        "outcomes": dict(table["outcome"].value_counts().sort("outcome").iter_rows()),
        "best": {
            "start": int(best.start),
            "error": float(best.error),
            "matched_fraction": float(best.matched_fraction),
            "steps": int(best.steps),
            "outcome": Outcome(int(best.outcome)).name.lower(),
            "sentence": Outcome(int(best.outcome)).sentence,
            "agreement": _agreement(sweep, plateau.members, int(best.start)),
            "T_target_source": np.asarray(best.T_target_source).tolist(),
        },
        "plateau": {
            "found": bool(plateau.found),
            "members": int(np.sum(plateau.members)),
            "level": float(plateau.level),
            "gap": float(plateau.gap),
            "sentence": plateau.sentence,
        },
    }
    truth = case.pair.T_target_source
    if truth is None:
        return table, entry
    errors = basin.truth_errors(sweep.T_target_source, truth, case.source_centroid)
    tolerance = right.tolerance if right.tolerance is not None else right.tolerance_of_size * case.size
    is_right = basin.right(errors, right.tolerance_deg, tolerance)
    table = table.with_columns(
        polars.Series("rotation_error_deg", np.asarray(errors.rotation_deg, dtype=np.float64)),
        polars.Series("quaternion_error", np.asarray(errors.quaternion, dtype=np.float64)),
        polars.Series("translation_error", np.asarray(errors.translation, dtype=np.float64)),
        polars.Series("right", is_right),
    )
    entry["success"] = _success(is_right)
    entry["right_means"] = {"rotation_deg": right.tolerance_deg, "translation": tolerance}
    entry["best"] |= {
        "right": bool(is_right[best.start]),
        "rotation_error_deg": float(errors.rotation_deg[best.start]),
        "translation_error": float(errors.translation[best.start]),
    }
    entry["plateau"] |= _against_truth(plateau.members, is_right)
    entry["claims"] = _claims(case, is_right, right.tolerance_deg, tolerance, wanted, seed, chosen, offset)
    return table, entry


def _agreement(sweep: Sweep, members: Bool[np.ndarray, " s"], best: int) -> float:
    """Of the well-matched starts with at most twice the best error, the share in the plateau; 0 without one."""
    if not members[best]:
        return 0.0
    close = (sweep.matched_fraction >= 0.5 * sweep.matched_fraction.max()) & (sweep.error <= 2 * sweep.error[best])
    return float(np.mean(members[close | members]))


def _success(is_right: Bool[np.ndarray, " s"]) -> dict[str, Any]:
    success = basin.success(is_right)
    return {name: getattr(success, name) for name in ("count", "total", "rate", "low", "high")}


def _against_truth(members: Bool[np.ndarray, " s"], is_right: Bool[np.ndarray, " s"]) -> dict[str, float | None]:
    both = int(np.sum(members & is_right))
    return {
        "precision": both / int(members.sum()) if members.any() else None,
        "recall": both / int(is_right.sum()) if is_right.any() else None,
    }


def _claims(
    case: Case,
    is_right: Bool[np.ndarray, " s"],
    tolerance_deg: float,
    tolerance: float,
    wanted: Claims,
    seed: int,
    chosen: Int[np.ndarray, " c"],
    offset: polars.DataFrame | None,
) -> dict[str, Any]:
    found = claims.coherence(case.starts[:, :3, :3], is_right, wanted.permutations, seed)
    result: dict[str, Any] = {"coherence": found._asdict() if found is not None else None, "translation": None}
    if offset is not None and case.pair.T_target_source is not None:
        errors = basin.truth_errors(as_sweep(offset).T_target_source, case.pair.T_target_source, case.source_centroid)
        moved = basin.right(errors, tolerance_deg, tolerance)
        result["translation"] = claims.translation_effect(is_right[chosen], moved)._asdict()
    return result


def pooled_translation(cases: list[dict[str, Any]]) -> dict[str, Any] | None:
    """The test of the translation claim over all cases together, ``None`` where it was not made."""
    known = [case["claims"]["translation"] for case in cases if (case.get("claims") or {}).get("translation")]
    if not known:
        return None
    counts = [sum(effect[name] for effect in known) for name in ("both", "only_without", "only_with", "neither")]
    return claims.paired_effect(*counts)._asdict()
