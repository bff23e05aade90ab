"""The rotation axes of a set of motions on a sphere: how well they excite a hand-eye calibration."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jaxmodel.view.figures import SECOND, png_bytes
from jaxmodel.view.report_plots import ball, marks3d

_SCALE = "Viridis"
_MOST_AXES = 4000


class AxisSphere(NamedTuple):
    """Unit axes with the angle turned about each; an axis and its opposite are the same and both are drawn.

    ``free``: a direction that the motions leave undetermined, drawn as a line through the sphere.
    """

    title: str
    frame: str
    axes: Float[np.ndarray, "n 3"]
    angle_deg: Float[np.ndarray, " n"]
    free: Float[np.ndarray, "3"] | None = None


def sphere_png(sphere: AxisSphere) -> bytes:
    """Both halves of the sphere, above and below its equator, as discs of equal area; larger turns, larger marks."""
    figure = Figure(figsize=(9.6, 4.8))
    places, angle = _both_ends(sphere)
    most = float(angle.max(initial=1.0))
    marks: Any = None
    for number, (side, name) in enumerate(((1.0, "towards +z"), (-1.0, "towards -z"))):
        axes: Any = figure.add_axes((0.02 + 0.44 * number, 0.04, 0.43, 0.86))
        turn = np.linspace(0, 2 * np.pi, 181)
        for height in (0, 30, 60):
            radius = _radius(np.array([np.sin(np.radians(height))]))[0]
            axes.plot(radius * np.cos(turn), radius * np.sin(turn), color="#cccccc", lw=0.8, zorder=0)
        for spoke in np.arange(0, np.pi, np.pi / 4):
            end = np.array([np.cos(spoke), np.sin(spoke)])
            axes.plot(*np.stack([-end, end], axis=1), color="#e4e4e4", lw=0.8, zorder=0)
        here = side * places[:, 2] >= 0
        flat = _flat(places[here], side)
        marks = axes.scatter(*flat.T, c=angle[here], s=4 + 20 * angle[here] / most, cmap="viridis", vmin=0, vmax=most)
        if sphere.free is not None:
            end = sphere.free if side * sphere.free[2] >= 0 else -sphere.free
            spot = _flat(end[None], side)[0]
            axes.plot(*spot, "x", color=SECOND, ms=13, mew=3)
            axes.annotate("undetermined", spot, xytext=(8, 8), textcoords="offset points", color=SECOND)
        axes.annotate("+x", (1.03, 0), va="center", fontsize=9)
        axes.annotate("+y", (0, 1.03), ha="center", fontsize=9)
        axes.set(xlim=(-1.15, 1.15), ylim=(-1.1, 1.15), aspect="equal")
        axes.set_axis_off()
        axes.set_title(name, fontsize=10, y=-0.05)
    figure.suptitle(f"{sphere.title} (in {sphere.frame})", fontsize=11)
    bar = figure.colorbar(marks, cax=figure.add_axes((0.915, 0.15, 0.015, 0.6)))
    bar.set_label("rotation angle (degree)")
    return png_bytes(figure)


def sphere_plot(sphere: AxisSphere) -> dict[str, Any]:
    """The sphere to turn, as a plain plotly tree for the report."""
    places, angle = _both_ends(sphere)
    rounded = [float(f"{value:.4g}") for value in angle]
    marker = {"size": 3.5, "color": rounded, "colorscale": _SCALE, "cmin": 0, "showscale": True,
              "colorbar": {"title": {"text": "angle (degree)"}, "thickness": 12}}  # fmt: skip
    data = [ball(), {**marks3d("rotation axes", places, marker), "text": [f"{value:.1f} degrees" for value in rounded],
                     "hoverinfo": "text"}]  # fmt: skip
    if sphere.free is not None:
        line = marks3d("undetermined direction", np.stack([-1.3 * sphere.free, 1.3 * sphere.free]), {})
        data.append({**line, "mode": "lines", "line": {"color": SECOND, "width": 6}})
    layout = {
        "title": {"text": f"{sphere.title} (in {sphere.frame})", "font": {"size": 14}},
        "margin": {"l": 20, "r": 20, "t": 40, "b": 20},
        "legend": {"orientation": "h", "y": -0.05},
        "scene": {"aspectmode": "cube"},
    }
    return {"data": data, "layout": layout}


def _both_ends(sphere: AxisSphere) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    chosen = slice(None, None, len(sphere.axes) // _MOST_AXES + 1)
    axes, angle = sphere.axes[chosen], sphere.angle_deg[chosen]
    rising = np.argsort(angle, kind="stable")  # the largest turns are drawn last, on top
    axes, angle = axes[rising], angle[rising]
    return np.concatenate([axes, -axes]), np.concatenate([angle, angle])


def _radius(height: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Lambert's azimuthal projection: equal areas of the half sphere stay equal, its equator has radius 1."""
    return np.sqrt(np.clip(1.0 - height, 0.0, None))


def _flat(places: Float[np.ndarray, "n 3"], side: float) -> Float[np.ndarray, "n 2"]:
    beside = np.linalg.norm(places[:, :2], axis=1)
    radius = _radius(side * places[:, 2])
    return places[:, :2] * (radius / np.maximum(beside, 1e-12))[:, None]
