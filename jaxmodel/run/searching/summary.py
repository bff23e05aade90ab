"""What a finished search of many pairs comes to."""

from typing import Any

import numpy as np
import polars

from jaxmodel.register.degeneracy import Kind
from jaxmodel.register.verdict import CONVINCING, SearchOutcome
from jaxmodel.run.searching.judging import area_under_curve, operating_curve

BINS = 5


def summarised(table: polars.DataFrame, least_overlap: float) -> dict[str, Any]:
    """``pairs``: each in short; where there is a truth, counts by subject and how well the probability knew."""
    pairs = [_pair(row) for row in table.iter_rows(named=True)]
    known = table.filter(polars.col("right").is_not_null())
    summary: dict[str, Any] = {"pairs": pairs, "least_overlap": least_overlap, "subjects": []}
    if not len(known):
        return summary
    for subject in known["subject"].unique(maintain_order=True):
        summary["subjects"].append(
            _counted(str(subject), known.filter(polars.col("subject") == subject), least_overlap)
        )
    summary["all"] = _counted("all", known, least_overlap)
    probability, alike = known["probability"].to_numpy(), known["alike"].to_numpy().astype(bool)
    wrong_share, right_share = operating_curve(probability, alike)
    summary["curve"] = {"wrong": wrong_share.tolist(), "right": right_share.tolist()}
    edges = np.minimum((probability * BINS).astype(int), BINS - 1)
    summary["bins"] = [
        {
            "low": b / BINS,
            "pairs": int((edges == b).sum()),
            "probability": float(probability[edges == b].mean()),
            "right": float(alike[edges == b].mean()),
        }
        for b in range(BINS)
        if (edges == b).any()
    ]
    return summary


def _pair(row: dict[str, Any]) -> dict[str, Any]:
    T = [[row[f"T_{i}{j}"] for j in range(4)] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]
    told = ("pair", "subject", "outcome", "probability", "overlap_target", "overlap_source", "contradicted", "scatter")
    judged = ("turn_deg", "shift", "right", "alike", "true_target", "true_source")
    return {
        **{key: row[key] for key in told},
        "sentence": SearchOutcome[row["outcome"].upper()].sentence,
        "rival": row["rival"],
        "free": {
            "kind": row["free"],
            "sentence": Kind[row["free"].upper()].sentence,
            "axis": row["free_axis"],
            "point": row["free_point"],
        },
        "T_target_source": T,
        "equivalents": [[[*each[4 * i : 4 * i + 4]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]
                        for each in row["equivalents"]],
        **{key: row[key] for key in judged},
        "seconds": round(row["seconds"], 3),
    }  # fmt: skip


def _counted(name: str, rows: polars.DataFrame, least_overlap: float) -> dict[str, Any]:
    right, alike = (rows[key].to_numpy().astype(bool) for key in ("right", "alike"))
    probability = rows["probability"].to_numpy()
    overlap = np.minimum(rows["true_target"].to_numpy(), rows["true_source"].to_numpy())
    enough, none, accepted = overlap >= least_overlap, overlap <= 0.0, probability >= CONVINCING
    return {
        "name": name,
        "pairs": len(rows),
        "enough": int(enough.sum()),
        "enough_right": int((enough & right).sum()),
        "enough_alike": int((enough & alike).sum()),
        "enough_accepted": int((enough & alike & accepted).sum()),
        "right": int(right.sum()),
        "alike": int(alike.sum()),
        "apart": int(none.sum()),
        "apart_refused": int((none & ~accepted).sum()),
        "accepted_wrong": int((accepted & ~alike).sum()),
        "area_alike": area_under_curve(probability, alike),
        "area_right": area_under_curve(probability, right),
        "median_seconds": float(np.median(rows["seconds"].to_numpy())),
        "longest_seconds": float(rows["seconds"].to_numpy().max()),
    }
