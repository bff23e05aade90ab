"""The experiment ``resolution`` (thesis §2.9.3, Table 2.1, Fig. 2.40): how few points still register, and how fast.

Three parts on the same pairs and starts: eight numbers of points; two views of high or low resolution combined; and
one fine registration against a coarse one that gives the fine one its start.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.register.intervals import mean_over_units, rate_over_units
from jaxmodel.run.chapter2.resolution_report import charts, tables
from jaxmodel.run.chapter2.study import Study
from jaxmodel.run.chapter2.trials import Placed, StudyConfig, Trial, placed_pairs, starts_of
from jaxmodel.run.study_report import draw_study

__all__ = ["Config", "draw", "prepare", "tables"]


@dataclass(frozen=True)
class Levels:
    """Two numbers of points."""

    high: int
    low: int

    def __post_init__(self) -> None:
        if not 3 <= self.low < self.high:
            raise ValueError(f"low is {self.low} and high {self.high}, expected 3 <= low < high")


@dataclass(frozen=True, kw_only=True)
class Config(StudyConfig):
    """The YAML of the experiment. ``counts``: Table 2.1; ``combined``: Fig. 2.40; ``two_steps``: fine and coarse."""

    experiment: Literal["resolution"] = "resolution"
    counts: tuple[int, ...] = (3600, 3500, 1870, 1800, 800, 780, 590, 380)
    combined: Levels = Levels(5000, 2000)
    two_steps: Levels = Levels(3500, 500)


def prepare(config: Config) -> Study:
    """Read and check everything ``config`` names."""
    trials: list[Trial] = []
    for number, placed in enumerate(placed_pairs(config)):
        trials += _trials(config, placed, starts_of(config, placed.pair, number), len(trials))
    return Study("resolution", config, trials, _summarise)


def _trials(config: Config, placed: Placed, starts: np.ndarray, before: int) -> list[Trial]:
    """All trials of one pair; ``before``: how many trials come before it."""
    both, two = config.combined, config.two_steps

    def trial(variant: str, target: int, source: int, traced: int, follows: int | None = None) -> Trial:
        kinds, stands_for = placed.group.control_points, placed.group.stands_for
        counts = target, source
        return Trial(placed.pair, kinds, counts, starts, placed.draw, stands_for, variant, traced, follows)

    trials = [trial(f"resolution {count}", count, count, 1) for count in config.counts]
    levels = {"H": both.high, "L": both.low}
    trials += [trial(f"{a}-{b}", levels[a], levels[b], 1) for a, b in ("HH", "LL", "HL")]
    trials += [trial("fine alone", two.high, two.high, 0), trial("coarse", two.low, two.low, 0)]
    trials.append(trial("coarse, then fine", two.high, two.high, 0, before + len(trials) - 1))
    return trials


def _summarise(
    config: Config,
    trials: list[Trial],
    rows: polars.DataFrame,
    iterations: polars.DataFrame,
    costs: list[dict[str, Any]],
) -> dict[str, Any]:
    kinds = list(dict.fromkeys(rows["control_points"].to_list()))
    found = [
        _variant(config, rows, iterations, variant, kind)
        for variant in dict.fromkeys(trial.variant for trial in trials)
        for kind in kinds
    ]
    return {
        "pairs": list(dict.fromkeys(trial.pair.name for trial in trials)),
        "stands_for": trials[0].stands_for,
        "kinds": kinds,
        "variants": found,
        "two_steps": [_two_steps(config, rows, costs, kind) for kind in kinds],
    }


def _variant(
    config: Config, rows: polars.DataFrame, iterations: polars.DataFrame, variant: str, kind: str
) -> dict[str, Any]:
    """One number of points with one kind; everything but the rate is of the registrations that came out right."""
    of = rows.filter((polars.col("variant") == variant) & (polars.col("control_points") == kind))
    right, pair = of["right"].to_numpy(), of["pair"].to_numpy()

    def mean(name: str) -> dict[str, Any]:
        values = np.where(right, of[name].to_numpy().astype(float), np.nan)
        return mean_over_units(values, pair, config.resamples, config.seed)._asdict()

    return {
        "variant": variant,
        "kind": kind,
        "tests": len(of),
        "points": {end: round(float(np.mean(of[f"points_{end}"].to_numpy()))) for end in ("target", "source")},
        "rate": rate_over_units(right, pair, config.resamples, config.seed)._asdict(),
        "iterations": mean("steps"),
        "matched": mean("matched_fraction"),
        "error": mean("error"),
        "rotation_error_deg": mean("rotation_error_deg"),
        "early_error": _early_error(iterations, variant, kind, config.compared[1]),
    }


def _early_error(iterations: polars.DataFrame, variant: str, kind: str, other: str) -> float | None:
    """ICP error of ``kind`` at the iteration at which ``other`` ended: mean of the pairs' first starts (Table 2.1)."""
    traced = iterations.filter(polars.col("variant") == variant)
    ends = dict(traced.filter(polars.col("control_points") == other).group_by("trial").len().iter_rows())
    early = [
        float(of.sort("iteration")["error"][min(ends[trial], len(of)) - 1])
        for (trial,), of in traced.filter(polars.col("control_points") == kind).group_by("trial", maintain_order=True)
        if trial in ends
    ]
    return float(np.mean(early)) if early else None


def _two_steps(config: Config, rows: polars.DataFrame, costs: list[dict[str, Any]], kind: str) -> dict[str, Any]:
    """Seconds of a fine registration, and of a coarse one followed by the fine one, voxel tables with and without."""

    def mean(variant: str, part: str) -> float:
        mine = [cost for cost in costs if cost["variant"] == variant and cost["control_points"] == kind]
        return float(np.mean([cost[part] for cost in mine]))

    def of(variant: str) -> polars.DataFrame:
        return rows.filter((polars.col("variant") == variant) & (polars.col("control_points") == kind))

    steps = {v: float(np.mean(of(v)["steps"].to_numpy())) for v in ("fine alone", "coarse", "coarse, then fine")}
    fine, coarse = config.two_steps.high**2, config.two_steps.low**2
    one = {part: mean("fine alone", part) for part in ("registration", "table")}
    two = {part: mean("coarse", part) + mean("coarse, then fine", part) for part in ("registration", "table")}
    quadratic = steps["coarse"] * coarse + steps["coarse, then fine"] * fine
    return {
        "kind": kind,
        "steps": steps,
        "rates": {
            variant: rate_over_units(
                of(variant)["right"].to_numpy(), of(variant)["pair"].to_numpy(), config.resamples, config.seed
            )._asdict()
            for variant in steps
        },
        "fine_alone": one,
        "two_steps": two,
        "faster": one["registration"] / two["registration"] if two["registration"] else None,
        "faster_with_tables": sum(one.values()) / sum(two.values()) if sum(two.values()) else None,
        "faster_if_quadratic": steps["fine alone"] * fine / quadratic if quadratic else None,
    }


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_study(folder, summary, "Resolution (thesis §2.9.3)", tables, charts)
