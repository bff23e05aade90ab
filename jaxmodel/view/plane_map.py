"""A value over a plane, on a grid of places."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jaxmodel.view.figures import png_bytes


def plane_png(
    title: str,
    x_label: str,
    y_label: str,
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    value: Float[np.ndarray, " n"],
) -> bytes:
    """``value`` (0 to 1) at ``x``, ``y``, which run over all pairs of their values; the largest is marked."""
    across, up = np.unique(x), np.unique(y)
    grid = np.full((len(up), len(across)), np.nan)
    grid[np.searchsorted(up, y), np.searchsorted(across, x)] = value
    figure = Figure(figsize=(6.4, 5.6))
    axes = figure.add_subplot()
    drawn = axes.pcolormesh(across, up, grid, cmap="viridis", vmin=0.0, vmax=1.0, shading="nearest")
    figure.colorbar(drawn, ax=axes)
    best = int(np.nanargmax(value))
    axes.plot(x[best], y[best], marker="*", ms=14, color="#e0402a", markeredgecolor="white")
    axes.annotate(f"{100 * value[best]:.0f} %", (x[best], y[best]), (6, 6), textcoords="offset points", color="white")
    axes.set(xlabel=x_label, ylabel=y_label, aspect="equal")
    axes.set_title(title, fontsize=10)
    return png_bytes(figure)
