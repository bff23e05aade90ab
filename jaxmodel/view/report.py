"""``report.html``: one file that opens anywhere, without a network: tables, the sphere, the two scans, the curves.

The plotting library is written into the file once; arrays go in with five digits. Sections draw when opened and are
cleared when closed, so a browser's limit on 3D views is never met.
"""

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from jaxmodel.view.axis_sphere import AxisSphere, sphere_plot
from jaxmodel.view.chart_drawing import panel_plot
from jaxmodel.view.charts import Chart, Picture
from jaxmodel.view.mesh_view import MeshView, mesh_plot
from jaxmodel.view.report_plots import PairView, pair_plots
from jaxmodel.view.table import Table

__all__ = ["Table", "render_report"]


def render_report(
    title: str,
    facts: Mapping[str, str],
    tables: Sequence[Table],
    sections: Sequence[PairView | Chart | Picture | AxisSphere | MeshView],
    note: str = "",
) -> str:
    """The whole page as HTML text; it loads nothing from anywhere.

    Args:
        title: heading of the page.
        facts: name -> value, shown as a short list on top.
        tables: shown in order above the plots.
        sections: one folding section each, the first one open.
        note: a sentence under the last section.
    """
    from plotly.offline import get_plotlyjs

    plots: dict[str, Any] = {}
    body = [f"<h1>{html.escape(title)}</h1>", _facts(facts), *(_table(table) for table in tables)]
    for number, section in enumerate(sections):
        name, drawn, content = _section(number, section)
        plots |= drawn
        boxes = "".join(f'<div class="plot" id="{plot}"></div>' for plot in drawn)
        state = " open" if number == 0 else ""
        summary = f"<summary>{html.escape(name)}</summary>"
        body.append(f'<details{state}>{summary}<div class="plots">{boxes}</div>{content}</details>')
    body.append(f"<p>{html.escape(note)}</p>")
    parts = {
        "TITLE": html.escape(title),
        "BODY": "\n".join(body),
        "PLOTS": json.dumps(plots, separators=(",", ":"), allow_nan=False).replace("</", "<\\/"),
        "PLOTLY": get_plotlyjs(),
    }
    page = (files("jaxmodel.view") / "report_template.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found.group(1)], page)


def _section(
    number: int, section: PairView | Chart | Picture | AxisSphere | MeshView
) -> tuple[str, dict[str, Any], str]:
    """Its name, its plots by the name of their box, and further HTML."""
    match section:
        case PairView():
            return section.name, {f"pair{number}-{name}": plot for name, plot in pair_plots(section).items()}, ""
        case Chart():
            drawn = {f"chart{number}-{i}": panel_plot(panel) for i, panel in enumerate(section.panels)}
            return section.title, drawn, ""
        case AxisSphere():
            return section.title, {f"sphere{number}": sphere_plot(section)}, ""
        case MeshView():
            return section.name, {f"mesh{number}": mesh_plot(section)}, ""
        case Picture():
            data = base64.b64encode(section.png).decode()
            return section.title, {}, f'<img alt="{html.escape(section.title)}" src="data:image/png;base64,{data}">'


def _facts(facts: Mapping[str, str]) -> str:
    items = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in facts.items())
    return f"<dl>{items}</dl>"


def _table(table: Table) -> str:
    head = "".join(f"<th>{html.escape(column)}</th>" for column in table.columns)
    rows = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows)
    return (
        f"<h2>{html.escape(table.title)}</h2><div class='wide'><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )
