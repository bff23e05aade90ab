"""Two kinds of control points on the same tests: rates, errors, iterations and times with intervals, and the verdict.

A test is one start of one trial, registered with both kinds. Errors and iterations are compared where both kinds came
out right, so that a kind is not favoured by failing on the hard tests. Pairs of scans are resampled (see
``register/intervals.py``).
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars
from jaxtyping import Bool, Float, Shaped

from jaxmodel.register.intervals import Estimate, difference_over_units, mean_over_units, rate_over_units
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table


class Figure(NamedTuple):
    """One thing that is compared; ``scale`` brings it to ``unit``."""

    key: str
    what: str
    unit: str
    scale: float = 1.0
    more_is_better: bool = False


FIGURES = (
    Figure("rate", "converged", "%", 100.0, True),
    Figure("rate_either", "converged, of tests where either did", "%", 100.0, True),
    Figure("rotation_error_deg", "true rotation error", "°"),
    Figure("translation_error_of_size", "true translation error", "% of the size", 100.0),
    Figure("steps", "iterations", ""),
    Figure("seconds", "time with extraction", "s"),
)


def compare(
    rows: polars.DataFrame,
    costs: Sequence[Mapping[str, Any]],
    kinds: tuple[str, str] = ("contours", "vertices"),
    resamples: int = 2000,
    seed: int = 0,
) -> dict[str, Any] | None:
    """Every figure for both kinds and its paired difference, first kind minus second.

    Args:
        rows: of ``results.parquet``; trials that lack one of the kinds do not count.
        costs: of the summary, those of other trials do not count.
        kinds: labels of the two kinds.
        resamples, seed: of the bootstrap.

    Returns:
        ``kinds``, ``tests``, ``pairs``, ``both_right``, and ``figures``: key -> estimates of ``kinds[0]``,
        ``kinds[1]`` and the ``difference``. None where no trial has both kinds.
    """
    first, second = (rows.filter(polars.col("control_points") == kind) for kind in kinds)
    shared = set(first["trial"].to_list()) & set(second["trial"].to_list())
    if not shared:
        return None
    first, second = (kind.filter(polars.col("trial").is_in(shared)).sort("trial", "start") for kind in (first, second))
    units = first["pair"].to_numpy()
    right = first["right"].to_numpy(), second["right"].to_numpy()
    both, either = right[0] & right[1], right[0] | right[1]
    found = {
        "rate": _rates(right, np.ones(len(units), bool), units, resamples, seed),
        "rate_either": _rates(right, either, units, resamples, seed),
    }
    for key in ("rotation_error_deg", "translation_error_of_size", "steps"):
        values = [np.where(both, kind[key].to_numpy().astype(float), np.nan) for kind in (first, second)]
        found[key] = _means(values[0], values[1], units, resamples, seed)
    spent = {kind: _seconds(costs, kind) for kind in kinds}
    trials = sorted(shared & set(spent[kinds[0]]) & set(spent[kinds[1]]))
    seconds = [np.array([spent[kind][trial] for trial in trials], dtype=float) for kind in kinds]
    pair_of = dict(zip(first["trial"].to_list(), first["pair"].to_list(), strict=True))
    found["seconds"] = _means(seconds[0], seconds[1], np.array([pair_of[t] for t in trials]), resamples, seed)
    return {
        "kinds": list(kinds),
        "tests": len(units),
        "pairs": len(np.unique(units)),
        "both_right": int(both.sum()),
        "figures": {
            key: {name: estimate._asdict() for name, estimate in zip((*kinds, "difference"), three, strict=True)}
            for key, three in found.items()
        },
    }


def _seconds(costs: Sequence[Mapping[str, Any]], kind: str) -> dict[int, float]:
    """Trial -> seconds of one registration with all that comes before it, where there were points."""
    return {
        cost["trial"]: cost["extraction"] + cost["table"] + cost["registration"]
        for cost in costs
        if cost["control_points"] == kind and cost["points"]["target"]
    }


def _rates(
    right: tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]],
    counted: Bool[np.ndarray, " n"],
    units: Shaped[np.ndarray, " n"],
    resamples: int,
    seed: int,
) -> list[Estimate]:
    one, other, of = right[0][counted], right[1][counted], units[counted]
    rates = [rate_over_units(kind, of, resamples, seed) for kind in (one, other)]
    return [*rates, difference_over_units(one.astype(float), other.astype(float), of, resamples, seed)]


def _means(
    one: Float[np.ndarray, " n"],
    other: Float[np.ndarray, " n"],
    units: Shaped[np.ndarray, " n"],
    resamples: int,
    seed: int,
) -> list[Estimate]:
    means = [mean_over_units(kind, units, resamples, seed) for kind in (one, other)]
    return [*means, difference_over_units(one, other, units, resamples, seed)]


def by_family(
    rows: polars.DataFrame,
    costs: Sequence[Mapping[str, Any]],
    kinds: tuple[str, str] = ("contours", "vertices"),
    resamples: int = 2000,
    seed: int = 0,
) -> dict[str, dict[str, Any]]:
    """``compare`` for each family of objects that has both kinds."""
    found = {}
    for family in ("structured", "free_form"):
        comparison = compare(rows.filter(polars.col("family") == family), costs, kinds, resamples, seed)
        if comparison is not None:
            found[family] = comparison
    return found


def verdict(comparison: Mapping[str, Any], figure: Figure) -> str:
    """The kind that is better in one figure, or ``undecided`` where the interval of the difference holds zero."""
    difference = comparison["figures"][figure.key]["difference"]
    low, high = (np.nan if difference[end] is None else difference[end] for end in ("low", "high"))
    if not (low > 0 or high < 0):
        return "undecided"
    return comparison["kinds"][0 if (low > 0) == figure.more_is_better else 1]


def text(estimate: Mapping[str, Any], figure: Figure, signed: bool = False) -> str:
    """An estimate with its interval and unit."""
    value, low, high = (
        np.nan if estimate[key] is None else figure.scale * estimate[key] for key in ("value", "low", "high")
    )
    if not np.isfinite(value):
        return "none"
    largest = max(abs(number) for number in (value, low, high, 1e-3) if np.isfinite(number))
    digits = max(0, 1 - int(np.floor(np.log10(largest))))
    sign = "+" if signed else ""
    unit = f" {figure.unit}" if figure.unit and figure.unit != "°" else figure.unit
    interval = f" [{low:{sign}.{digits}f}, {high:{sign}.{digits}f}]" if np.isfinite(low) else ""
    return f"{value:{sign}.{digits}f}{interval}{unit}"


def lines(name: str, comparison: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The comparison as rows under ``columns``."""
    one, other = comparison["kinds"]
    rows = []
    for figure in FIGURES:
        found = comparison["figures"][figure.key]
        rows.append(
            (
                name,
                figure.what,
                text(found[one], figure),
                text(found[other], figure),
                text(found["difference"], figure, signed=True),
                verdict(comparison, figure),
            )
        )
    return rows


def family_tables(compared: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """One table with all families, empty where none has both kinds."""
    rows = [line for family, found in compared.items() for line in lines(_described(family, found), found)]
    first = next(iter(compared.values()), None)
    if first is None:
        return []
    title = f"{first['kinds'][0].capitalize()} against {first['kinds'][1]} (pairs of scans are resampled)"
    return [Table(title, columns(first), rows)]


def _described(family: str, found: Mapping[str, Any]) -> str:
    return f"{family.replace('_', '-')}, {found['tests']} tests of {found['pairs']} pair{'s' * (found['pairs'] != 1)}"


def columns(comparison: Mapping[str, Any]) -> tuple[str, ...]:
    """Headings for ``lines``."""
    return ("", "figure", *comparison["kinds"], "difference, 95 % interval", "better")


def chart(name: str, title: str, compared: Mapping[str, Mapping[str, Any]]) -> Chart:
    """Bars with intervals, a panel for each figure, a bar of each kind for each entry of ``compared``."""
    entries = [(label.replace("_", "-"), found) for label, found in compared.items() if found]
    kinds = list(dict.fromkeys(kind for _, found in entries for kind in found["kinds"]))

    def values(kind: str, figure: Figure, end: str) -> list[float]:
        found = [c["figures"][figure.key].get(kind, {}).get(end) for _, c in entries]
        return [np.nan if value is None else figure.scale * value for value in found]

    panels = [
        Panel(
            figure.what,
            "",
            f"{figure.what} ({figure.unit})" if figure.unit else figure.what,
            [
                Series(
                    kind,
                    [label for label, _ in entries],
                    values(kind, figure, "value"),
                    values(kind, figure, "low"),
                    values(kind, figure, "high"),
                    "bars",
                )
                for kind in kinds
            ],
        )
        for figure in FIGURES
    ]
    return Chart(name, title, panels)
