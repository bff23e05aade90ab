"""Tables, figures and report of the experiment ``next_view_arm``."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import kept
from jaxmodel.run.planning.summary import FEW
from jaxmodel.run.provenance import facts
from jaxmodel.run.study_report import read_table
from jaxmodel.view.chart_drawing import chart_png
from jaxmodel.view.charts import Chart, Panel, Picture, Series
from jaxmodel.view.field_map import FieldMap, field_png
from jaxmodel.view.mesh_figure import MeshPanel, mesh_png
from jaxmodel.view.mesh_view import MeshView
from jaxmodel.view.plane_map import plane_png
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table

BASES = {"free": "no arm", "fixed": "arm, base fixed", "moving": "arm, base moving"}
PUBLISHED = {"free": "", "fixed": "pictures only (Fig. 4.13)", "moving": "named, not built (Fig. 4.12)"}


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """The check of every view, the circles, then *published | ours*."""
    checked = [
        (
            BASES[run["bases"]],
            str(run["checked"]),
            str(run["within_limits"]),
            _small(run["position_error"]),
            _small(run["rotation_error"]),
        )
        for run in summary["runs"]
        if run["bases"] != "free"
    ]
    columns = ("run", "views checked", "within the joint limits", "largest error, m", "rad")
    shown = [Table("Every view by forward kinematics that shares nothing with the solvers", columns, checked)]
    circles = [
        (f"{of['elevation_deg']:g}", f"{100 * of['reached']:.1f} %", str(of["stretches"]), f"{of['longest_deg']:.0f}",
         of["breaks"] or "none")
        for of in summary["circles"]
    ]  # fmt: skip
    columns = ("elevation, degrees", "reached", "stretches", "longest, degrees", "breaks")
    shown.append(Table("Circles of the sphere, all views upright", columns, circles))
    ours = []
    for run in summary["runs"]:
        curve = run["coverage"]
        marks = [curve[min(k, len(curve)) - 1] for k in (1, 3, 5, FEW)] if curve else []
        seen = ", ".join(f"{100 * mark:.1f}" for mark in [*marks, curve[-1]]) + " %" if curve else "nothing"
        places = len(run["stations"])
        ours.append(
            (BASES[run["bases"]], PUBLISHED[run["bases"]], seen, str(run["views"]), str(places) if places else "none",
             run["ending"])
        )  # fmt: skip
    if (best := summary["best_place"]) is not None:
        where = f"{best['ahead']:.2f} m ahead, {best['above']:.2f} m above: {100 * best['share']:.0f} % of the sphere"
        ours.append(("best place of the object", "above the robot: almost all angles", where, "", "", ""))
    columns = ("run", "published", f"seen after 1, 3, 5, {FEW}, all views", "views", "places of the base", "end")
    title = f"{summary['object']} with {summary['arm']}: share of the reachable surface seen | {command}"
    return [*shown, Table(title, columns, ours)]


def charts(summary: Mapping[str, Any], radius: polars.DataFrame, circles: polars.DataFrame) -> list[Chart]:
    """Coverage, reach by the sphere's radius, and the joints along the circle that is reached farthest."""
    cover = [
        Series(BASES[run["bases"]], list(range(1, run["views"] + 1)), run["coverage"])
        for run in summary["runs"]
        if run["views"]
    ]
    x = radius["radius"].to_list()
    spheres = [Series(f"{name} sphere", x, radius[name].to_list()) for name in ("whole", "upper")]
    drawn = [
        Chart("coverage", "Coverage of the reachable surface", [Panel("runs", "views", "share seen", cover)]),
        Chart("radius", "Views in reach by the sphere's radius (Fig. 4.13a)",
              [Panel("from the first place of the base", "radius, m", "share of the views", spheres)]),
    ]  # fmt: skip
    if summary["circles"]:
        best = max(summary["circles"], key=lambda of: of["longest_deg"])["elevation_deg"]
        rows = circles.filter(polars.col("elevation_deg") == best)
        names = [name for name in rows.columns if name[0] == "q"]
        lines = [
            Series(f"joint {name[1:]}", rows["azimuth_deg"].to_list(), np.rad2deg(rows[name].to_numpy()).tolist())
            for name in names
        ]
        panel = Panel(f"elevation {best:g} degrees", "along the circle, degrees", "joint, degrees or m", lines)
        drawn.append(Chart("joints", "Joints along a circle of the sphere", [panel]))
    return drawn


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    manifest = folder.read_json("manifest.json")
    written, sections = [], []

    def picture(name: str, title: str, png: bytes) -> None:
        folder.write(f"figures/{name}.png", png)
        written.append(f"figures/{name}.png")
        sections.append(Picture(title, png))

    for number, run in enumerate(summary["runs"]):
        if not run["views"]:
            continue
        drawn = kept(folder, f"bases{number:03d}")
        title = f"{BASES[run['bases']]}: {run['views']} views, {100 * run['coverage'][-1]:.1f} % seen"
        panels = [
            MeshPanel(title, *drawn["arms"]),
            MeshPanel("from above (Fig. 4.12)", *drawn["arms"], elevation_deg=89.0),
            MeshPanel("occupied, border and occlusion planes of the map", *drawn["map"]),
        ]
        file = f"figures/arm-{number:03d}.png"
        folder.write(file, mesh_png(panels))
        written.append(file)
        sections.append(MeshView(title, *drawn["arms"]))
    tables_of = {name: read_table(folder.path / f"{name}.parquet") for name in ("reach", "reach_by_radius", "circles")}
    for chart in charts(summary, tables_of["reach_by_radius"], tables_of["circles"]):
        folder.write(f"figures/{chart.name}.png", chart_png(chart))
        written.append(f"figures/{chart.name}.png")
        sections.append(chart)
    reach = tables_of["reach"]
    places = FieldMap(
        "dexterity, from the first place of the base; grey: not reached",
        reach["azimuth_deg"].to_numpy(),
        reach["elevation_deg"].to_numpy(),
        reach["dexterity"].to_numpy(),
        {},
    )
    title = "Views of the sphere that the arm takes (Fig. 4.13)"
    picture("reach", title, field_png(title, [places]))
    if (folder.path / "reach_by_place.parquet").exists():
        rows = read_table(folder.path / "reach_by_place.parquet")
        title = "Part of the whole sphere in reach, by where the object is (Fig. 4.13b)"
        ahead, above, share = (rows[name].to_numpy() for name in ("ahead", "above", "share"))
        png = plane_png(title, "ahead of the base, m", "above its foot, m", ahead, above, share)
        picture("place", title, png)
    page = render_report(
        "An arm around an object (thesis §4.5)", facts(manifest), tables(summary, manifest["command"]), sections
    )
    folder.write("report.html", page.encode())
    return written


def _small(value: float | None) -> str:
    return "none" if value is None else f"{value:.1e}"
