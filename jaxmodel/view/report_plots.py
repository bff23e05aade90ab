"""The interactive plots of the report as plain plotly trees: two scans, sphere, sorted error, truth, iterations."""

from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.view.figures import FIRST, GOOD, REST, SECOND, IterationCurve, SweepCurve, switches

_MOST_STARTS = 3000
_NEAR = {"eye": {"x": 0.9, "y": 0.9, "z": 0.7}}
_COLORS = (GOOD, SECOND, "#3a923a", "#8e5ea2")


class PairView(NamedTuple):
    """Everything the report shows of one pair of scans. Points are in the target's frame, unit of the data."""

    name: str
    target: Float[np.ndarray, "t 3"]
    before: Float[np.ndarray, "n 3"]
    """The source at the start that led to the best registration."""
    after: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "s 3"]
    """Where each start puts the source's sensor, seen from the object: unit vectors."""
    curves: list[SweepCurve]
    traces: list[IterationCurve]
    best: str
    """Which kind of control points gave ``after``."""


def pair_plots(pair: PairView) -> dict[str, Any]:
    """Plot name -> ``{"data": ..., "layout": ...}`` for plotly."""
    plots = {"scans": _scans(pair), "sphere": _sphere(pair), "sorted": _sorted(pair)}
    if any(curve.rotation_error_deg is not None for curve in pair.curves):
        plots["truth"] = _truth(pair)
    if pair.traces:
        plots["iterations"] = _iterations(pair)
    return plots


def _scans(pair: PairView) -> dict[str, Any]:
    def cloud(name: str, points: Float[np.ndarray, "n 3"], color: str, visible: bool) -> dict[str, Any]:
        return {**marks3d(name, points, {"size": 1.6, "color": color}), "visible": visible, "hoverinfo": "name"}

    def button(label: str, *visible: bool) -> dict[str, Any]:
        return {"label": label, "method": "restyle", "args": [{"visible": list(visible)}]}

    buttons = [
        button("before", True, True, False),
        button("after", True, False, True),
        button("both", True, True, True),
    ]
    menu = {"type": "buttons", "direction": "right", "x": 0, "y": 0, "xanchor": "left", "yanchor": "top"}
    return {
        "data": [
            cloud("target", pair.target, REST, True),
            cloud("source, before", pair.before, SECOND, False),
            cloud("source, after", pair.after, GOOD, True),
        ],
        "layout": {
            **_layout(f"The two scans, best start of {pair.best} (unit of the data)"),
            "scene": {"aspectmode": "data"},
            "updatemenus": [{**menu, "active": 1, "buttons": buttons}],
        },
    }


def _sphere(pair: PairView) -> dict[str, Any]:
    kept = _thinned(len(pair.directions))
    places = pair.directions[kept]
    data = [ball(), marks3d("all starts", places, {"size": 2.5, "color": REST, "symbol": "x"})]
    for radius, (curve, color) in enumerate(zip(pair.curves, cycle(_COLORS), strict=False), start=1):
        good = np.flatnonzero(curve.good[kept])
        marks = marks3d(f"converge, {curve.label}", (1 + 0.03 * radius) * places[good], {"size": 4.5, "color": color})
        text = [f"start {kept[i]}, error {curve.error[kept[i]]:.3g}" for i in good]
        data.append({**marks, "text": text, "hoverinfo": "text+name"})
    shown = f"{len(kept)} of {len(pair.directions)}" if len(kept) < len(pair.directions) else f"{len(kept)}"
    layout = _layout(f"Initial positions of the sensor around the object ({shown} starts)")
    hidden = {f"{axis}axis": {"visible": False} for axis in "xyz"}
    return {"data": data, "layout": {**layout, "scene": {"aspectmode": "cube", "camera": _NEAR, **hidden}}}


def ball() -> dict[str, Any]:
    """Circles of latitude and longitude of the unit sphere, as one broken line."""
    along, circles = np.append(np.linspace(0, 2 * np.pi, 49), np.nan), []
    for turn in np.arange(0, np.pi, np.pi / 8):
        circles.append(np.stack([np.cos(turn) * np.sin(along), np.sin(turn) * np.sin(along), np.cos(along)], axis=1))
    for height in np.linspace(-1, 1, 9)[1:-1] * np.pi / 2:
        flat = np.stack([np.cos(along), np.sin(along)], axis=1) * np.cos(height)
        circles.append(np.column_stack([flat, np.where(np.isfinite(along), np.sin(height), np.nan)]))
    wire = marks3d("unit sphere", np.concatenate(circles), {})
    return {**wire, "mode": "lines", "line": {"color": "#cccccc", "width": 1}, "hoverinfo": "skip", "showlegend": False}


def _sorted(pair: PairView) -> dict[str, Any]:
    data = []
    for curve, color in zip(pair.curves, cycle(_COLORS), strict=False):
        order = _rising(curve)
        rank = _thinned(len(order))
        data.append(_line(curve.label, rank + 1, curve.error[order[rank]], {"color": color}))
        good = rank[curve.good[order[rank]]]
        marks = {"mode": "markers", "marker": {"size": 5, "color": color}}
        data.append({**_line(f"converge, {curve.label}", good + 1, curve.error[order[good]]), **marks})
    return {
        "data": data,
        "layout": _layout("Sorted ICP error", x="start, sorted by error", y="ICP error (unit of the data)"),
    }


def _truth(pair: PairView) -> dict[str, Any]:
    data = []
    for curve, color in zip(pair.curves, cycle(_COLORS), strict=False):
        if curve.rotation_error_deg is None:
            continue
        order = _rising(curve)
        rank = _thinned(len(order))
        points = _line(curve.label, rank + 1, curve.rotation_error_deg[order[rank]])
        data.append({**points, "mode": "markers", "marker": {"size": 3, "color": color}})
    return {
        "data": data,
        "layout": _layout(
            "True rotation error, in the order of the ICP error",
            x="start, sorted by error",
            y="rotation error (degree)",
        ),
    }


def _iterations(pair: PairView) -> dict[str, Any]:
    data, shapes = [], []
    for trace, color in zip(pair.traces, cycle((FIRST, SECOND)), strict=False):
        step = np.arange(1, len(trace.error) + 1)
        data.append(_line(f"error, {trace.label}", step, trace.error, {"color": color}))
        rate = _line(f"sharing rate, {trace.label}", step, trace.shared_rate, {"color": color, "dash": "dot"})
        data.append({**rate, "yaxis": "y2"})
        edge = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "line": {"color": color, "width": 1, "dash": "dash"}}
        shapes += [{**edge, "x0": change, "x1": change} for change in switches(trace.strategy)]
    layout = _layout(
        "Error and sharing rate, best start (dashed: strategy changes)", x="iteration", y="error (unit of the data)"
    )
    rate_axis = {
        "overlaying": "y",
        "side": "right",
        "range": [0, 1],
        "dtick": 0.2,
        "title": {"text": "sharing rate of clusters"},
    }
    return {"data": data, "layout": {**layout, "yaxis2": rate_axis, "shapes": shapes}}


def _layout(title: str, x: str = "", y: str = "") -> dict[str, Any]:
    axes = {"xaxis": {"title": {"text": x}}, "yaxis": {"title": {"text": y}, "rangemode": "tozero"}} if x else {}
    legend = {"orientation": "h", "y": -0.2}
    return {"title": {"text": title, "font": {"size": 14}}, "margin": {"l": 55, "r": 50, "t": 40, "b": 45},
            "legend": legend, **axes}  # fmt: skip


def marks3d(name: str, points: Float[np.ndarray, "n 3"], marker: dict[str, Any]) -> dict[str, Any]:
    """Points in space as a plain plotly trace."""
    x, y, z = (_short(column) for column in np.asarray(points, dtype=float).T)
    return {"type": "scatter3d", "mode": "markers", "name": name, "x": x, "y": y, "z": z, "marker": marker}


def _line(name: str, x: np.ndarray, y: np.ndarray, line: dict[str, Any] | None = None) -> dict[str, Any]:
    return {"type": "scatter", "mode": "lines", "name": name, "x": _short(x), "y": _short(y), "line": line or {}}


def _short(values: np.ndarray) -> list[float | None]:
    """Numbers with five significant digits; what is not finite becomes a gap."""
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values.tolist()]


def _thinned(count: int) -> Int[np.ndarray, " k"]:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST_STARTS)).round().astype(np.int64))


def _rising(curve: SweepCurve) -> Int[np.ndarray, " s"]:
    return np.argsort(np.where(np.isfinite(curve.error), curve.error, np.inf), kind="stable")
