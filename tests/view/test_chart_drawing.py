"""Charts as PNG and as plotly trees: the same data in both, gaps where values are missing."""

import io
import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from jaxmodel.view.chart_drawing import COLORS, chart_png, panel_plot, whole_decades
from jaxmodel.view.charts import Chart, Panel, Series

LINE = Series("contours", [1, 2, 3], [0.5, 0.25, np.nan], [0.4, 0.2, np.nan], [0.6, 0.45, np.nan])
BARS = Series("vertices", ["free-form", "structured"], [10.0, 30.0], [5.0, 20.0], [15.0, 35.0], "bars")


def panel(*series: Series, log: bool = False) -> Panel:
    return Panel("title", "points", "error (mm)", series, log_x=log, log_y=log)


def pixels(chart: Chart) -> np.ndarray:
    return imread(io.BytesIO(chart_png(chart)), format="png")[..., :3]


def colored(image: np.ndarray, color: str) -> int:
    wanted = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return int(np.sum(np.all(np.abs(image - wanted) < 0.05, axis=-1)))


def test_the_png_shows_every_series_in_its_color() -> None:
    image = pixels(Chart("c", "C", [panel(LINE, LINE._replace(label="b", y=[0.1, 0.2, 0.3])), panel(BARS)]))
    assert colored(image, COLORS[0]) > 1000 and colored(image, COLORS[1]) > 100


@pytest.mark.parametrize("panels", [1, 2, 3, 4, 6])
def test_three_panels_a_row_but_four_are_two_by_two(panels: int) -> None:
    image, one = (pixels(Chart("c", "C", [panel(LINE)] * count)) for count in (panels, 1))
    columns = 2 if panels == 4 else min(panels, 3)
    assert image.shape[0] == -(-panels // columns) * one.shape[0]
    assert abs(image.shape[1] - columns * one.shape[1]) <= 3


def test_same_data_is_the_same_picture() -> None:
    assert chart_png(Chart("c", "C", [panel(LINE)])) == chart_png(Chart("c", "C", [panel(LINE)]))


def test_charts_without_values_are_drawn_empty() -> None:
    nothing = Series("none", [], [])
    missing = Series("missing", ["a"], [np.nan], [np.nan], [np.nan], "bars")
    assert pixels(Chart("c", "C", [panel(nothing), panel(missing), panel()])).shape[0] > 200


def test_the_plotly_tree_is_plain_json_with_the_values_and_bounds() -> None:
    tree = json.loads(json.dumps(panel_plot(panel(LINE)), allow_nan=False))
    (curve,) = tree["data"]
    assert curve["x"] == [1, 2, 3] and curve["y"] == [0.5, 0.25, None] and curve["mode"] == "lines+markers"
    assert curve["error_y"]["array"] == pytest.approx([0.1, 0.2, None])
    assert curve["error_y"]["arrayminus"] == pytest.approx([0.1, 0.05, None])
    assert tree["layout"]["xaxis"]["title"]["text"] == "points"


def test_names_make_categories_and_logarithms_make_log_axes() -> None:
    tree = panel_plot(panel(BARS))
    assert tree["data"][0]["type"] == "bar" and tree["layout"]["xaxis"]["type"] == "category"
    assert panel_plot(panel(LINE, log=True))["layout"]["xaxis"]["type"] == "log"
    assert panel_plot(panel(LINE, log=True))["layout"]["yaxis"]["type"] == "log"


def test_an_axis_begins_at_zero_unless_told_otherwise() -> None:
    high = panel(Series("Q_nor", [1, 2], [0.98, 0.99]))
    assert panel_plot(high)["layout"]["yaxis"]["rangemode"] == "tozero"
    own = high._replace(from_zero=False)
    assert "rangemode" not in panel_plot(own)["layout"]["yaxis"]
    steps = [np.argwhere((pixels(Chart("c", "C", [of])) < 0.5).any(axis=2)) for of in (high, own)]
    assert len(steps[0]) != len(steps[1])


def test_curves_that_all_panels_share_have_one_legend_below_them() -> None:
    other = LINE._replace(label="vertices")
    plain, shared = (pixels(Chart("c", "C", [panel(*series)] * 2)) for series in ([LINE], [LINE, other]))
    foot = shared.shape[0] - plain.shape[0]
    assert foot > 10 and colored(shared[-foot:], COLORS[0]) > 10 and colored(shared[-foot:], COLORS[1]) > 10
    own = pixels(Chart("c", "C", [panel(LINE, other), panel(LINE, other._replace(label="contours too"))]))
    assert own.shape == plain.shape


@pytest.mark.parametrize("values", [[2e-6, 7e-6], [3.0, 40.0], [9.0, 11.0]])
def test_logarithmic_axes_show_two_powers_of_ten(values: list[float]) -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1], values)
    axes.set_yscale("log")
    whole_decades(axes)
    low, high = axes.get_ylim()
    assert low <= min(values) and high >= max(values)
    assert np.floor(np.log10(high) + 1e-9) - np.ceil(np.log10(low) - 1e-9) >= 1
