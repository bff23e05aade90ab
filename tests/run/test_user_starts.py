"""Starts as by a user: the table says how they are drawn, and both ways of counting."""

import json
from collections.abc import Callable
from pathlib import Path

import polars
import pytest

from jaxmodel.run.chapter2.user_starts import tables
from tests.run.conftest import small_study

pytestmark = pytest.mark.xdist_group("study")


@pytest.fixture(scope="module")
def out(run_study: Callable[..., Path]) -> Path:
    return run_study(small_study("user_starts", starts={"count": 6, "spread_deg": 25, "shift_of_size": 0.1}))


def test_rates_are_those_of_the_rows_in_both_ways(out: Path) -> None:
    summary, rows = json.loads((out / "summary.json").read_text()), polars.read_parquet(out / "results.parquet")
    for family, compared in summary["comparison"].items():
        mine = rows.filter(polars.col("family") == family)
        right = {
            kind: mine.filter(polars.col("control_points") == kind).sort("trial", "start")["right"].to_numpy()
            for kind in ("contours", "vertices")
        }
        either = right["contours"] | right["vertices"]
        for kind, is_right in right.items():
            assert compared["figures"]["rate"][kind]["value"] == pytest.approx(is_right.mean())
            expected = is_right[either].mean() if either.any() else None
            assert compared["figures"]["rate_either"][kind]["value"] == pytest.approx(expected)


def test_classes_of_the_starts_angle_hold_every_registration(out: Path) -> None:
    summary, rows = json.loads((out / "summary.json").read_text()), polars.read_parquet(out / "results.parquet")
    assert sum(entry["rate"]["count"] for entry in summary["by_angle"]) == len(rows)
    assert all(entry["to_deg"] <= 90 for entry in summary["by_angle"])


def test_the_table_states_how_starts_are_drawn_and_what_was_published(out: Path) -> None:
    table = tables(json.loads((out / "summary.json").read_text()), "the command")[-1]
    assert "|N(0, 25°)|" in table.title and "at most 90°" in table.title and "10 % of the size" in table.title
    published = {(row[0], row[1]): row[2] for row in table.rows}
    assert published == {
        ("structured", "contours"): "95 %",
        ("structured", "vertices"): "85 %",
        ("free-form", "contours"): "76 %",
        ("free-form", "vertices"): "92 %",
    }
