"""Charts drawn: as PNG with matplotlib, and as plain plotly trees for the report."""

from collections.abc import Sequence
from itertools import cycle
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.ticker import NullFormatter

from jaxmodel.view.charts import Chart, Panel
from jaxmodel.view.figures import grid_of_axes, png_bytes

COLORS = ("#1666b0", "#c8511b", "#3a923a", "#8e5ea2", "#7f7f7f", "#b8860b", "#17a2b8", "#d0579b")
_GROUP = 0.8
"""Share of a category's width that its bars fill together."""
_LETTERS = 66
"""Letters of the names along x that fit beside each other."""
_TILTED, _NAME_ROW = 0.35, 0.13
"""Height that tilted names take below the panels, and each further row of upright ones (inches)."""
_LEGEND_LETTERS, _LEGEND_ROW = 78, 0.24
"""Letters of a legend's row under one panel (each entry takes some for its mark), and the height of a row (inches)."""


def chart_png(chart: Chart) -> bytes:
    """The chart as PNG: three panels a row at most (four are two by two), the same bytes for the same data.

    Where all panels have the same curves their one legend stands below, else each panel has its own.
    """
    columns = 2 if len(chart.panels) == 4 else min(len(chart.panels), 3)
    rows = -(-len(chart.panels) // columns)
    labels = [[series.label for series in panel.series] for panel in chart.panels]
    shared = len(labels[0]) > 1 and all(of == labels[0] for of in labels)
    across = min(len(labels[0]), _LEGEND_LETTERS * columns // (max(map(len, labels[0])) + 6)) if shared else 1
    foot = _LEGEND_ROW * (-(-len(labels[0]) // across) + 0.5) if shared else 0.0
    foot += max(_height_of_names(_names(panel)) for panel in chart.panels)
    figure, axes = grid_of_axes(rows, columns, foot)
    flat: list[Any] = [one for row in axes for one in row]
    for one, panel in zip(flat, chart.panels, strict=False):
        _draw(one, panel)
        if len(panel.series) > 1 and not shared:
            one.legend(fontsize=7)
    for spare in flat[len(chart.panels) :]:
        spare.set_axis_off()
    if shared:
        figure.legend(*flat[0].get_legend_handles_labels(), loc="lower center", ncols=across, fontsize=8, frameon=False)
    return png_bytes(figure)


def _draw(axes: Any, panel: Panel) -> None:
    names = _names(panel)
    for number, (series, color) in enumerate(zip(panel.series, cycle(COLORS), strict=False)):
        y = np.array(series.y, dtype=float)
        place = np.arange(len(y), dtype=float) if names else np.array(series.x, dtype=float)
        spread = None
        if series.low is not None and series.high is not None:
            bounds = np.stack([y - np.array(series.low, dtype=float), np.array(series.high, dtype=float) - y])
            spread = np.clip(np.nan_to_num(bounds), 0, None)
        if series.style == "bars":
            width = _GROUP / len(panel.series)
            shift = (number - (len(panel.series) - 1) / 2) * width
            axes.bar(place + shift, np.nan_to_num(y), width, color=color, label=series.label)
            if spread is not None:
                axes.errorbar(place + shift, y, yerr=spread, fmt="none", ecolor="black", capsize=2, lw=0.8)
        else:
            look = "o-" if series.style == "line" and len(y) <= 40 else "-" if series.style == "line" else "o"
            axes.errorbar(place, y, yerr=spread, fmt=look, color=color, ms=3, lw=1.2, capsize=2, label=series.label)
    axes.set(xlabel=panel.x, ylabel=panel.y)
    axes.set_title(panel.title, fontsize=10)
    if names:
        if _tilted(names):
            axes.set_xticks(range(len(names)), names, rotation=25, ha="right", rotation_mode="anchor", fontsize=7)
        else:
            axes.set_xticks(range(len(names)), _folded(names), fontsize=7)
    if panel.log_x and not names:
        axes.set_xscale("log")
        low, high = axes.get_xlim()
        if high < 100 * low:  # the labels of the usual locator would run into each other
            _plain_numbers(axes.xaxis)
    if panel.log_y:
        axes.set_yscale("log")
        whole_decades(axes)
    elif panel.from_zero and _lowest(panel) >= 0:
        axes.set_ylim(bottom=0)


def _tilted(names: list[str]) -> bool:
    """Whether some word is too wide to stand upright in its share of the axis."""
    return any(len(word) > _LETTERS // len(names) for name in names for word in name.split())


def _folded(names: list[str]) -> list[str]:
    return [fill(name, _LETTERS // len(names), break_long_words=False) for name in names]


def _height_of_names(names: list[str]) -> float:
    """What names below a panel take beyond a row of numbers (inches)."""
    if not names or _tilted(names):
        return _TILTED if names else 0.0
    return _NAME_ROW * max(name.count("\n") for name in _folded(names))


def whole_decades(axes: Any) -> None:
    """At least two powers of ten along y: labels of the values between them would be too wide."""
    low, high = np.log10(axes.get_ylim())
    if np.floor(high) - np.ceil(low) < 1:
        axes.set_ylim(10.0 ** np.floor(low), 10.0 ** np.ceil(high))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _plain_numbers(axis: Any) -> None:
    """Labels 1, 2, 5, 10, ... along a logarithmic axis."""
    from matplotlib import ticker

    axis.set_major_locator(ticker.LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(ticker.FormatStrFormatter("%g"))
    axis.set_minor_formatter(ticker.NullFormatter())


def panel_plot(panel: Panel) -> dict[str, Any]:
    """The panel as a plain plotly tree for the report."""
    data = []
    for series, color in zip(panel.series, cycle(COLORS), strict=False):
        y = _short(series.y)
        x = [str(value) if isinstance(value, str) else float(f"{value:.6g}") for value in series.x]
        curve: dict[str, Any] = {"name": series.label, "x": x, "y": y}
        if series.low is not None and series.high is not None:
            up, down = _beyond(series.high, series.y), _beyond(series.y, series.low)
            curve["error_y"] = {"type": "data", "symmetric": False, "array": up, "arrayminus": down, "thickness": 1}
        if series.style == "bars":
            data.append({**curve, "type": "bar", "marker": {"color": color}})
        else:
            mode = "markers" if series.style == "marks" else "lines+markers" if len(y) <= 40 else "lines"
            look = {"marker": {"color": color, "size": 5}, "line": {"color": color}}
            data.append({**curve, "type": "scatter", "mode": mode, **look})
    x_axis: dict[str, Any] = {"title": {"text": panel.x}}
    y_axis: dict[str, Any] = {"title": {"text": panel.y}}
    x_axis |= {"type": "category"} if _names(panel) else {"type": "log"} if panel.log_x else {}
    if panel.log_y:
        y_axis["type"] = "log"
    elif panel.from_zero and _lowest(panel) >= 0:
        y_axis["rangemode"] = "tozero"
    layout = {
        "title": {"text": panel.title, "font": {"size": 14}},
        "margin": {"l": 60, "r": 20, "t": 40, "b": 45},
        "legend": {"orientation": "h", "y": -0.2},
        "barmode": "group",
        "xaxis": x_axis,
        "yaxis": y_axis,
    }
    return {"data": data, "layout": layout}


def _names(panel: Panel) -> list[str]:
    """The categories along x, empty where x are numbers."""
    values = [value for series in panel.series[:1] for value in series.x]
    return [str(value) for value in values] if values and isinstance(values[0], str) else []


def _lowest(panel: Panel) -> float:
    finite = [
        float(value)
        for series in panel.series
        for values in (series.y, series.low or ())
        for value in values
        if np.isfinite(value)
    ]
    return min(finite, default=0.0)


def _beyond(upper: Sequence[float | int], lower: Sequence[float | int]) -> list[float | None]:
    """How far ``upper`` lies above ``lower``, never negative."""
    return _short([max(a - b, 0.0) if np.isfinite(a - b) else np.nan for a, b in zip(upper, lower, strict=True)])


def _short(values: Sequence[float | int]) -> list[float | None]:
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]
