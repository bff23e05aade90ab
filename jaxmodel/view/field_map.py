"""A value at directions all around, such as the utility of views, as maps of equal area (after Fig. 4.7)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.view.figures import png_bytes

_COLUMNS = 3
_HIGH = 2.7
_GREY = "#d0d0d0"
_MARKS = "*Xo^sD"


class FieldMap(NamedTuple):
    """One map: ``value`` at each direction, NaN where none is allowed (grey); ``marks`` by name, in degrees."""

    title: str
    azimuth_deg: Float[np.ndarray, " n"]
    elevation_deg: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    marks: Mapping[str, tuple[float, float]]


def field_png(title: str, maps: list[FieldMap]) -> bytes:
    """The maps side by side in Mollweide's projection, each with its own scale of colours."""
    from matplotlib.figure import Figure

    columns = min(len(maps), _COLUMNS)
    rows = -(-len(maps) // columns)
    figure = Figure(figsize=(5.2 * columns, _HIGH * rows + 0.9))
    figure.suptitle(title)
    handles = {}
    for number, of in enumerate(maps):
        axes = figure.add_subplot(rows, columns, number + 1, projection="mollweide")
        axes.grid(False)
        axes.set(xticks=[], yticks=[])
        axes.set_title(of.title, fontsize=9)
        x, y = np.deg2rad(of.azimuth_deg), np.deg2rad(of.elevation_deg)
        none = ~np.isfinite(of.value)
        dot = 5e4 / max(len(x), 1)
        axes.scatter(x[none], y[none], s=dot, color=_GREY, linewidths=0, rasterized=True)
        drawn = axes.scatter(
            x[~none], y[~none], s=dot, c=of.value[~none], cmap="viridis", linewidths=0, rasterized=True
        )
        figure.colorbar(drawn, ax=axes, shrink=0.7)
        for mark, (name, place) in zip(_MARKS, of.marks.items(), strict=False):
            handles[name] = axes.scatter(
                *np.deg2rad(place), marker=mark, s=60, color="#e0402a", edgecolors="white", linewidths=0.8
            )
    if handles:
        figure.legend(list(handles.values()), list(handles), loc="lower center", ncol=len(handles), fontsize=9)
    high = _HIGH * rows + 0.9
    figure.subplots_adjust(0.02, 0.35 / high, 0.98, 1 - 0.6 / high, 0.08, 0.15)
    return png_bytes(figure)
