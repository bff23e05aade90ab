"""Views as a circle of names, joined by the pairs that were registered: the form of the thesis's Fig. 2.26."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from jaxmodel.view.figures import png_bytes

_STYLE = {
    "common": ("#2a5db0", "-", "at least 30 % in common"),
    "joined": ("#9db4c8", "-", "less in common"),
    "doubtful": ("#c0392b", ":", "does not fit the others, left out"),
}


class GraphLine(NamedTuple):
    """Two views (numbers) with the smaller share of each that the other shows, and what became of the pair."""

    a: int
    b: int
    share: float
    kind: Literal["common", "joined", "doubtful"]


def view_graph_png(names: Sequence[str], lines: Sequence[GraphLine]) -> bytes:
    """The graph; lines are the wider the more two views share, with the share in percent beside the strongest."""
    figure = Figure(figsize=(7.5, 7.0), layout="constrained")
    axes: Any = figure.add_subplot()
    angle = np.pi / 2 - 2 * np.pi * np.arange(len(names)) / max(len(names), 1)
    x, y = np.cos(angle), np.sin(angle)
    shown = set()
    for line in sorted(lines, key=lambda line: line.share):
        colour, dash, label = _STYLE[line.kind]
        ends = [x[line.a], x[line.b]], [y[line.a], y[line.b]]
        width = 0.6 + 5 * line.share
        axes.plot(*ends, dash, color=colour, linewidth=width, label=None if line.kind in shown else label, zorder=1)
        shown.add(line.kind)
        if line.kind == "common":
            axes.text(
                float(np.mean(ends[0])), float(np.mean(ends[1])), f"{100 * line.share:.0f}", fontsize=7, ha="center",
                va="center", bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none"}, zorder=2,
            )  # fmt: skip
    axes.scatter(x, y, s=60, color="#333333", zorder=3)
    for name, at in zip(names, angle, strict=True):
        place = 1.13 * np.cos(at), 1.1 * np.sin(at)
        axes.text(*place, name, ha="center", va="center", fontsize=9)
    axes.set_xlim(-1.4, 1.4)
    axes.set_ylim(-1.3, 1.3)
    axes.set_aspect("equal")
    axes.axis("off")
    if shown:
        axes.legend(loc="lower center", ncol=3, fontsize=8, frameon=False)
    return png_bytes(figure)
