"""The report is one file: complete, small enough, and asking nothing of the network."""

import json
import re

import numpy as np
import pytest

from jaxmodel.view.charts import Chart, Panel, Picture, Series
from jaxmodel.view.figures import IterationCurve, SweepCurve
from jaxmodel.view.report import Table, render_report
from jaxmodel.view.report_plots import PairView, pair_plots


def view(name: str = "boulder", starts: int = 200, truth: bool = True, points: int = 2500) -> PairView:
    draw = np.random.default_rng(0)
    directions = draw.normal(size=(starts, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    good = draw.random(starts) < 0.2
    error = draw.random(starts)
    error[0] = np.nan
    curve = SweepCurve("subsample", error, good, draw.random(starts) * 180 if truth else None)
    trace = IterationCurve("subsample", np.linspace(1, 0, 20), np.linspace(0, 1, 20), np.repeat([0, 1], 10))
    cloud = draw.normal(size=(points, 3)).astype(np.float32)
    return PairView(name, cloud, cloud + 1.0, cloud + 0.1, directions, [curve], [trace], "subsample")


@pytest.fixture(scope="module")
def page() -> str:
    tables = [Table("Published and ours", ("what", "ours"), [("free-form <b>", "15 %")])]
    return render_report("Convergence", {"seed": "0"}, tables, [view(f"pair {i}") for i in range(12)], "a note")


def test_nothing_is_loaded_from_elsewhere(page: str) -> None:
    outside = re.sub(r"<script>.*?</script>", "", page, flags=re.S)
    assert not re.search(r"https?:|src\s*=|@import|url\(", outside)
    assert re.findall(r"<link[^>]*>", outside) == ['<link rel="icon" href="data:,">']


def test_the_plotting_library_is_inside_once_and_whole(page: str) -> None:
    assert page.count("plotly.js v") == 1
    assert page.count("<script>") == page.count("</script>") - 1 == 2
    assert "{{" not in re.sub(r"<script.*?</script>", "", page, flags=re.S)


def test_plots_are_standard_json_with_a_box_each(page: str) -> None:
    found = re.search(r'<script id="plots" type="application/json">(.*?)</script>', page, re.S)
    assert found is not None
    plots = json.loads(found.group(1))
    assert len(plots) == 12 * 5
    assert all(f'id="{name}"' in page for name in plots)
    assert all(plot["data"] and plot["layout"]["title"]["text"] for plot in plots.values())


def test_text_is_escaped_and_present(page: str) -> None:
    assert "free-form &lt;b&gt;" in page and "free-form <b>" not in page
    for word in ("Published and ours", "a note", "seed", "pair 11"):
        assert word in page


def test_twelve_pairs_stay_under_ten_megabytes(page: str) -> None:
    assert len(page.encode()) < 10_000_000


def test_before_and_after_are_where_the_motion_put_them() -> None:
    pair = view()
    data = pair_plots(pair)["scans"]["data"]
    for trace, points in zip(data, (pair.target, pair.before, pair.after), strict=True):
        assert np.allclose(np.stack([trace[axis] for axis in "xyz"], 1), points, rtol=1e-4)


def test_without_truth_there_is_no_plot_of_it() -> None:
    assert "truth" in pair_plots(view()) and "truth" not in pair_plots(view(truth=False))


def test_many_starts_are_thinned() -> None:
    pair = view(starts=20_000)
    assert (
        max(len(trace["x"]) for plot in ("sphere", "sorted", "truth") for trace in pair_plots(pair)[plot]["data"])
        <= 3000
    )


def test_charts_and_pictures_are_sections_too() -> None:
    panels = [Panel(f"panel {i}", "x", "y", [Series("a", [1, 2], [3, 4])]) for i in range(2)]
    page = render_report("t", {}, [], [view(), Chart("c", "a chart", panels), Picture("a <picture>", b"\x89PNG")])
    found = re.search(r'<script id="plots" type="application/json">(.*?)</script>', page, re.S)
    assert found is not None
    plots = json.loads(found.group(1))
    assert [name for name in plots if name.startswith("chart")] == ["chart1-0", "chart1-1"]
    assert plots["chart1-1"]["layout"]["title"]["text"] == "panel 1"
    assert all(f'id="{name}"' in page for name in plots)
    assert "a chart" in page and "a &lt;picture&gt;" in page and 'src="data:image/png;base64,iVBORw==' in page
