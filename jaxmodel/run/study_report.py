"""From a finished study's folder to ``figures/*.png`` and ``report.html``."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import polars

from jaxmodel.errors import InputError
from jaxmodel.io.results import RunDir
from jaxmodel.run.faults import fault_tables
from jaxmodel.run.provenance import facts
from jaxmodel.view.charts import Chart
from jaxmodel.view.table import Table

Tables = Callable[[Mapping[str, Any], str], list[Table]]
Charts = Callable[[Mapping[str, Any], polars.DataFrame, polars.DataFrame], list[Chart]]
"""Summary, rows of all registrations, rows of all iterations -> charts, in order."""


def draw_study(folder: RunDir, summary: Mapping[str, Any], title: str, tables: Tables, charts: Charts) -> list[str]:
    """Draw every chart and the report; the list of figures, relative to the folder."""
    rows, iterations = (read_table(folder.path / f"{name}.parquet") for name in ("results", "iterations"))
    manifest = folder.read_json("manifest.json")
    from jaxmodel.view.chart_drawing import chart_png
    from jaxmodel.view.report import render_report

    drawn = charts(summary, rows, iterations)
    written = []
    for chart in drawn:
        name = f"figures/{chart.name}.png"
        folder.write(name, chart_png(chart))
        written.append(name)
    about = {
        **facts(manifest),
        "method": summary["method"],
        "registrations": str(summary["registrations"]),
        "right means": right_means(manifest["config"]["right"]),
    }
    shown = [*tables(summary, manifest["command"]), *fault_tables(summary)]
    folder.write("report.html", render_report(title, about, shown, drawn).encode())
    return written


def read_table(path: Path) -> polars.DataFrame:
    """A finished table; missing or broken is an ``InputError``."""
    try:
        return polars.read_parquet(path)
    except (OSError, polars.exceptions.PolarsError) as error:
        raise InputError(f"{path}: not readable as a table ({error})") from None


def right_means(right: Mapping[str, Any]) -> str:
    """When a registration counts as right, in words."""
    within = f"{100 * right['tolerance_of_size']:g} % of the diagonal of the source's box"
    if right["tolerance"] is not None:
        within = f"{right['tolerance']:g} (unit of the data)"
    return f"rotation within {right['tolerance_deg']:g} degrees, source's centroid within {within}"
