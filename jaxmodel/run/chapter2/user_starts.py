"""The experiment ``user_starts`` (thesis §2.9.2): convergence from starts as a person would choose them.

The thesis does not say how its users chose; here each start is the true pose turned about a random axis and moved, with
the laws stated in ``PlausibleStarts``. Rates are counted both ways: over all tests, and, as the thesis does, over those
in which at least one kind of control points converged.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.geometry.se3 import rotation_angle_deg
from jaxmodel.io.results import RunDir
from jaxmodel.register.intervals import rate_over_units
from jaxmodel.run.chapter2 import comparison
from jaxmodel.run.chapter2.study import Study
from jaxmodel.run.chapter2.trials import StudyConfig, Trial, plain_trials
from jaxmodel.run.published import published_table
from jaxmodel.run.study_report import draw_study
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

_STEPS_DEG = (0, 10, 20, 30, 40, 50, 60, 90, 180)
"""Edges of the classes of the start's angle."""


@dataclass(frozen=True, kw_only=True)
class Config(StudyConfig):
    """The YAML of the experiment."""

    experiment: Literal["user_starts"] = "user_starts"


def prepare(config: Config) -> Study:
    """Read and check everything ``config`` names."""
    return Study("user_starts", config, plain_trials(config), _summarise)


def _summarise(
    config: Config,
    trials: list[Trial],
    rows: polars.DataFrame,
    iterations: polars.DataFrame,
    costs: list[dict[str, Any]],
) -> dict[str, Any]:
    angles = {number: _start_angles(trial) for number, trial in enumerate(trials)}
    angle = np.array([angles[trial][start] for trial, start in rows.select("trial", "start").iter_rows()])
    by_angle = [
        {
            "family": family,
            "control_points": kind,
            "from_deg": low,
            "to_deg": high,
            "rate": rate_over_units(
                of["right"].to_numpy(), of["pair"].to_numpy(), config.resamples, config.seed
            )._asdict(),
        }
        for low, high in pairwise(_STEPS_DEG)
        for (family, kind), of in rows.filter(polars.Series((angle >= low) & (angle < high))).group_by(
            "family", "control_points", maintain_order=True
        )
    ]
    return {
        "starts": {
            "count": config.starts.count,
            "spread_deg": config.starts.spread_deg,
            "most_deg": config.starts.most_deg,
            "shift_of_size": config.starts.shift_of_size,
        },
        "comparison": comparison.by_family(rows, costs, config.compared, config.resamples, config.seed),
        "by_angle": by_angle,
    }


def _start_angles(trial: Trial) -> np.ndarray:
    assert trial.pair.T_target_source is not None
    return rotation_angle_deg(np.swapaxes(trial.starts[:, :3, :3], 1, 2) @ trial.pair.T_target_source[:3, :3])


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """The families compared, and the published rates beside ours in both ways of counting."""
    drawn = summary["starts"]
    how = (
        f"starts: true pose, turned by |N(0, {drawn['spread_deg']:g}°)| (at most {drawn['most_deg']:g}°) about a "
        f"random axis, moved within a ball of {100 * drawn['shift_of_size']:g} % of the size"
    )
    published = published_table("convergence")["chosen_by_user"]
    lines = []
    for family, found in summary["comparison"].items():
        for kind in found["kinds"]:
            theirs = published[family].get(kind)
            ours = [comparison.text(found["figures"][f.key][kind], f) for f in comparison.FIGURES[:2]]
            lines.append((family.replace("_", "-"), kind, "none" if theirs is None else f"{100 * theirs:.0f} %", *ours))
    columns = ("family", "kind", "published", "ours, all tests", "ours, tests where either converged")
    return [
        *comparison.family_tables(summary["comparison"]),
        Table(f"Published | ours, starts chosen by a user ({how}) | {command}", columns, lines),
    ]


def charts(summary: Mapping[str, Any], rows: polars.DataFrame, iterations: polars.DataFrame) -> list[Chart]:
    """The rate against the start's angle, and the families side by side."""
    panels = []
    for family in summary["comparison"]:
        of_family = [entry for entry in summary["by_angle"] if entry["family"] == family]
        classes = list(dict.fromkeys((entry["from_deg"], entry["to_deg"]) for entry in of_family))
        series = []
        for kind in dict.fromkeys(entry["control_points"] for entry in of_family):
            rates = {
                (entry["from_deg"], entry["to_deg"]): entry["rate"]
                for entry in of_family
                if entry["control_points"] == kind
            }
            value, low, high = (
                [100 * _number(rates[place][end]) if place in rates else np.nan for place in classes]
                for end in ("value", "low", "high")
            )
            series.append(Series(kind, [f"{first}-{last}" for first, last in classes], value, low, high))
        title = f"{family.replace('_', '-')} objects"
        panels.append(Panel(title, "angle between start and truth (°)", "converged (%)", series))
    by_angle = [Chart("by-angle", "Convergence by the start's angle", panels)] if panels else []
    return [*by_angle, comparison.chart("families", "Starts chosen by a user, by family", summary["comparison"])]


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_study(folder, summary, "Starts chosen by a user (thesis §2.9.2)", tables, charts)
