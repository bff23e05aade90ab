"""What the hand-eye experiments' tables, charts and reports share."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.run.provenance import facts
from jaxmodel.run.study_report import read_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

Tables = Callable[[Mapping[str, Any], str], list[Table]]
Charts = Callable[[Mapping[str, Any], polars.DataFrame], list[Chart]]


def draw_hand_eye(folder: RunDir, summary: Mapping[str, Any], title: str, tables: Tables, charts: Charts) -> list[str]:
    """Draw every chart and the report from a finished run's folder; the figures' names, relative to it."""
    rows = read_table(folder.path / "results.parquet")
    manifest = folder.read_json("manifest.json")
    from jaxmodel.view.chart_drawing import chart_png
    from jaxmodel.view.report import render_report

    drawn, written = charts(summary, rows), []
    for chart in drawn:
        name = f"figures/{chart.name}.png"
        folder.write(name, chart_png(chart))
        written.append(name)
    about = {**facts(manifest), "draws": str(summary["draws"]), "chosen here": summary["chosen"]}
    page = render_report(title, about, tables(summary, manifest["command"]), drawn)
    folder.write("report.html", page.encode())
    return written


def check_draws(config: Any) -> None:
    """Refuse numbers of draws that make no sense, naming the first of them."""
    for name, least in (("seed", 0), ("draws", 2), ("report_draws", 2), ("chunk", 1), ("resamples", 100)):
        if getattr(config, name) < least:
            raise ValueError(f"{name} is {getattr(config, name)}, expected {least} or more")
    if config.report_draws > config.draws:
        raise ValueError(f"report_draws is {config.report_draws}, expected at most draws, {config.draws}")


TIME = "processor time (microseconds a calibration)"
ERRORS = ("rotation RMS (2 - 2 cos a/2)", "RMS angle", "median angle", "translation RMS", "median")


def error_cells(of: Mapping[str, Any]) -> tuple[str, ...]:
    """A described method as cells under ``ERRORS``."""
    return (
        f"{of['rotation_rms']:.2e}",
        f"{of['rotation_rms_deg']:.3g}°",
        f"{of['rotation_median_deg']:.3g}°",
        f"{of['translation_rms']:.3g}",
        f"{of['translation_median']:.3g}",
    )


def chosen_table(summary: Mapping[str, Any]) -> Table:
    """What the report leaves open and was chosen here."""
    return Table("Chosen here, not stated in the report", ("what",), [(summary["chosen"],)])


def times_table(summary: Mapping[str, Any], figure: str, keys: tuple[str, ...]) -> Table:
    """Mean seconds of each method over the cells that share ``keys``."""
    groups: dict[tuple[Any, ...], list[Mapping[str, float]]] = {}
    for of in summary["times"]:
        if of["seconds"]:
            groups.setdefault(tuple(of[key] for key in keys), []).append(of["seconds"])
    methods = list(dict.fromkeys(method for of in groups.values() for one in of for method in one))
    rows = [
        (" ".join(str(part) for part in group), *(f"{1e6 * np.mean([one[m] for one in of]):.1f}" for m in methods))
        for group, of in groups.items()
    ]
    title = f"Microseconds of the processor a calibration, in batches ({figure} is a curve without numbers)"
    return Table(title, (", ".join(keys), *methods), rows)


def error_panels(curves: list[Any], key: str, label: str, methods: tuple[str, ...], title: str) -> list[Panel]:
    """RMS and median of both errors along a key, one curve a method."""
    wanted = (
        ("rotation_rms", "rotation", "RMS of 2 - 2 cos(angle / 2)"),
        ("translation_rms", "translation", "RMS of |t - t*| / |t*|"),
        ("rotation_median_deg", "rotation", "median angle (°)"),
        ("translation_median", "translation", "median of |t - t*| / |t*|"),
    )
    return [
        Panel(
            f"{title}: {what}",
            label,
            axis,
            [
                Series(method, [of[key] for of in curves if of["method"] == method], _positive(curves, method, name))
                for method in methods
            ],
            log_y=True,
        )
        for name, what, axis in wanted
    ]


def marks_panel(
    title: str, label: str, names: Sequence[str], values: list[Any], published: Sequence[float | None] | None = None
) -> Panel:
    """A median with the range of 90 % for each method, and the report's own values where it has some."""
    ours = Series("ours", names, *([of[key] for of in values]
                  for key in ("value", "low", "high")), style="marks")  # fmt: skip
    series = [ours]
    if published is not None:
        values = [np.nan if of is None else of for of in published]
        series.append(Series("published", names, values, style="marks"))
    return Panel(title, "ours: median and 90 % of the robots", label, series, log_y=True)


def _positive(curves: list[Any], method: str, name: str) -> list[float]:
    values = [of[name] for of in curves if of["method"] == method]
    return [value if value is not None and value > 1e-9 else np.nan for value in values]
