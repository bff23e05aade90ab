"""Overlap: views both ways, ranges that end before the first failure, published rows beside ours."""

import json
from collections.abc import Callable
from pathlib import Path

import polars
import pytest

from jaxmodel.run.chapter2.overlap import _range, tables
from jaxmodel.run.published import published_table
from tests.run.conftest import small_study

pytestmark = pytest.mark.xdist_group("study")


@pytest.fixture(scope="module")
def out(run_study: Callable[..., Path]) -> Path:
    tree = small_study("overlap", angles_deg=[20, 100])
    tree["groups"] = [{**tree["groups"][0], "stands_for": "VALVE"}]
    tree["groups"][0]["scans"]["turns_deg"] = [0]
    return run_study(tree)


def test_views_go_both_ways_round(out: Path) -> None:
    rows = polars.read_parquet(out / "results.parquet")
    assert rows["variant"].unique(maintain_order=True).to_list() == ["-100", "-20", "20", "100"]
    views = json.loads((out / "summary.json").read_text())["views"]
    near = [view for view in views if abs(view["angle_deg"]) == 20 and view["right"]]
    assert near and all(view["axis_error"]["value"] < 0.3 and view["angle_error_deg"]["value"] < 5 for view in near)
    assert all(view["shared"]["value"] > 0.1 for view in near)
    for view in views:
        of = rows.filter(
            (polars.col("variant") == f"{view['angle_deg']:g}") & (polars.col("control_points") == view["kind"])
        )
        assert view["right"] == of["right"].sum() and view["tests"] == len(of)


def test_published_views_stand_below_ours(out: Path) -> None:
    shown = tables(json.loads((out / "summary.json").read_text()), "the command")
    assert all(len(row) == len(table.columns) for table in shown for row in table.rows)
    assert sum(row[0].strip() == "VALVE" for row in shown[0].rows) == 4  # -20 and 20, both kinds: 100 is not printed
    assert shown[-1].rows[0][2] == "-80 to 80°"


def test_a_range_ends_before_the_first_failure() -> None:
    def view(angle: float, right: int, shared: float | None = 0.5) -> dict:
        return {"angle_deg": angle, "right": right, "tests": 10, "shared": {"value": shared}}

    views = [view(20, 10), view(40, 5, 0.2), view(60, 4, 0.1), view(80, 10, 0.05), view(-20, 0, None), view(-40, 10)]
    assert _range(views) == {"forward": 40, "backward": 0.0, "least_shared": 0.2}
    nothing = _range([view(20, 0, None), view(-20, 0, None)])
    assert (nothing["forward"], nothing["backward"]) == (0.0, 0.0) and nothing["least_shared"] != nothing[
        "least_shared"
    ]


def test_the_published_tables_are_whole() -> None:
    for of in published_table("overlap")["objects"].values():
        assert len(of["angles_deg"]) == 8 == len(set(of["angles_deg"]))
        for kind in ("contours", "vertices"):
            assert {len(column) for column in of[kind].values()} == {8}
            assert min(of[kind]["shared"]) >= 14.9  # "down to about 15 %"


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"angles_deg": []}, "angles_deg: expected at least one angle"),
        ({"angles_deg": [0]}, "each above 0 and below 180"),
        ({"angles_deg": [200]}, "each above 0 and below 180"),
    ],
)
def test_bad_angles_are_refused(
    refused: Callable[..., str], tmp_path: Path, changes: dict[str, object], fault: str
) -> None:
    (tmp_path / "study.yaml").write_text(json.dumps(small_study("overlap", **changes)))
    assert fault in refused("run", "study.yaml", "--out", "out")


def test_a_turntable_is_needed(refused: Callable[..., str], tmp_path: Path) -> None:
    tree = small_study("overlap")
    tree["groups"] = [{**tree["groups"][0], "scans": {"kind": "stanford_bunny"}}]
    (tmp_path / "study.yaml").write_text(json.dumps(tree))
    assert "a turntable is needed" in refused("run", "study.yaml", "--out", "out")
