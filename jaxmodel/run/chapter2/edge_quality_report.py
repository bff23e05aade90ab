"""Tables, figure and report of the experiment ``edges``."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxmodel.io.results import RunDir
from jaxmodel.run.provenance import facts
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

SCORES = {
    "precision": "precision: marks within 2 pixels of a true edge",
    "recall": "recall: true edges within 2 pixels of a mark",
    "crease_recall": "recall of creases inside the surface",
    "labels": "marks with the right label",
}


class Asked(NamedTuple):
    """The least that the detection must reach in every view at noises from ``above`` (not counted) ``upto``."""

    above: float
    upto: float
    least: Mapping[str, float]


ASKED = (
    Asked(-1.0, 0.002, {"precision": 0.95, "recall": 0.90, "crease_recall": 0.90}),
    Asked(0.005, 0.01, {"precision": 0.80, "recall": 0.50, "crease_recall": 0.50}),
)


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Every solid at every noise; then what is asked beside the least of all views."""
    rows = [(of["solid"], _percent(of["noise"]), *(_cell(of[name]) for name in SCORES)) for of in summary["scores"]]
    smooth = []
    for solid in dict.fromkeys(of["solid"] for of in summary["smooth"]):
        mine = [of for of in summary["smooth"] if of["solid"] == solid]
        smooth.append((solid, _range(mine), f"{max(of['most_creases'] for of in mine)}"))
    height, width = summary["pixels"]
    of_views = f"{summary['views']} views, with and without a wall, {height} x {width} pixels: mean (least)"
    found = [Table(f"Edges of known solids, {of_views}", ("solid", "noise / size", *SCORES.values()), rows)]
    if smooth:
        columns = ("solid", "noise / size", "crease pixels, the most of any view")
        found.append(Table("Creases on smooth surfaces, all of them false", columns, smooth))
    return [*found, Table(f"Asked | ours, least of all views | {command}", ("what", "asked", "ours"), _asked(summary))]


def _asked(summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    lines = []
    for asked in ASKED:
        here = [of for of in summary["scores"] if asked.above < of["noise"] <= asked.upto]
        for name, least in asked.least.items():
            values = [of[name]["least"] for of in here if of[name]["least"] is not None]
            if values:
                word = f"{SCORES[name].split(':')[0]}, noise {_range(here)}"
                lines.append((word, f">= {100 * least:g} %", f"{100 * min(values):.1f} %"))
    if summary["smooth"]:
        most = max(of["most_creases"] for of in summary["smooth"])
        lines.append((f"creases on smooth surfaces, noise {_range(summary['smooth'])}", "0", str(most)))
    return lines


def _range(rows: list[Mapping[str, Any]]) -> str:
    low, high = min(of["noise"] for of in rows), max(of["noise"] for of in rows)
    return _percent(high) if low == high else f"{_percent(low)} to {_percent(high)}"


def charts(summary: Mapping[str, Any]) -> list[Chart]:
    """Each score against the noise, a curve for each solid; bars reach down to the worst view."""
    panels = []
    for name, what in SCORES.items():
        series = []
        for solid in dict.fromkeys(of["solid"] for of in summary["scores"]):
            mine = [of for of in summary["scores"] if of["solid"] == solid]
            mean = [_or_nan(of[name]["mean"]) for of in mine]
            least = [_or_nan(of[name]["least"]) for of in mine]
            series.append(Series(solid, [100 * of["noise"] for of in mine], mean, least, mean))
        panels.append(Panel(what.split(":")[0], "noise (% of the size)", "share", series))
    return [Chart("edges", "Edges against noise: mean of the views, down to the worst one", panels)]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figure and report from the folder alone."""
    from jaxmodel.view.chart_drawing import chart_png
    from jaxmodel.view.report import render_report

    manifest = folder.read_json("manifest.json")
    drawn = charts(summary)
    written = []
    for chart in drawn:
        name = f"figures/{chart.name}.png"
        folder.write(name, chart_png(chart))
        written.append(name)
    about = {**facts(manifest), "time of one image, median": f"{summary['median_seconds']:.2f} s"}
    shown = tables(summary, manifest["command"])
    folder.write("report.html", render_report("Edges of range images (thesis §2.4.1)", about, shown, drawn).encode())
    return written


def _percent(share: float) -> str:
    return f"{100 * share:g} %"


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _cell(score: Mapping[str, Any]) -> str:
    mean, least = _or_nan(score["mean"]), _or_nan(score["least"])
    return f"{mean:.3f} ({least:.3f})" if np.isfinite(mean) else "none seen"
