"""The experiment ``cylinder`` (thesis §2.9.6, Figs 2.46, 2.47): which contour labels to use on which object.

On a cylindrical object the occluding contours move with the sensor, so the thesis drops them and keeps creases; on a
polyhedron they are real edges and are kept. Each group's first kind of control points is compared with each other one.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import polars

from jaxmodel.io.results import RunDir
from jaxmodel.run.chapter2 import comparison
from jaxmodel.run.chapter2.study import Study
from jaxmodel.run.chapter2.trials import StudyConfig, Trial, plain_trials
from jaxmodel.run.study_report import draw_study
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

_CLAIMS = {
    "WYE": "Fig. 2.46: creases alone are faster and more precise",
    "BLOCK2": "Fig. 2.47: all contours register the polyhedron",
}


@dataclass(frozen=True, kw_only=True)
class Config(StudyConfig):
    """The YAML of the experiment. ``traced``: starts of each trial that are drawn iteration by iteration."""

    experiment: Literal["cylinder"] = "cylinder"
    traced: int = 1


def prepare(config: Config) -> Study:
    """Read and check everything ``config`` names."""
    trials = [dataclasses.replace(trial, traced=config.traced) for trial in plain_trials(config)]
    return Study("cylinder", config, trials, _summarise)


def _summarise(
    config: Config,
    trials: list[Trial],
    rows: polars.DataFrame,
    iterations: polars.DataFrame,
    costs: list[dict[str, Any]],
) -> dict[str, Any]:
    found = []
    for subject in dict.fromkeys(trial.pair.subject for trial in trials):
        of = rows.filter(polars.col("subject") == subject)
        trial = next(trial for trial in trials if trial.pair.subject == subject)
        for other in trial.labels[1:]:
            pair = trial.labels[0], other
            compared = comparison.compare(of, costs, pair, config.resamples, config.seed)
            if compared is not None:
                found.append({"subject": subject, "stands_for": trial.stands_for, **compared})
    return {"comparisons": found}


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """One table for each comparison; the last says what the thesis shows and what came out here."""
    found, lines = [], []
    for compared in summary["comparisons"]:
        name = f"{compared['subject']}: {compared['tests']} tests, {compared['pairs']} pairs"
        title = f"{compared['kinds'][0]} against {compared['kinds'][1]} on {compared['subject']}"
        found.append(Table(title, comparison.columns(compared), comparison.lines(name, compared)))
        better = {compared["kinds"][0]: "first", compared["kinds"][1]: "second", "undecided": "undecided"}
        verdicts = [better[comparison.verdict(compared, figure)] for figure in comparison.FIGURES]
        claim = _CLAIMS.get(compared["stands_for"], "not in the thesis")
        lines.append((compared["subject"], claim, *compared["kinds"], *verdicts))
    columns = ("object", "published (pictures only)", "first", "second", *(f.what for f in comparison.FIGURES))
    return [*found, Table(f"Published | ours: which is better, Figs 2.46 and 2.47 | {command}", columns, lines)]


def charts(summary: Mapping[str, Any], rows: polars.DataFrame, iterations: polars.DataFrame) -> list[Chart]:
    """Convergence of each object with each kind, and the true error along the iterations of the first pair."""
    drawn = []
    for number, compared in enumerate(summary["comparisons"]):
        title = f"{compared['subject']}: {' and '.join(compared['kinds'])}"
        drawn.append(comparison.chart(f"{compared['subject']}-{number}", title, {compared["subject"]: compared}))
    panels = []
    for subject in dict.fromkeys(compared["subject"] for compared in summary["comparisons"]):
        pair = rows.filter(polars.col("subject") == subject)["pair"][0]
        mine = iterations.filter((polars.col("pair") == pair) & (polars.col("start") == 0))
        mine = mine.filter(polars.col("trial") == mine["trial"].min())
        series = [
            Series(str(kind), of["iteration"].to_list(), of["rotation_error_deg"].to_list())
            for (kind,), of in mine.group_by("control_points", maintain_order=True)
        ]
        panels.append(Panel(f"{pair}, one start", "iteration", "true rotation error (°)", series))
    along = [Chart("iterations", "Error against the truth along the iterations", panels)] if panels else []
    return [*along, *drawn]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_study(folder, summary, "Contour labels on a cylindrical object (thesis §2.9.6)", tables, charts)
