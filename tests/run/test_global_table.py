"""The global table: counts are those of the rows, the published numbers are the thesis's."""

import json
from collections.abc import Callable
from pathlib import Path

import polars
import pytest

from jaxmodel.run.chapter2.global_table import tables
from jaxmodel.run.published import published_table
from tests.run.conftest import small_study

pytestmark = pytest.mark.xdist_group("study")


@pytest.fixture(scope="module")
def out(run_study: Callable[..., Path]) -> Path:
    return run_study(small_study("global_table", counts=[120, 60]))


def test_every_object_is_counted_as_the_rows_say(out: Path) -> None:
    summary, rows = json.loads((out / "summary.json").read_text()), polars.read_parquet(out / "results.parquet")
    assert [entry["subject"] for entry in summary["objects"]] == ["block_steps", "torso"]
    for entry in summary["objects"]:
        for kind, of in entry["kinds"].items():
            mine = rows.filter((polars.col("subject") == entry["subject"]) & (polars.col("control_points") == kind))
            right = mine.filter("right")
            assert (of["tests"], of["resolutions"], of["pairs"]) == (16, 2, 2) == (len(mine), 2, 2)
            assert of["not_converged"] == len(mine) - len(right)
            if len(right):
                assert of["rotation_error_deg"] == pytest.approx(right["rotation_error_deg"].mean())


def test_the_table_sets_ours_beside_the_thesis(out: Path) -> None:
    table = tables(json.loads((out / "summary.json").read_text()), "the command")[-1]
    assert "the command" in table.title and all(len(row) == len(table.columns) for row in table.rows)
    block = next(row for row in table.rows if row[0].startswith("block_steps") and row[2] == "vertices")
    assert block[1] == "BLOCK2" and block[-1] == "10, 4, 2.7862"


def test_the_published_table_has_the_theses_sums() -> None:
    """Table 2.4: 105 tests; in all 11 failures of the mesh and 17 of the contours."""
    objects = published_table("global_table")["objects"].values()
    assert len(objects) == 8 and sum(of["tests"] for of in objects) == 105
    assert sum(of["not_converged"]["vertices"] for of in objects) == 11
    assert sum(of["not_converged"]["contours"] for of in objects) == 17
