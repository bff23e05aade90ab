"""Tables, figures and report of the experiment ``next_view_objects``."""

from collections.abc import Mapping
from typing import Any

from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import kept
from jaxmodel.run.planning.summary import FEW, MANY, held
from jaxmodel.run.provenance import facts
from jaxmodel.view.chart_drawing import chart_png
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.mesh_figure import MeshPanel, mesh_png
from jaxmodel.view.mesh_view import MOST_TRIANGLES, MeshView
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table

TRIANGLES = 100_000
"""Of all objects in the report together."""
TURNABLE_MAPS = 3
"""Objects at most for which the map at the end can be turned in the report too; it is in the figures anyway."""


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Every run, the registrations where there were any, then the planners beside each other."""
    if len(summary["runs"]) == 1:
        return [_alone(summary, command)]
    shown = [_runs(summary)]
    if any(run["registered"] for run in summary["runs"]):
        shown.append(_registrations(summary))
    return [*shown, _planners(summary, command)]


def _alone(summary: Mapping[str, Any], command: str) -> Table:
    run = summary["runs"][0]
    rows = [
        (str(number), f"{100 * seen:.2f} %", "yes" if placed else "no, left out")
        for number, (seen, placed) in enumerate(zip(run["coverage"], summary["placed"], strict=True), start=1)
    ]
    title = f"{run['object']}: share of the reachable surface seen; {summary['ending']} | {command}"
    return Table(title, ("view", "seen", "placed"), rows)


def planner_name(of: Mapping[str, Any]) -> str:
    """A planner in words, with what its runs were made under."""
    name = of["planner"].replace("_free", " without overlap").replace("_", " ")
    noise = f", noise {100 * of['noise']:g} %" if of["noise"] else ""
    return name + noise + (", registered" if of["registered"] else "")


def _runs(summary: Mapping[str, Any]) -> Table:
    columns = ("object", "planner", "first view", f"coverage after 1, 2, 3, 5, {FEW}, {MANY} views", "views",
               "last views of little gain", "how it ended")  # fmt: skip
    rows = []
    for run in summary["runs"]:
        curve = run["coverage"]
        marks = [curve[k - 1] for k in (1, 2, 3, 5, FEW, MANY) if k <= len(curve)]
        rows.append(
            (
                run["object"],
                planner_name(run),
                str(run["start"]),
                ", ".join(f"{100 * mark:.1f}" for mark in marks) + " %",
                str(run["views"]),
                str(run["useless"]),
                run["ending"].replace("_", " "),
            )
        )
    return Table("Share of the reachable surface seen", columns, rows)


def _registrations(summary: Mapping[str, Any]) -> Table:
    columns = ("object", "planner", "views placed", "of these right", "largest error, in degrees and the size")
    rows = [
        (
            run["object"],
            planner_name(run),
            f"{run['placed']} of {run['views']}",
            str(run["right"]),
            "" if run["error_deg"] is None else f"{run['error_deg']:.2f}, {100 * run['error_shift']:.2f} %",
        )
        for run in summary["runs"]
        if run["registered"]
    ]
    return Table("Views registered to the model of those before them", columns, rows)


def _planners(summary: Mapping[str, Any], command: str) -> Table:
    columns = ("planner", "runs", f"after {FEW} views: mean (worst)", f"after {MANY}",
               f"area under the curve, {FEW} views",
               f"{MANY} views", "views taken", "seconds a view")  # fmt: skip
    rows = []
    for of in summary["planners"]:
        curve = held(of["coverage"], MANY)
        rows.append(
            (
                planner_name(of),
                str(of["runs"]),
                f"{100 * curve[FEW - 1]:.2f} % ({100 * of['worst_few']:.1f} %)",
                f"{100 * curve[MANY - 1]:.2f} %" if summary["views"] >= MANY else "",
                f"{of['area_few']:.4f}",
                f"{of['area_many']:.4f}" if summary["views"] >= MANY else "",
                f"{of['views']:.1f}",
                f"{of['seconds_a_view']:.2f}",
            )
        )
    return Table(f"Planners, means over the runs | {command}", columns, rows)


def charts(summary: Mapping[str, Any]) -> list[Chart]:
    """Mean coverage by planner, and each object's first run by planner."""
    number = list(range(1, summary["views"] + 1))
    mean = [Series(planner_name(of), number, of["coverage"]) for of in summary["planners"]]
    drawn = [Chart("coverage", "Coverage of the reachable surface", [_panel("mean over the runs", mean)])]
    for place, name in enumerate(summary["objects"]):
        of = [run for run in summary["runs"] if run["object"] == name and run["start"] == 0]
        series = [Series(planner_name(run), list(range(1, run["views"] + 1)), run["coverage"]) for run in of]
        drawn.append(Chart(f"coverage-{place:03d}", f"Coverage of {name}", [_panel(name, series)]))
    return drawn


def _panel(title: str, series: list[Series]) -> Panel:
    return Panel(title, "views", "share seen of what can be seen", series, from_zero=False)


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    manifest = folder.read_json("manifest.json")
    written, sections = [], []
    for place, name in enumerate(summary["objects"]):
        drawn = kept(folder, f"object{place:03d}")
        run = next(run for run in summary["runs"] if run["object"] == name)
        title = f"{name}, {planner_name(run)}: {run['views']} views, {100 * run['coverage'][-1]:.1f} % seen"
        panels = [
            MeshPanel(title, *drawn["views"]),
            MeshPanel("by the view that first saw it, from below", *drawn["surface"], elevation_deg=-25.0),
            MeshPanel("occupied, border and occlusion planes of the map", *drawn["map"]),
        ]
        file = f"figures/object-{place:03d}.png"
        folder.write(file, mesh_png(panels))
        written.append(file)
        sections.append(
            MeshView(title, *drawn["views"], most=min(MOST_TRIANGLES, TRIANGLES // len(summary["objects"])))
        )
        if len(summary["objects"]) <= TURNABLE_MAPS:
            sections.append(MeshView(f"{name}: the map at the end", *drawn["map"]))
    drawn_charts = charts(summary)
    for chart in drawn_charts:
        file = f"figures/{chart.name}.png"
        folder.write(file, chart_png(chart))
        written.append(file)
    about = {**facts(manifest), "coverage": "of the surface that at least one pose of the observation sphere sees"}
    for name, of in summary["objects"].items():
        if not of["watertight"]:
            about[f"note, {name}"] = "the mesh is open: it can be seen into, only its outer sides count as seen"
    shown = tables(summary, manifest["command"])
    page = render_report("Next best views of objects (thesis §4.5)", about, shown, [*drawn_charts, *sections])
    folder.write("report.html", page.encode())
    return written
