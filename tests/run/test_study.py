"""A study end to end, small: same bytes however it is cut, killed and resumed; equal counts; missing points."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars
import pytest

from jaxmodel.control_points import Contours, select
from jaxmodel.register import register
from jaxmodel.register.basin import truth_errors
from jaxmodel.register.starts import plausible_starts
from jaxmodel.run.chapter2.study_rows import has_points
from jaxmodel.run.cli import execute
from jaxmodel.run.config import ObjectScans, PlausibleStarts
from jaxmodel.run.convergence_table import poses
from jaxmodel.run.pairs import load_pairs, source_extent
from jaxmodel.scan.sensor import Sensor
from tests.run.conftest import small_study

pytestmark = pytest.mark.xdist_group("study")
TREE = small_study("cylinder", traced=1)


@pytest.fixture(scope="module")
def unbroken(run_study: Callable[..., Path]) -> Path:
    return run_study(TREE)


def test_everything_promised_is_in_the_folder(unbroken: Path) -> None:
    found = {str(path.relative_to(unbroken)) for path in unbroken.rglob("*") if path.is_file()}
    figures = {"figures/iterations.png", "figures/block_steps-0.png", "figures/torso-1.png"}
    files = {".lock", "manifest.json", "results.parquet", "iterations.parquet", "summary.json", "report.html"}
    assert found == files | figures
    assert set(json.loads((unbroken / "summary.json").read_text())["figures"]) == figures


def test_kinds_of_a_trial_share_starts_and_numbers_of_points(unbroken: Path) -> None:
    rows = polars.read_parquet(unbroken / "results.parquet")
    assert len(rows) == 2 * 2 * 2 * 4  # objects, turns, kinds, starts
    contours, vertices = (
        rows.filter(polars.col("control_points") == kind).sort("trial", "start") for kind in ("contours", "vertices")
    )
    assert contours.select("trial", "pair", "start").equals(vertices.select("trial", "pair", "start"))
    for view in ("points_target", "points_source"):
        first, second = contours[view].to_numpy(), vertices[view].to_numpy()
        assert (np.abs(first - second) <= 0.05 * np.maximum(first, second)).all() and (first <= 120).all()
    summary = json.loads((unbroken / "summary.json").read_text())
    assert summary["unequal"] == [] == summary["missing"] and summary["registrations"] == len(rows)


def test_rows_are_what_single_registrations_give(unbroken: Path) -> None:
    """The first start of the first trial by hand: same scan, same points, same pose."""
    scans = ObjectScans(("block_steps",), views_deg=(0.0, 20.0), turns_deg=(0.0, 90.0), sensor=Sensor(80, 80))
    pair = load_pairs(scans, 0)[0]
    options = Contours(count=120, labels=("crease", "depth", "border"))
    target, source = (select(scan, options) for scan in (pair.target, pair.source))
    assert pair.T_target_source is not None
    wanted, (centroid, size) = PlausibleStarts(), source_extent(pair)
    start = plausible_starts(pair.T_target_source, centroid, 1, 0, 10.0, 0.05 * size, wanted.most_deg)[0]
    alone = register(target, source, start)
    row = polars.read_parquet(unbroken / "results.parquet")[:1]
    np.testing.assert_allclose(poses(row)[0], alone.T_target_source, atol=1e-5)
    assert (row["pair"][0], row["control_points"][0]) == ("block_steps000-020", "contours")
    assert row["steps"][0] == alone.steps
    errors = truth_errors(alone.T_target_source[None], pair.T_target_source, centroid)
    assert row["rotation_error_deg"][0] == pytest.approx(errors.rotation_deg[0], abs=1e-3)
    assert row["translation_error_of_size"][0] == pytest.approx(errors.translation[0] / size, abs=1e-5)


def test_traces_begin_at_the_start_and_end_where_the_rows_do(unbroken: Path) -> None:
    rows = polars.read_parquet(unbroken / "results.parquet").filter(polars.col("start") == 0)
    traces = polars.read_parquet(unbroken / "iterations.parquet")
    ends = traces.group_by("trial", "control_points").agg(
        polars.col("error").last(), polars.col("iteration"), polars.col("rotation_error_deg").first().alias("begins")
    )
    assert len(ends) == len(rows)
    both = rows.join(ends, on=["trial", "control_points"]).sort("trial")
    assert all(numbers.to_list() == [*range(1, len(numbers) + 1)] for numbers in both["iteration"])
    np.testing.assert_allclose(both["error"], both["error_right"], rtol=0.1)  # other kernels: the last bits differ
    begins = both["begins"].to_numpy().reshape(-1, 2)
    np.testing.assert_allclose(begins[:, 0], begins[:, 1], rtol=1e-4)  # both kinds from the same pose


def test_other_chunks_and_order_are_the_same_bytes(unbroken: Path, run_study: Callable[..., Path]) -> None:
    other = run_study(TREE, "--engine.chunk", "3", "--engine.order", "shuffled")
    for name in ("results.parquet", "iterations.parquet"):
        assert (other / name).read_bytes() == (unbroken / name).read_bytes()


@pytest.mark.slow
def test_killed_and_resumed_is_the_same_bytes(
    unbroken: Path, start: Callable[..., subprocess.Popen[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config, parts = tmp_path / "study.yaml", tmp_path / "out" / "parts"
    config.write_text(json.dumps(TREE))
    running = start("run", str(config), "--out", "out")
    while running.poll() is None and len(list(parts.glob("rows*.parquet"))) < 3:
        time.sleep(0.002)
    os.kill(running.pid, signal.SIGKILL)
    running.communicate()
    assert not (tmp_path / "out" / "summary.json").exists() and list(parts.glob("*.parquet"))
    words = ["run", str(config), "--resume", str(tmp_path / "out")]
    assert execute([*words, "--seed", "5"]) == 2
    assert "seed was 0 and is 5 now" in capsys.readouterr().err
    assert execute(words) == 0
    for name in ("results.parquet", "iterations.parquet"):
        assert (tmp_path / "out" / name).read_bytes() == (unbroken / name).read_bytes()
    assert not parts.exists()


def test_report_is_redrawn_from_the_folder_alone(unbroken: Path) -> None:
    paths = [*(unbroken / "figures").iterdir(), unbroken / "report.html"]
    before = [path.read_bytes() for path in paths]
    for path in paths:
        path.unlink()
    assert execute(["report", str(unbroken)]) == 0
    assert [path.read_bytes() for path in paths] == before


def test_an_object_without_contours_counts_as_not_converged_and_is_named(run_study: Callable[..., Path]) -> None:
    creases = [{"kind": "contours", "labels": ["crease"]}, {"kind": "vertices"}]
    tree = small_study("global_table")
    tree["groups"] = [{**tree["groups"][1], "control_points": creases}]  # smooth: no crease
    out = run_study(tree)
    rows = polars.read_parquet(out / "results.parquet")
    lost = rows.filter(polars.col("control_points") == "contours")
    assert not lost["right"].any() and set(lost["outcome"]) == {"no_control_points"}
    assert not has_points(lost) and np.isinf(lost["rotation_error_deg"].to_numpy()).all()
    found = rows.filter(polars.col("control_points") == "vertices")
    assert (np.abs(found["points_target"].to_numpy() - 120) <= 6).all()  # nobody to be equal to: as asked
    summary = json.loads((out / "summary.json").read_text())
    assert len(summary["missing"]) == 2 and "no crease contour" in summary["missing"][0]
    compared = summary["comparison"]["free_form"]
    assert compared["figures"]["rate"]["contours"]["value"] == 0 and compared["both_right"] == 0
    assert compared["figures"]["steps"]["contours"]["value"] is None


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"groups": []}, "groups is empty"),
        ({"counts": [2]}, "counts holds 2, expected at least 3"),
        ({"draws": 0}, "draws is 0"),
        ({"resamples": 3}, "resamples is 3"),
        ({"compared": ["contours", "subsample"]}, "compared names 'subsample', expected one of: contours, vertices"),
        ({"starts": {"spread_deg": 50, "most_deg": 40}}, "most_deg is 40"),
        ({"starts": {"spread": 5}}, "starts.spread: unknown key, did you mean 'spread_deg'?"),
        ({"method": "thesis_2004"}, "unknown method 'thesis_2004'"),
    ],
)
def test_bad_values_are_refused(
    refused: Callable[..., str], tmp_path: Path, changes: dict[str, object], fault: str
) -> None:
    (tmp_path / "study.yaml").write_text(json.dumps(small_study("cylinder", **changes)))
    assert fault in refused("run", "study.yaml", "--out", "out")


def test_scans_without_truth_or_grid_are_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / f"{name}.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n")
    scans = {"kind": "files", "target": str(tmp_path / "a.xyz"), "source": str(tmp_path / "b.xyz")}
    tree = small_study("cylinder")
    tree["groups"] = [{**tree["groups"][0], "scans": scans}]
    (tmp_path / "study.yaml").write_text(json.dumps(tree))
    assert "a-b: a study needs the true pose" in refused("run", "study.yaml", "--out", "out")
    (tmp_path / "truth.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    scans["truth"] = str(tmp_path / "truth.txt")
    (tmp_path / "study.yaml").write_text(json.dumps(tree))
    assert "the kind contours needs range images" in refused("run", "study.yaml", "--out", "out")
