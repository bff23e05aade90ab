"""Tables, figures and report of the experiment ``mesh_segments``."""

from collections.abc import Mapping
from typing import Any

from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import Drawn, kept
from jaxmodel.run.provenance import facts
from jaxmodel.run.published import published_table
from jaxmodel.view.mesh_figure import MeshPanel, mesh_png
from jaxmodel.view.mesh_view import MeshView
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Every scene in full, the mesh grown from a border, what Table 3.1 says, then Table 5.2."""
    shown = [_measured(summary)]
    if summary["growth"]:
        shown.append(_growth(summary))
    if summary["methods"]:
        shown.append(_facts(summary))
    return [*shown, _published(summary, command)]


def _measured(summary: Mapping[str, Any]) -> Table:
    share = f"{100 * summary['least_share']:g} % of the area"
    columns = (
        "scene", "points", "triangles before (over one another)", "thinned to", "triangles after (over one another)",
        "parts", f"segments of {share} or more (all) | true", "planes | true", "noise", "seconds",
    )  # fmt: skip
    rows = []
    for of in summary["scenes"]:
        rows.append(
            (
                of["scene"],
                str(of["points"]),
                f"{of['before']} ({of['lying_over_before']})" if of["before"] else "none",
                f"{of['thinned']:.3g}" if of["thinned"] else "not",
                f"{of['after']} ({of['lying_over']})",
                str(of["components"]),
                f"{of['segments']} ({of['all_segments']}) | {of['expected_segments']}",
                f"{of['planes']} | {of['expected_planes']}",
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


def _upright(drawn: Drawn) -> Drawn:
    """With its y axis up, as the scans of the bunny have it."""
    return drawn._replace(vertices=drawn.vertices[:, [2, 0, 1]])


def _growth(summary: Mapping[str, Any]) -> Table:
    columns = ("view", "points", "on the mesh already", "new vertices", "triangles kept", "triangles then",
               "over one another", "parts")  # fmt: skip
    rows = [
        (
            str(of["view"]),
            str(of["points"]),
            str(of["redundant"]),
            str(of["added"]),
            f"{of['kept_triangles']} of {of['of_triangles']}",
            str(of["triangles"]),
            str(of["lying_over"]),
            str(of["components"]),
        )
        for of in summary["growth"]
    ]
    return Table(f"View 1's mesh grown by the points of the others, {summary['grow']} (Fig. 3.1)", columns, rows)


def _facts(summary: Mapping[str, Any]) -> Table:
    published, rows = published_table("mesh_segments")["methods"], []
    for key, (what, cell) in _FACTS.items():
        rows.append(
            (
                what,
                *(f"{published.get(of['method'], {}).get(key, 'not there')} | {cell(of)}" for of in summary["methods"]),
            )
        )
    columns = ("published | ours", *(of["method"] for of in summary["methods"]))
    points = summary["methods"][0]["points"]
    return Table(f"Thesis Table 3.1, measured on a ball, half of one and a cup, {points} points each", columns, rows)


_FACTS = {
    "openings": (
        "half a ball: openings kept, area invented",
        lambda of: f"{of['opening']} border, {100 * of['invented']:.1f} %",
    ),
    "closed": ("a ball: closed", lambda of: "closed" if of["closed"] else f"{of['border_loops']} holes"),
    "concavities": ("a cup: share of its hollow followed", lambda of: f"{100 * of['hollow']:.1f} %"),
    "vertices": ("vertices that are measured points", lambda of: f"{100 * of['own_vertices']:.1f} %"),
    "detail": (
        "mean distance of the points (spacings); triangles per area where points are 4 times as dense",
        lambda of: f"{of['error']:.3f}; {of['density']:.2f} times",
    ),
    "time": ("seconds on the ball (triangles)", lambda of: f"{of['seconds']:.2f} ({of['triangles']})"),
}


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
    if summary["growth"]:
        drawn = kept(folder, "growth")
        title = f"Fig. 3.1, {summary['grow']}: a colour for the view that brought each triangle"
        names = ("the mesh of view 1", "grown from its border by the points of views 2, 3 and 4")
        looks = [
            MeshPanel(name, *(_upright(drawn[key]) if summary["grow"] == "bunny" else drawn[key]))
            for name, key in zip(names, ("views", "mesh"), strict=True)
        ]
        folder.write("figures/growth.png", mesh_png(looks))
        written.append("figures/growth.png")
        sections.append(MeshView(title, *drawn["mesh"]))
    title = "Meshes of several views and their segments (thesis Table 5.2)"
    shown = tables(summary, manifest["command"])
    folder.write("report.html", render_report(title, facts(manifest), shown, sections).encode())
    return written
