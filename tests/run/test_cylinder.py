"""Contour labels: two kinds of contours are told apart and compared at equal numbers of points."""

import json
from collections.abc import Callable
from pathlib import Path

import polars
import pytest

from jaxmodel.run.chapter2.cylinder import tables
from tests.run.conftest import small_study

pytestmark = pytest.mark.xdist_group("study")
ALL = ["crease", "depth", "border"]


@pytest.fixture(scope="module")
def out(run_study: Callable[..., Path]) -> Path:
    tree = small_study("cylinder", compared=["contours", "vertices"])
    kinds = [{"kind": "contours", "labels": ["crease"]}, {"kind": "contours", "labels": ALL}, {"kind": "vertices"}]
    tree["groups"] = [{**tree["groups"][0], "control_points": kinds}]
    return run_study(tree)


def test_the_first_kind_is_compared_with_every_other(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    creases, everything = "contours crease", "contours crease+depth+border"
    assert [compared["kinds"] for compared in summary["comparisons"]] == [
        [creases, everything],
        [creases, "vertices"],
    ]
    rows = polars.read_parquet(out / "results.parquet")
    assert rows["control_points"].unique().sort().to_list() == [creases, everything, "vertices"]
    points = rows.group_by("trial").agg(
        polars.col("points_target").min().alias("least"), polars.col("points_target").max().alias("most")
    )
    assert ((points["most"] - points["least"]) <= 0.05 * points["most"]).all() and summary["unequal"] == []


def test_the_last_table_says_what_the_thesis_claims(out: Path) -> None:
    table = tables(json.loads((out / "summary.json").read_text()), "the command")[-1]
    assert len(table.rows) == 2 and all(row[1].startswith("Fig. 2.47") for row in table.rows)
