"""Error along the iterations: tests draw count and start at random, the same for both kinds."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars
import pytest

from jaxmodel.run.chapter2.iterations import _arrival, tables
from tests.run.conftest import small_study

pytestmark = pytest.mark.xdist_group("study")


@pytest.fixture(scope="module")
def out(run_study: Callable[..., Path]) -> Path:
    tree = small_study("iterations", tests=3, counts=[120, 80, 40], starts={"count": 9, "spread_deg": 10})
    tree["groups"] = tree["groups"][:1]
    return run_study(tree)


def test_each_test_is_one_start_traced_with_both_kinds(out: Path) -> None:
    rows, traces = (polars.read_parquet(out / f"{name}.parquet") for name in ("results", "iterations"))
    assert len(rows) == 2 * 3 * 2 and rows["trial"].n_unique() == 6  # turns, tests, kinds
    assert rows.group_by("trial").agg(polars.col("asked").n_unique())["asked"].to_list() == [1] * 6
    assert rows.select("pair", "variant").n_unique() == 6  # no combination twice
    assert traces.select("trial", "control_points").n_unique() == 12
    begins = traces.filter(polars.col("iteration") == 1).sort("trial")["rotation_error_deg"].to_numpy().reshape(-1, 2)
    np.testing.assert_allclose(begins[:, 0], begins[:, 1], rtol=1e-4)


def test_every_pair_has_its_figure_and_row(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    assert summary["figures"] == [f"figures/block_steps{name}-iterations.png" for name in ("000-020", "090-110")]
    table = tables(summary, "the command")[-1]
    assert len(table.rows) == 4 and all(len(row) == len(table.columns) for row in table.rows)
    assert all(of["right"] <= of["tests"] == 3 for of in summary["pairs"])


def test_arrival_is_where_the_error_stays_close_to_its_end() -> None:
    assert _arrival(np.array([9.0, 5.0, 1.4, 1.0, 1.0])) == 3.0
    assert _arrival(np.array([9.0, 1.0, 5.0, 1.0])) == 4.0
    assert _arrival(np.array([1.0, 1.0])) == _arrival(np.array([3.0])) == 1.0


def test_no_test_or_too_many_are_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    for tests in (0, 5):
        (tmp_path / "study.yaml").write_text(json.dumps(small_study("iterations", tests=tests)))
        assert f"tests is {tests}, expected 1 to 4" in refused("run", "study.yaml", "--out", "out")
