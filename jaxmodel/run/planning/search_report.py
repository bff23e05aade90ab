"""Tables, figures and report of the experiment ``next_view_search``."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.plan.utility import Utility, preference
from jaxmodel.run.provenance import facts
from jaxmodel.run.study_report import read_table
from jaxmodel.view.chart_drawing import chart_png
from jaxmodel.view.charts import Chart, Panel, Picture, Series
from jaxmodel.view.field_map import FieldMap, field_png
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table

PUBLISHED = {"spiral_gradient": '"sub-optimal"', "hill_climbing": '"very slow, does not always converge"'}
NAMES = {
    "pattern": "views, then pattern",
    "views": "views alone",
    "gradient": "views, then gradient",
    "spiral_gradient": "spiral, then gradient",
    "hill_climbing": "hill climbing",
}


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """*Published | ours*, by method."""
    columns = ("method", "published", "maps", "reach 0.99 of the best", "mean of the best", "worst", "views scored",
               "seconds")  # fmt: skip
    rows = [
        (
            NAMES[of["method"]],
            PUBLISHED.get(of["method"], ""),
            str(of["maps"]),
            f"{100 * of['reached']:.1f} %",
            f"{of['mean']:.4f}",
            f"{of['worst']:.4f}",
            f"{of['scored']:.0f}",
            f"{of['seconds']:.2f}",
        )
        for of in summary["methods"]
    ]
    return [Table(f"View found against the best of {summary['field_views']} views | {command}", columns, rows)]


def charts(rows: polars.DataFrame) -> list[Chart]:
    """The thesis's curves, and how near each map's view comes to the best."""
    share = np.linspace(0, 1, 201)
    nominal = Utility()
    curves = [
        Panel(title, "share of the rays", "f", [Series(f"nominal share {alpha:g}", share.tolist(), _curve(alpha))])
        for title, alpha in (
            ("occupied", nominal.occupied),
            ("unknown, occlusion plane", nominal.unknown),
            ("border", nominal.border),
        )
    ]
    ratios = [
        Series(NAMES[method], list(range(1, len(of) + 1)), of["ratio"].to_list(), style="marks")
        for (method,), of in rows.group_by(["method"], maintain_order=True)
    ]
    return [
        Chart(
            "ratios", "Utility of the view found", [Panel("every map", "map", "of the best", ratios, from_zero=False)]
        ),
        Chart("preference", "Worth of a share by label (Figs 4.2, 4.4)", curves),
    ]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    manifest = folder.read_json("manifest.json")
    rows, field = (read_table(folder.path / f"{name}.parquet") for name in ("results", "field"))
    written, sections = [], []
    for chart in charts(rows):
        file = f"figures/{chart.name}.png"
        folder.write(file, chart_png(chart))
        written.append(file)
        sections.append(chart)
    name = summary["objects"][0]
    maps = [_field_map(of, rows) for _, of in field.group_by(["map"], maintain_order=True)]
    if maps:
        picture = field_png(f"{name}: utility of every view, view by view (Fig. 4.7)", maps)
        folder.write("figures/field.png", picture)
        written.append("figures/field.png")
        sections.append(Picture(f"The field of utility of {name}; grey: too little overlap", picture))
    shown = tables(summary, manifest["command"])
    page = render_report("Search for the best view (thesis §4.3)", facts(manifest), shown, sections)
    folder.write("report.html", page.encode())
    return written


def _field_map(field: polars.DataFrame, rows: polars.DataFrame) -> FieldMap:
    name, number = field["object"][0], field["map"][0]
    first = (polars.col("object") == name) & (polars.col("start") == 0) & (polars.col("map") == number)
    found = rows.filter(first)
    places = found.select("method", "azimuth_deg", "elevation_deg").iter_rows()
    marks = {NAMES[method]: (azimuth, elevation) for method, azimuth, elevation in places}
    value = np.where(field["overlaps"].to_numpy(), field["value"].to_numpy(), np.nan)
    azimuth, elevation = field["azimuth_deg"].to_numpy(), field["elevation_deg"].to_numpy()
    return FieldMap(f"after {number} views", azimuth, elevation, value, marks)


def _curve(alpha: Any) -> list[float]:
    return np.asarray(preference(np.linspace(0, 1, 201), float(alpha))).tolist()
