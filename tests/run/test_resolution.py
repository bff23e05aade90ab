"""Resolution: the variants, the second step's starts, and Table 2.1 beside ours."""

import json
from collections.abc import Callable
from pathlib import Path

import polars
import pytest

from jaxmodel.run.chapter2.resolution import tables
from jaxmodel.run.published import published_table
from tests.run.conftest import small_study

pytestmark = pytest.mark.xdist_group("study")


@pytest.fixture(scope="module")
def out(run_study: Callable[..., Path]) -> Path:
    levels = {"combined": {"high": 120, "low": 60}, "two_steps": {"high": 120, "low": 40}}
    tree = small_study("resolution", counts=[120, 80], **levels)
    tree["groups"] = tree["groups"][:1]
    return run_study(tree)


def rows_of(out: Path, variant: str) -> polars.DataFrame:
    rows = polars.read_parquet(out / "results.parquet")
    return rows.filter(polars.col("variant") == variant).sort("pair", "control_points", "start")


def test_every_variant_has_its_numbers_of_points(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    asked = {
        "resolution 120": (120, 120), "resolution 80": (80, 80), "H-H": (120, 120), "L-L": (60, 60), "H-L": (120, 60),
        "fine alone": (120, 120), "coarse": (40, 40), "coarse, then fine": (120, 120),
    }  # fmt: skip
    assert list(dict.fromkeys(of["variant"] for of in summary["variants"])) == list(asked)
    for of in summary["variants"]:
        for view, count in zip(("target", "source"), asked[of["variant"]], strict=True):
            assert abs(of["points"][view] - count) <= max(2, 0.05 * count)
    assert summary["unequal"] == []


def test_the_second_step_goes_on_from_the_first(out: Path) -> None:
    """From a coarse result at the truth the fine registration has less to do than from the start itself."""
    coarse, after, alone = (rows_of(out, variant) for variant in ("coarse", "coarse, then fine", "fine alone"))
    good = coarse["right"].to_numpy()
    assert good.any()
    assert after["steps"].to_numpy()[good].mean() < alone["steps"].to_numpy()[good].mean()
    assert after["right"].to_numpy()[good].mean() >= alone["right"].to_numpy()[good].mean() - 0.1


def test_the_same_trial_gives_the_same_rows(out: Path) -> None:
    compared = ["pair", "control_points", "start", "error", "steps"]
    same = [rows_of(out, variant).select(compared) for variant in ("resolution 120", "H-H", "fine alone")]
    assert same[0].equals(same[1]) and same[0].equals(same[2])


def test_the_tables_fit_and_set_the_thesis_beside_ours(out: Path) -> None:
    shown = tables(json.loads((out / "summary.json").read_text()), "the command")
    assert all(len(row) == len(table.columns) for table in shown for row in table.rows)
    assert [row[1] for row in shown[1].rows] == ["500 x", "500 x"]
    first = shown[2].rows[0]
    assert first[0] == "120, contours" and first[1] == "3365 and 3851, 50, 37 %, 0.0001 then 4.6e-05"
    assert [row[0] for row in shown[2].rows] == [
        f"{n}, {kind}" for n in (120, 80) for kind in ("contours", "vertices", "better")
    ]


def test_the_published_table_agrees_with_its_own_comparison() -> None:
    """Table 2.1's last rows: the mesh always needs fewer iterations; the more precise kind of each resolution."""
    published = published_table("resolution")
    contours, vertices = published["contours"], published["vertices"]
    assert all(v <= c for c, v in zip(contours["iterations"], vertices["iterations"], strict=True))
    finest = ["c" if c < v else "v" for c, v in zip(contours["error"], vertices["error"], strict=True)]
    assert "".join(finest) == "cvvcvvcv"


def test_levels_must_differ(refused: Callable[..., str], tmp_path: Path) -> None:
    tree = small_study("resolution", combined={"high": 50, "low": 50})
    (tmp_path / "study.yaml").write_text(json.dumps(tree))
    assert "combined: low is 50 and high 50" in refused("run", "study.yaml", "--out", "out")
