"""Tables, figures and report of the experiment ``mesh_segments``."""

from collections.abc import Mapping
from typing import Any

from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import kept
from jaxmodel.run.provenance import facts
from jaxmodel.run.published import published_table
from jaxmodel.view.mesh_figure import MeshPanel, mesh_png
from jaxmodel.view.mesh_view import MeshView
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Every scene in full, then Table 5.2."""
    return [_measured(summary), _published(summary, command)]


def _measured(summary: Mapping[str, Any]) -> Table:
    share = f"{100 * summary['least_share']:g} % of the area"
    columns = (
        "scene", "views", "points", "triangles before (over one another)", "thinned to", "triangles after",
        "over one another", "parts", "segments, all", f"of at least {share}", "true", "different planes", "true",
        "noise across", "seconds",
    )  # fmt: skip
    rows = []
    for of in summary["scenes"]:
        rows.append(
            (
                of["scene"],
                str(of["views"]),
                str(of["points"]),
                f"{of['before']} ({of['lying_over_before']})" if of["before"] else "none",
                f"{of['thinned']:.3g}" if of["thinned"] else "not",
                str(of["after"]),
                str(of["lying_over"]),
                str(of["components"]),
                str(of["all_segments"]),
                str(of["segments"]),
                str(of["expected_segments"]),
                str(of["planes"]),
                str(of["expected_planes"]),
                f"{of['noise']:.2g}",
                f"{of['seconds']:.2f}",
            )
        )
    return Table("Ball pivoting and segmentation of simulated scenes", columns, rows)


def _published(summary: Mapping[str, Any], command: str) -> Table:
    """Published and ours in one cell each; ours of another cloud wherever the thesis scanned something real."""
    published = published_table("mesh_segments")["scenes"]
    rows = []
    for of in summary["scenes"]:
        if of["scene"] not in published:
            continue
        row = published[of["scene"]]
        counted = of["planes"] if of["expected_planes"] else of["segments"]
        values = {
            "points": of["points"], "before": of["before"], "after": of["after"], "segments": counted,
            "seconds": f"{of['seconds']:.2f}",
        }  # fmt: skip
        rows.append((f"Fig. {row['figure']}, {of['scene']}", *(f"{row[key]} | {values[key]}" for key in values)))
    columns = ("scene", "points", "triangles before", "triangles after", "segments", "seconds")
    return Table(f"Thesis Table 5.2: published | ours | {command}", columns, rows)


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone: each scene's views beside its mesh coloured by segment."""
    manifest = folder.read_json("manifest.json")
    written, sections = [], []
    for of in summary["scenes"]:
        drawn = kept(folder, of["scene"])
        views, mesh = drawn["views"], drawn["mesh"]
        title = f"{of['scene']}: {of['segments']} segments, {of['planes']} planes"
        panels = [
            MeshPanel(f"{of['views']} views, {of['points']} points, {of['before']} triangles", *views),
            MeshPanel(f"{title}, {of['after']} triangles", *mesh),
        ]
        name = f"figures/{of['scene']}.png"
        folder.write(name, mesh_png(panels))
        written.append(name)
        sections.append(MeshView(title, *mesh))
        if len(views.faces):
            sections.append(MeshView(f"{of['scene']}: the views as given", *views))
    title = "Meshes of several views and their segments (thesis Table 5.2)"
    shown = tables(summary, manifest["command"])
    folder.write("report.html", render_report(title, facts(manifest), shown, sections).encode())
    return written
