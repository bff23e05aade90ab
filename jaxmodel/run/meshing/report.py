"""``MESH.report.html``: the mesh to turn, coloured by segment, its histograms and tables in one offline page."""

import numpy as np

from jaxmodel.mesh.quality import Histogram
from jaxmodel.run.meshing.colours import face_colours
from jaxmodel.run.meshing.content import Result, outcome
from jaxmodel.run.meshing.tables import tables
from jaxmodel.run.provenance import versions
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.mesh_view import MeshView
from jaxmodel.view.report import render_report


def report_page(result: Result, name: str, line: str) -> str:
    """The page as HTML text."""
    facts = {
        "command": line,
        "outcome": outcome(result),
        "versions": ", ".join(f"{library} {version}" for library, version in versions().items()),
    }
    colours = None if result.segments is None else face_colours(result.segments)
    view = MeshView(name, np.asarray(result.made.mesh.vertices), np.asarray(result.made.mesh.faces), colours)
    return render_report(
        name, facts, tables(result), [view, _histograms(result)], note="; ".join(result.measured.notes)
    )


def _histograms(result: Result) -> Chart:
    panels = [
        _panel("Q_equ (1: equilateral)", result.quality.Q_equ_histogram, result.quality.Q_equ),
        _panel("Q_nor (1: coplanar with its neighbours)", result.quality.Q_nor_histogram, result.quality.Q_nor),
    ]
    return Chart("quality", "Quality of the triangles", panels)


def _panel(title: str, histogram: Histogram, mean: float) -> Panel:
    middles = ((histogram.edges[1:] + histogram.edges[:-1]) / 2).tolist()
    bars = Series("triangles", middles, histogram.counts.tolist(), style="bars")
    return Panel(f"{title}, mean {mean:.4f}", title.split()[0], "triangles", [bars])
