"""The figures of thesis §2.7 and §2.9.2 as PNG bytes: sorted error, error beside the truth, sphere, iterations.

Each takes plain arrays and returns the picture; nothing is read or written here. Blue is what converged, grey the rest.
"""

import io
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

GOOD, REST, FIRST, SECOND = "#1666b0", "#a9a9a9", "#1666b0", "#c8511b"
_MOST_MARKS = 20_000


class SweepCurve(NamedTuple):
    """What one kind of control points gave from every start."""

    label: str
    error: Float[np.ndarray, " s"]
    """Mean distance of the kept pairs, unit of the data."""
    good: Bool[np.ndarray, " s"]
    """Right by the truth, or a member of the plateau where the truth is unknown."""
    rotation_error_deg: Float[np.ndarray, " s"] | None = None


class IterationCurve(NamedTuple):
    """One registration, iteration by iteration."""

    label: str
    error: Float[np.ndarray, " n"]
    shared_rate: Float[np.ndarray, " n"]
    strategy: Int[np.ndarray, " n"]


def sorted_error(title: str, curves: list[SweepCurve]) -> bytes:
    """ICP error of all starts in rising order, one panel for each kind of points (Fig. 2.34)."""
    figure, panels = grid_of_axes(1, len(curves))
    for axes, curve in zip(panels[0], curves, strict=True):
        _sorted_panel(axes, curve)
        axes.set_title(f"{title}, {curve.label}: {int(curve.good.sum())} of {len(curve.good)} converge")
    return png_bytes(figure)


def error_beside_truth(title: str, curves: list[SweepCurve]) -> bytes:
    """Sorted ICP error, and in the same order the true rotation error (Fig. 2.38), where it is known."""
    known = [curve for curve in curves if curve.rotation_error_deg is not None]
    figure, panels = grid_of_axes(max(len(known), 1), 2)
    for (left, right), curve in zip(panels, known, strict=False):
        order = _sorted_panel(left, curve)
        left.set_title(f"{title}, {curve.label}: {int(curve.good.sum())} of {len(curve.good)} converge")
        assert curve.rotation_error_deg is not None
        true_error, good = curve.rotation_error_deg[order], curve.good[order]
        for marked, color, label in ((~good, REST, "not converged"), (good, GOOD, "converged")):
            place = _few(np.flatnonzero(marked))
            right.plot(place + 1, true_error[place], ".", color=color, ms=3, label=label)
        right.set(xlabel="start, in the order of the ICP error", ylabel="true rotation error (degree)", ylim=(0, 185))
        right.set_title("the same order, error against the truth")
        right.set_yticks(range(0, 181, 30))
    return png_bytes(figure)


def start_sphere(title: str, directions: Float[np.ndarray, "s 3"], curves: list[SweepCurve]) -> bytes:
    """Initial sensor positions around the object: all of them, then those that converge (Fig. 2.33).

    Args:
        directions: unit vectors from the object to where each start puts the source's sensor, target frame.
        curves: starts in the same order as ``directions``.
    """
    figure = Figure(figsize=(3.8 * (1 + len(curves)), 4.0))
    figure.subplots_adjust(0, 0, 1, 0.93, 0, 0)
    panels = [figure.add_subplot(1, 1 + len(curves), i + 1, projection="3d") for i in range(1 + len(curves))]
    u, v = np.mgrid[0 : 2 * np.pi : 25j, 0 : np.pi : 13j]
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    chosen = [np.ones(len(directions), dtype=bool), *(curve.good for curve in curves)]
    names = [
        f"{title}: all {len(directions)} initial positions",
        *(f"{c.label}: {int(c.good.sum())} converge" for c in curves),
    ]
    for axes, mask, name in zip(panels, chosen, names, strict=True):
        plot: Any = axes
        plot.plot_wireframe(*ball, color="#e4e4e4", linewidth=0.4)
        places, count = np.unique(np.round(directions[mask], 3), axis=0, return_counts=True)
        places, count = places[:_MOST_MARKS], count[:_MOST_MARKS]
        plot.scatter(
            *places.T, marker="x", s=10 + 8 * np.sqrt(count), color=REST if axes is panels[0] else GOOD, depthshade=True
        )
        plot.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        plot.set_box_aspect((1, 1, 1), zoom=1.35)
        plot.set_axis_off()
        plot.set_title(name, fontsize=10)
    return png_bytes(figure)


def iterations(title: str, curves: list[IterationCurve]) -> bytes:
    """Error and sharing rate at each iteration, strategy changes as dashed lines (Fig. 2.23)."""
    figure, panels = grid_of_axes(1, len(curves))
    for axes, curve in zip(panels[0], curves, strict=True):
        step = np.arange(1, len(curve.error) + 1)
        scale, unit = _scaled(curve.error)
        axes.plot(step, curve.error * scale, color=FIRST)
        axes.set_xlabel("iteration")
        axes.set_ylabel(f"error ({unit})", color=FIRST)
        axes.set_ylim(bottom=0)
        other = axes.twinx()
        other.plot(step, curve.shared_rate, color=SECOND)
        other.set_ylabel("sharing rate of clusters", color=SECOND)
        other.set_ylim(0, 1)
        for change in switches(curve.strategy):
            axes.axvline(change, color="black", linestyle="--", linewidth=0.8)
            name = f"strategy {curve.strategy[change - 1]}"
            place = {"transform": axes.get_xaxis_transform(), "rotation": 90, "fontsize": 7}
            axes.text(change, 0.99, name, ha="left", va="top", **place)
        axes.set_title(f"{title}, {curve.label}")
    return png_bytes(figure)


def switches(strategy: Int[np.ndarray, " n"]) -> list[int]:
    """Iterations, counted from 1, at which the strategy differs from the one before."""
    return [int(i) + 2 for i in np.nonzero(np.diff(strategy))[0]]


def _sorted_panel(axes: Any, curve: SweepCurve) -> Int[np.ndarray, " s"]:
    order = np.argsort(np.where(np.isfinite(curve.error), curve.error, np.inf), kind="stable")
    error, good = curve.error[order], curve.good[order]
    scale, unit = _scaled(error)
    place = _few(np.arange(len(order)))
    axes.plot(place + 1, error[place] * scale, color=REST, linewidth=1)
    for marked, color, size, label in ((~good, REST, 3, "not converged"), (good, GOOD, 4, "converged")):
        place = _few(np.flatnonzero(marked))
        axes.plot(place + 1, error[place] * scale, ".", color=color, ms=size, label=label)
    axes.set(xlabel="start, sorted by error", ylabel=f"ICP error ({unit})")
    axes.set_ylim(bottom=0)
    axes.legend(loc="lower right")
    return order


def _few(places: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """At most ``_MOST_MARKS`` of them, evenly picked: more cannot be told apart and cost memory."""
    return places[:: len(places) // _MOST_MARKS + 1]


def _scaled(error: Float[np.ndarray, " n"]) -> tuple[float, str]:
    """A factor that brings the errors to plain numbers, and the axis's unit: no exponent hides in a corner."""
    most = float(np.max(error, where=np.isfinite(error), initial=0.0))
    power = 0 if most == 0 or 0.1 <= most < 10_000 else int(3 * np.floor(np.log10(most) / 3))
    return 10.0**-power, f"$10^{{{power}}}$ unit of the data" if power else "unit of the data"


def grid_of_axes(rows: int, columns: int, foot: float = 0.0) -> tuple[Figure, Any]:
    """An empty figure and its axes, with fixed margins: laying them out by trial costs more than drawing them.

    ``foot`` (inches) is left free below all of them.
    """
    width, height, left, gap, bottom, top = 5.4, 3.8, 0.75, 1.5, 0.55, 0.4
    across, up = width * columns, height * rows + foot
    figure = Figure(figsize=(across, up))
    panels = figure.subplots(rows, columns, squeeze=False)
    panel = (across - 2 * left - gap * (columns - 1)) / columns
    tall = height - bottom - top
    figure.subplots_adjust(
        left / across, (foot + bottom) / up, 1 - left / across, 1 - top / up, gap / panel, (bottom + top) / tall
    )
    return figure, panels


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG, the same bytes for the same drawing."""
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()
