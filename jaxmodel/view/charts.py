"""Charts as plain data: lines, marks and bars with intervals. ``chart_drawing.py`` draws them."""

from collections.abc import Sequence
from typing import Literal, NamedTuple


class Series(NamedTuple):
    """One curve. ``x`` are numbers, or names (then all series of the panel have the same ones, in one order).

    ``low`` and ``high`` bound an interval around each ``y``. Values that are not finite leave a gap.
    """

    label: str
    x: Sequence[float | int] | Sequence[str]
    y: Sequence[float | int]
    low: Sequence[float | int] | None = None
    high: Sequence[float | int] | None = None
    style: Literal["line", "marks", "bars"] = "line"


class Panel(NamedTuple):
    """One pair of axes; ``x`` and ``y`` are their labels with units.

    The y axis of values that are not negative begins at 0 if ``from_zero``, else where they do.
    """

    title: str
    x: str
    y: str
    series: Sequence[Series]
    log_x: bool = False
    log_y: bool = False
    from_zero: bool = True


class Chart(NamedTuple):
    """Panels side by side: one file ``figures/NAME.png``, one section of the report."""

    name: str
    title: str
    panels: Sequence[Panel]


class Picture(NamedTuple):
    """A finished PNG with its caption, for the report."""

    title: str
    png: bytes
