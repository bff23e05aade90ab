"""``report.html``: one file that opens anywhere, without a network: tables, the sphere, the two scans, the curves.

The plotting library is written into the file once; arrays go in with five digits. Sections draw when opened and are
cleared when closed, so a browser's limit on 3D views is never met.
"""

import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

from jaxmodel.view.report_plots import PairView, pair_plots


class Table(NamedTuple):
    """A table of text."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def render_report(
    title: str, facts: Mapping[str, str], tables: Sequence[Table], pairs: Sequence[PairView], note: str = ""
) -> str:
    """The whole page as HTML text; it loads nothing from anywhere.

    Args:
        title: heading of the page.
        facts: name -> value, shown as a short list on top.
        tables: shown in order above the plots.
        pairs: one folding section each, the first one open.
        note: a sentence under the last section.
    """
    from plotly.offline import get_plotlyjs

    plots: dict[str, Any] = {}
    body = [f"<h1>{html.escape(title)}</h1>", _facts(facts), *(_table(table) for table in tables)]
    for number, pair in enumerate(pairs):
        drawn = {f"pair{number}-{name}": plot for name, plot in pair_plots(pair).items()}
        plots |= drawn
        boxes = "".join(f'<div class="plot" id="{name}"></div>' for name in drawn)
        state = " open" if number == 0 else ""
        summary = f"<summary>{html.escape(pair.name)}</summary>"
        body.append(f'<details{state}>{summary}<div class="plots">{boxes}</div></details>')
    body.append(f"<p>{html.escape(note)}</p>")
    parts = {
        "TITLE": html.escape(title),
        "BODY": "\n".join(body),
        "PLOTS": json.dumps(plots, separators=(",", ":"), allow_nan=False).replace("</", "<\\/"),
        "PLOTLY": get_plotlyjs(),
    }
    page = (files("jaxmodel.view") / "report_template.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found.group(1)], page)


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
