"""The experiment ``iterations`` (thesis §2.9.5, Figs 2.44, 2.45): the true error, iteration by iteration.

For each pair a few tests draw a number of points and a start at random; each is registered with every kind of control
points, with the same number of points and from the same pose, and every iteration is kept.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.register.intervals import mean_over_units
from jaxmodel.run.chapter2 import comparison
from jaxmodel.run.chapter2.study import Study
from jaxmodel.run.chapter2.trials import StudyConfig, Trial, placed_pairs, starts_of
from jaxmodel.run.study_report import draw_study
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

_CLOSE = 1.5
"""A registration has arrived when its true error stays below this multiple of the final one."""


@dataclass(frozen=True, kw_only=True)
class Config(StudyConfig):
    """The YAML of the experiment.

    ``tests``: how many of the combinations of one of ``counts`` with one of ``starts.count`` starts are drawn.
    """

    experiment: Literal["iterations"] = "iterations"
    tests: int = 6

    def __post_init__(self) -> None:
        super().__post_init__()
        most = len(self.counts) * self.starts.count
        if not 1 <= self.tests <= most:
            raise ValueError(f"tests is {self.tests}, expected 1 to {most}, the number of combinations")


def prepare(config: Config) -> Study:
    """Read and check everything ``config`` names."""
    trials = []
    for number, placed in enumerate(placed_pairs(config)):
        starts = starts_of(config, placed.pair, number)
        draw = np.random.default_rng([config.seed, number]).permutation(len(config.counts) * len(starts))
        for test, combination in enumerate(draw[: config.tests].tolist()):
            count, start = config.counts[combination % len(config.counts)], combination // len(config.counts)
            chosen, counts = starts[start : start + 1], (count, count)
            kinds, stands_for = placed.group.control_points, placed.group.stands_for
            variant = f"test {test}: {count} points, start {start}"
            trials.append(Trial(placed.pair, kinds, counts, chosen, placed.draw, stands_for, variant, traced=1))
    return Study("iterations", config, trials, _summarise)


def _summarise(
    config: Config,
    trials: list[Trial],
    rows: polars.DataFrame,
    iterations: polars.DataFrame,
    costs: list[dict[str, Any]],
) -> dict[str, Any]:
    arrived = {
        (str(kind), int(str(trial))): _arrival(of.sort("iteration")["rotation_error_deg"].to_numpy())
        for (kind, trial), of in iterations.group_by("control_points", "trial")
    }
    found = []
    for (pair, kind), of in rows.group_by("pair", "control_points", maintain_order=True):
        right, tests = of["right"].to_numpy(), of["trial"].to_list()
        reached = np.array([arrived.get((str(kind), trial), np.nan) for trial in tests], dtype=float)

        def mean(values: np.ndarray, right: Any = right, tests: Any = tests) -> dict[str, Any]:
            of_right = np.where(right, values.astype(float), np.nan)
            return mean_over_units(of_right, np.array(tests), config.resamples, config.seed)._asdict()

        trial = trials[tests[0]]
        found.append(
            {
                "pair": pair,
                "stands_for": trial.stands_for,
                "kind": kind,
                "tests": len(of),
                "right": int(right.sum()),
                "iterations": mean(of["steps"].to_numpy()),
                "arrival": mean(reached),
                "rises": mean(of["increases"].to_numpy()),
                "rotation_error_deg": mean(of["rotation_error_deg"].to_numpy()),
            }
        )
    compared = comparison.by_family(rows, costs, config.compared, config.resamples, config.seed)
    return {"pairs": found, "comparison": compared}


def _arrival(error: np.ndarray) -> float:
    """First iteration from which the error stays close to the last one."""
    far = np.flatnonzero(~(error <= _CLOSE * error[-1]))
    return float(far[-1] + 2 if len(far) else 1)


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Each pair with each kind; the families compared; the thesis shows curves only."""

    def shown(estimate: Mapping[str, Any], form: str, unit: str = "") -> str:
        return "none" if estimate["value"] is None else format(estimate["value"], form) + unit

    lines = [
        (
            of["pair"],
            of["stands_for"],
            of["kind"],
            f"{of['right']} of {of['tests']}",
            shown(of["iterations"], ".0f"),
            shown(of["arrival"], ".0f"),
            shown(of["rises"], ".1f"),
            shown(of["rotation_error_deg"], ".3f", "°"),
        )
        for of in summary["pairs"]
    ]
    columns = (
        "pair", "published curves of", "kind", "right", "iterations", f"true error within {_CLOSE:g} x its end",
        "iterations at which the ICP error rose", "final true rotation error",
    )  # fmt: skip
    return [
        *comparison.family_tables(summary["comparison"]),
        Table(f"Published (curves only) | ours, Figs 2.44, 2.45; means of the right ones | {command}", columns, lines),
    ]


def charts(summary: Mapping[str, Any], rows: polars.DataFrame, iterations: polars.DataFrame) -> list[Chart]:
    """For each pair the true error of every test, a panel for each kind, and the ICP error of the first test."""
    drawn = []
    for pair in dict.fromkeys(of["pair"] for of in summary["pairs"]):
        mine = iterations.filter(polars.col("pair") == pair)
        panels, first = [], []
        for (kind,), of_kind in mine.group_by("control_points", maintain_order=True):
            curves = []
            for (variant,), of in of_kind.group_by("variant", maintain_order=True):
                curves.append(Series(str(variant), of["iteration"].to_list(), of["rotation_error_deg"].to_list()))
                if not first or first[-1].label != kind:
                    first.append(Series(str(kind), of["iteration"].to_list(), of["error"].to_list()))
            panels.append(Panel(f"{pair}, {kind}", "iteration", "true rotation error (°)", curves, log_y=True))
        if panels:
            panels.append(Panel(f"{pair}, first test", "iteration", "ICP error (unit of the data)", first))
            drawn.append(Chart(f"{pair}-iterations", f"{pair}: error along the iterations", panels))
    return drawn


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_study(folder, summary, "Error along the iterations (thesis §2.9.5)", tables, charts)
