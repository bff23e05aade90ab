"""Figures and report of the experiment ``mesh_quality``, from its folder alone."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxmodel.io.meshes import load_mesh
from jaxmodel.io.results import RunDir
from jaxmodel.mesh.quality import BINS, smoothness, triangle_shape
from jaxmodel.run.meshing.criteria_tables import SPHERES
from jaxmodel.run.meshing.quality_tables import LABELS, tables
from jaxmodel.run.provenance import facts
from jaxmodel.scan.triangle_mesh import icosphere
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.mesh_view import MeshView

SHOWN = ("ball_thinned", "ball", "deformable_5")
"""Meshes that the report turns, of each object: the first ball there is, and the deformable surface."""


def mesh_name(subject: str, method: str) -> str:
    """Where a mesh lies in the folder of the run."""
    return f"meshes/{subject}-{''.join(c if c.isalnum() else '_' for c in method)}.ply"


def charts(summary: Mapping[str, Any]) -> list[Chart]:
    """The criteria on known shapes, the histograms of each object, and the sweep of the radius."""
    found = [_criteria()]
    for name in summary["stands_for"]:
        rows = [row for row in summary["rows"] if row["object"] == name and row.get("triangles")]
        if rows:
            panels = [_histogram(rows, "Q_equ", 0.0), _histogram(rows, "Q_nor", -1.0)]
            found.append(Chart(f"quality_{name}", f"Quality of the triangles: {name} (Fig. 3.15)", panels))
    if summary["sweep"]:
        wanted = (("Q_equ", "Q_equ"), ("Q_nor", "Q_nor"), ("holes", "holes"), ("used", "share of the points used"))
        panels = [
            Panel(
                what,
                "radius / spacing",
                what,
                [
                    Series(name, [row["radius"] for row in of], [_or_nan(row[key]) for row in of])
                    for name, of in summary["sweep"].items()
                ],
                from_zero=key not in ("Q_equ", "Q_nor"),
            )
            for key, what in wanted
        ]
        found.append(Chart("radius", "One pass of one ball against its radius", panels))
    return found


def _criteria() -> Chart:
    """Fig. 3.13: an equilateral triangle whose corner sinks, one whose corner slides; Fig. 3.14: spheres."""
    lengths = np.linspace(0.0, 2.0, 41)
    height = np.sqrt(0.75)
    sunk = np.stack([np.full(41, 0.5), lengths * height, np.zeros(41)], axis=1)
    slid = np.stack([0.5 + lengths, np.full(41, height), np.zeros(41)], axis=1)
    series = [
        Series("height / equilateral height", lengths.tolist(), _shapes(sunk)),
        Series("apex moved along / side", lengths.tolist(), _shapes(slid)),
    ]
    balls = [icosphere(subdivisions) for subdivisions in SPHERES]
    smooth = [float(smoothness(ball.vertices, ball.faces).mean()) for ball in balls]
    panels = [
        Panel("Q_equ of a triangle (Fig. 3.13)", "deformation", "Q_equ", series),
        Panel(
            "Q_nor of a sphere (Fig. 3.14)",
            "triangles",
            "Q_nor",
            [Series("icosphere", [len(ball.faces) for ball in balls], smooth)],
            log_x=True,
            from_zero=False,
        ),
    ]
    return Chart("criteria", "The criteria on known shapes", panels)


def _shapes(apex: np.ndarray) -> list[float]:
    base = np.array([[0.0, 0, 0], [1, 0, 0]])
    return [float(triangle_shape(np.vstack([base, one]), np.array([[0, 1, 2]]))[0]) for one in apex]


def _histogram(rows: list[Mapping[str, Any]], key: str, low: float) -> Panel:
    """Shares of the triangles in each bin, a curve for each method; for Q_nor on a logarithmic axis."""
    edges = np.linspace(low, 1.0, BINS + 1)
    middles = ((edges[1:] + edges[:-1]) / 2).tolist()
    log = key == "Q_nor"
    series = []
    for row in rows:
        share = np.array(row[f"{key}_counts"], float)
        share = share / max(share.sum(), 1.0)
        height = np.where(log & (share == 0), np.nan, share).tolist()
        series.append(Series(LABELS.get(row["method"]) or str(row["method"]), middles, height))
    return Panel(key, key, "share of the triangles", series, log_y=log)


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    from jaxmodel.view.chart_drawing import chart_png
    from jaxmodel.view.report import render_report

    manifest = folder.read_json("manifest.json")
    drawn = charts(summary)
    written = []
    for chart in drawn:
        name = f"figures/{chart.name}.png"
        folder.write(name, chart_png(chart))
        written.append(name)
    about = {
        **facts(manifest),
        "time": "of the processor, all threads; the least of a method's runs, compilation counts in a single run only",
    }
    shown = tables(summary, manifest["command"])
    title = "Quality of meshes (thesis §3.5, Table 3.2)"
    folder.write("report.html", render_report(title, about, shown, [*drawn, *_views(folder, summary)]).encode())
    return written


def _views(folder: RunDir, summary: Mapping[str, Any]) -> list[MeshView]:
    views = []
    for name in summary["stands_for"]:
        there = {method: folder.path / mesh_name(name, method) for method in SHOWN}
        there = {method: path for method, path in there.items() if path.is_file()}
        if "ball_thinned" in there:
            there.pop("ball", None)
        for method, path in there.items():
            mesh = load_mesh(path)
            views.append(MeshView(f"{name}, {LABELS[method]}", np.asarray(mesh.vertices), np.asarray(mesh.faces)))
    return views


def _or_nan(value: float | int | None) -> float | int:
    return np.nan if value is None else value
