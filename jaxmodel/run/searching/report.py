"""Tables, figures and report of the experiment ``search``."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxmodel.io.results import RunDir
from jaxmodel.run.meshing.drawing_data import kept
from jaxmodel.run.provenance import facts
from jaxmodel.view.chart_drawing import chart_png
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.mesh_figure import MeshPanel, mesh_png
from jaxmodel.view.mesh_view import MeshView
from jaxmodel.view.report import render_report
from jaxmodel.view.table import Table

TRIANGLES = 100_000
"""Of all pairs in the report together."""


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Every pair; where the truth is known, the counts by subject."""
    shown = [_pairs(summary, command)]
    return [*shown, _subjects(summary, command)] if "all" in summary else shown


def _pairs(summary: Mapping[str, Any], command: str) -> Table:
    known = "all" in summary
    columns = [
        "pair",
        "how it ended",
        "probability",
        "shared, target and source",
        "contradicted",
        "poses as good",
        "free",
    ]
    columns += ["error", "right", "shared under the truth"] if known else []
    rows = []
    for pair in summary["pairs"]:
        row = [
            pair["pair"],
            pair["outcome"].replace("_", " "),
            f"{pair['probability']:.3f}",
            f"{100 * pair['overlap_target']:.1f}, {100 * pair['overlap_source']:.1f} %",
            f"{100 * pair['contradicted']:.1f} %",
            str(len(pair["equivalents"])),
            "" if pair["free"]["kind"] == "held" else pair["free"]["kind"],
        ]
        if known:
            row += [
                f"{pair['turn_deg']:.2f} deg, {pair['shift']:.3g}",
                "yes" if pair["right"] else "up to symmetry" if pair["alike"] else "no",
                f"{100 * pair['true_target']:.1f}, {100 * pair['true_source']:.1f} %",
            ]
        rows.append(row)
    return Table("Pairs" if known else f"Pairs | {command}", columns, rows)


def _subjects(summary: Mapping[str, Any], command: str) -> Table:
    least = 100 * summary["least_overlap"]
    columns = (
        "scans of", "pairs", f"sharing {least:g} % both ways: right (up to symmetry, and believed)", "sharing nothing: "
        "refused", "wrong, but believed", "area under the curve, up to symmetry (plain)", "seconds, median (longest)",
    )  # fmt: skip
    rows = [
        (
            of["name"],
            str(of["pairs"]),
            f"{of['enough_right']} of {of['enough']} ({of['enough_alike']}, {of['enough_accepted']})",
            f"{of['apart_refused']} of {of['apart']}",
            str(of["accepted_wrong"]),
            f"{_figure(of['area_alike'])} ({_figure(of['area_right'])})",
            f"{of['median_seconds']:.1f} ({of['longest_seconds']:.1f})",
        )
        for of in [*summary["subjects"], summary["all"]]
    ]
    return Table(f"Registered with no first guess | {command}", columns, rows)


def _figure(value: float | None) -> str:
    return "one kind" if value is None or not np.isfinite(value) else f"{value:.3f}"


def charts(summary: Mapping[str, Any]) -> list[Chart]:
    """How well the probability tells right from wrong, and whether it means what it says; none without a truth."""
    if "all" not in summary:
        return []
    curve, bins, pairs = summary["curve"], summary["bins"], summary["pairs"]
    known = [pair for pair in pairs if pair["right"] is not None]
    shared = [
        Series("right", *_scatter(known, True), style="marks"),
        Series("wrong", *_scatter(known, False), style="marks"),
    ]
    return [
        Chart(
            "verdict",
            "The verdict: right or wrong, up to symmetry",
            [
                Panel("pairs accepted as the least probability falls", "of the wrong ones", "of the right ones",
                      [Series("all pairs", curve["wrong"], curve["right"])]),
                Panel("does the probability mean what it says?", "probability, mean of the bin", "share that is right",
                      [Series("as found", [b["probability"] for b in bins], [b["right"] for b in bins], style="marks"),
                       Series("as it should be", [0, 1], [0, 1])]),
                Panel("what the scans share", "smaller share under the truth", "probability", shared),
            ],
        )
    ]  # fmt: skip


def _scatter(pairs: list[dict[str, Any]], right: bool) -> tuple[list[float], list[float]]:
    chosen = [pair for pair in pairs if pair["alike"] == right]
    return [min(p["true_target"], p["true_source"]) for p in chosen], [p["probability"] for p in chosen]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    manifest = folder.read_json("manifest.json")
    written, sections = [], []
    for number in range(summary["drawn"]):
        pair, both = summary["pairs"][number], kept(folder, f"pair{number:03d}")["both"]
        title = f"{pair['pair']}: probability {pair['probability']:.2f}, {pair['outcome'].replace('_', ' ')}"
        views = [MeshPanel(title, *both), MeshPanel("from the other side", *both, azimuth_deg=120.0)]
        name = f"figures/pair-{number:03d}.png"
        folder.write(name, mesh_png(views))
        written.append(name)
        if len(both.faces):
            sections.append(MeshView(title, *both, most=TRIANGLES // summary["drawn"]))
    drawn = charts(summary)
    for chart in drawn:
        name = f"figures/{chart.name}.png"
        folder.write(name, chart_png(chart))
        written.append(name)
    page = render_report(
        "Registration with no first guess", facts(manifest), tables(summary, manifest["command"]), [*drawn, *sections]
    )
    folder.write("report.html", page.encode())
    return written
