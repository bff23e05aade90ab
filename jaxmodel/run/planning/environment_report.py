"""Tables, figures and report of the experiment ``next_view_environment``."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import kept
from jaxmodel.run.provenance import facts
from jaxmodel.run.study_report import read_table
from jaxmodel.view.chart_drawing import chart_png
from jaxmodel.view.charts import Chart, Panel, Picture, Series
from jaxmodel.view.field_map import FieldMap, field_png
from jaxmodel.view.mesh_figure import MeshPanel, mesh_png
from jaxmodel.view.mesh_view import MeshView
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table

MOST_OF_IT = 0.95
"""What counts as "most of the environment", which the thesis does not number."""
PUBLISHED = {"cube": "14 views for most of it", "two_rooms": "explored completely, in a very long time; no numbers"}


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """The runs, then *published | ours*."""
    columns = ("planner", "views by pass", "seen after 5, 10, 14, 20, all", "way", "changes of room", "times gone back",
               "unknown left", "how it ended", "seconds a view")  # fmt: skip
    rows = []
    for run in summary["runs"]:
        curve = run["coverage"]
        marks = [curve[k - 1] for k in (5, 10, 14, 20) if k < len(curve)] + [curve[-1]]
        rows.append(
            (
                run["planner"].replace("_", " "),
                ", ".join(map(str, run["views_by_pass"])),
                ", ".join(f"{100 * mark:.1f}" for mark in marks) + " %",
                f"{run['way']:.1f}",
                str(run["changes"]),
                str(run["back"]),
                f"{100 * run['unknown']:.2f} %",
                run["ending"].replace("_", " "),
                f"{run['seconds_a_view']:.2f}",
            )
        )
    found = Table(f"Exploration: share of the reachable surface seen, {summary['environment']}", columns, rows)
    ours = []
    for run in summary["runs"]:
        enough = next((k for k, seen in enumerate(run["coverage"], start=1) if seen >= MOST_OF_IT), None)
        views = "not reached" if enough is None else f"{enough} views"
        what = f"{views} for {100 * MOST_OF_IT:g} %; {100 * run['coverage'][-1]:.1f} % after {run['views']}"
        ours.append((run["planner"].replace("_", " "), PUBLISHED[summary["environment"]], what))
    return [found, Table(f"Published | ours | {command}", ("planner", "published", "ours"), ours)]


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Coverage, labels and utility view by view."""
    cover, worth = [], []
    for run in summary["runs"]:
        number = list(range(1, run["views"] + 1))
        cover.append(Series(run["planner"], number, run["coverage"]))
        known = [float("nan") if of is None else of for of in run["utility"]]
        worth.append(Series(run["planner"], number, known))
    first = rows.filter(polars.col("planner") == summary["runs"][0]["planner"])
    number = list(range(1, len(first) + 1))
    labels = ("unknown", "occluded", "occlusion_plane", "occupied", "border")
    shares = [Series(name.replace("_", " "), number, first[name].to_list()) for name in labels]
    return [
        Chart("coverage", "Coverage of the reachable surface", [Panel("all runs", "views", "share seen", cover)]),
        Chart("labels", "Labels of the map", [Panel("the first planner", "views", "share of voxels", shares)]),
        Chart("utility", "Utility of the view taken (Fig. 4.7)", [Panel("all runs", "views", "utility", worth)]),
    ]


def _field_maps(fields: polars.DataFrame, rows: polars.DataFrame) -> list[FieldMap]:
    """The fields of the first planner, with the view it took next."""
    first = rows.filter(polars.col("planner") == rows["planner"][0])
    maps = []
    for (number,), of in fields.group_by(["view"], maintain_order=True):
        following = first.filter(polars.col("view") == int(str(number)) + 1).select("T_02", "T_12", "T_22")
        marks = {}
        for x, y, z in following.iter_rows():
            marks["the next view"] = (float(np.rad2deg(np.arctan2(y, x))), float(np.rad2deg(np.arcsin(z))))
        angles = of["azimuth_deg"].to_numpy(), of["elevation_deg"].to_numpy()
        maps.append(FieldMap(f"after {int(str(number)) + 1} views", *angles, of["utility"].to_numpy(), marks))
    return maps


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    manifest = folder.read_json("manifest.json")
    rows = read_table(folder.path / "results.parquet")
    written, sections = [], []
    for number, run in enumerate(summary["runs"]):
        drawn = kept(folder, f"planner{number:03d}")
        title = f"{run['planner'].replace('_', ' ')}: {run['views']} views, {100 * run['coverage'][-1]:.1f} % seen"
        panels = [
            MeshPanel(title, *drawn["views"], elevation_deg=55.0),
            MeshPanel("readings of the first six views", *drawn["data"], elevation_deg=55.0),
            MeshPanel("occupied, border and occlusion planes, cut open", *drawn["map"], elevation_deg=55.0),
        ]
        file = f"figures/exploration-{number:03d}.png"
        folder.write(file, mesh_png(panels))
        written.append(file)
        sections += [MeshView(title, *drawn["views"]), MeshView("the map at the end, cut open", *drawn["map"])]
    fields = read_table(folder.path / "field.parquet")
    if len(fields):
        png = field_png("Utility by pan and tilt; grey: too little overlap", _field_maps(fields, rows))
        folder.write("figures/field.png", png)
        written.append("figures/field.png")
        sections.append(Picture("Utility by pan and tilt, view by view (Fig. 4.7)", png))
    drawn_charts = charts(summary, rows)
    for chart in drawn_charts:
        file = f"figures/{chart.name}.png"
        folder.write(file, chart_png(chart))
        written.append(file)
    shown = tables(summary, manifest["command"])
    page = render_report("Exploration (thesis §4.3, §4.4)", facts(manifest), shown, [*drawn_charts, *sections])
    folder.write("report.html", page.encode())
    return written
