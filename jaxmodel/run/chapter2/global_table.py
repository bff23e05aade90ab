"""The experiment ``global_table`` (thesis §2.9.6, Table 2.4): many tests of many objects, the families compared.

Every pair is registered at every number of points from every start with all kinds. The table counts tests and failures
object by object, as the thesis does; the comparison of the families answers the chapter's question with intervals.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.run.chapter2 import comparison
from jaxmodel.run.chapter2.study import Study
from jaxmodel.run.chapter2.trials import StudyConfig, Trial, plain_trials
from jaxmodel.run.published import published_table
from jaxmodel.run.study_report import draw_study
from jaxmodel.view.charts import Chart
from jaxmodel.view.table import Table


@dataclass(frozen=True, kw_only=True)
class Config(StudyConfig):
    """The YAML of the global table."""

    experiment: Literal["global_table"] = "global_table"


def prepare(config: Config) -> Study:
    """Read and check everything ``config`` names."""
    return Study("global_table", config, plain_trials(config), _summarise)


def _summarise(
    config: Config,
    trials: list[Trial],
    rows: polars.DataFrame,
    iterations: polars.DataFrame,
    costs: list[dict[str, Any]],
) -> dict[str, Any]:
    stands_for = {trial.pair.subject: trial.stands_for for trial in trials}
    return {
        "objects": [
            {
                "subject": subject,
                "family": of.item(0, "family"),
                "stands_for": stands_for[str(subject)],
                **_object(of, config.compared),
            }
            for (subject,), of in rows.group_by("subject", maintain_order=True)
        ],
        "comparison": comparison.by_family(rows, costs, config.compared, config.resamples, config.seed),
    }


def _object(rows: polars.DataFrame, kinds: tuple[str, str]) -> dict[str, Any]:
    """Counts and mean final errors of one object; errors are those of the tests that came out right."""
    counted: dict[str, Any] = {}
    for kind in kinds:
        mine = rows.filter(polars.col("control_points") == kind)
        good = mine.filter("right")
        counted[kind] = {
            "tests": len(mine),
            "resolutions": mine["asked"].n_unique(),
            "pairs": mine["pair"].n_unique(),
            "not_converged": int((~mine["right"]).sum()),
            "rotation_error_deg": _mean(good["rotation_error_deg"]),
            "translation_percent": 100 * _mean(good["translation_error_of_size"]),
            "iterations": _mean(good["steps"]),
        }
    right = [rows.filter(polars.col("control_points") == kind).sort("trial", "start")["right"] for kind in kinds]
    neither = int((~(right[0] | right[1])).sum()) if len(right[0]) == len(right[1]) else None
    return {"kinds": counted, "neither": neither}


def _mean(values: polars.Series) -> float:
    return float(np.mean(values.to_numpy())) if len(values) else float("nan")


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """The families compared, and Table 2.4 as *published | ours*."""
    found = comparison.family_tables(summary["comparison"])
    published = published_table("global_table")
    columns = (
        "object",
        "stands for",
        "kind",
        "tests (pairs, resolutions)",
        "not converged",
        "mean error, right ones",
        "published: tests, not converged, mean error",
    )
    lines = []
    for entry in summary["objects"]:
        for kind, of in entry["kinds"].items():
            if not of["tests"]:
                continue
            theirs = published["objects"].get(entry["stands_for"])
            lines.append(
                (
                    f"{entry['subject']} ({entry['family'].replace('_', '-')})",
                    entry["stands_for"],
                    kind,
                    f"{of['tests']} ({of['pairs']}, {of['resolutions']})",
                    f"{of['not_converged']} ({100 * of['not_converged'] / of['tests']:.1f} %)",
                    _errors(of),
                    _theirs(theirs, kind),
                )
            )
    return [*found, Table(f"Published | ours, Table 2.4 | {command}", columns, lines)]


def _errors(of: Mapping[str, Any]) -> str:
    if of["rotation_error_deg"] is None or not np.isfinite(of["rotation_error_deg"]):
        return "none right"
    return f"{of['rotation_error_deg']:.3f}°, {of['translation_percent']:.3f} % of the size"


def _theirs(of: Mapping[str, Any] | None, kind: str) -> str:
    if of is None or kind not in of["not_converged"]:
        return "not in the thesis"
    error = of["mean_error"][kind]
    return f"{of['tests']}, {of['not_converged'][kind]}, {'na' if error is None else error}"


def charts(summary: Mapping[str, Any], rows: polars.DataFrame, iterations: polars.DataFrame) -> list[Chart]:
    """The families side by side, every figure with its interval."""
    return [comparison.chart("families", "Contours and mesh vertices, by family", summary["comparison"])]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_study(folder, summary, "Global table (thesis §2.9.6)", tables, charts)
