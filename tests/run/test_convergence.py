"""The convergence experiment end to end, small: same bytes however it is cut, ordered, killed and resumed."""

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

from jaxmodel.run.cli import execute
from jaxmodel.run.convergence_table import POSE

pytestmark = pytest.mark.xdist_group("convergence")
SMALL = (
    "--scans.names", "[block_curved]", "--scans.sensor", "{width: 60, height: 60}",
    "--control_points", "[{kind: subsample, count: 200}, {kind: vertices, count: 200}]",
    "--starts.count", "60", "--claims.starts", "10", "--claims.permutations", "19",
    "--method", "{cells: 32, clusters: 10, max_iterations: 30}",
)  # fmt: skip


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run") / "out"
    assert execute(["run", "quickstart", *SMALL, "--engine.chunk", "20", "--out", str(out), "--json"]) == 0
    return out


def test_everything_promised_is_in_the_folder(unbroken: Path) -> None:
    found = {str(path.relative_to(unbroken)) for path in unbroken.rglob("*") if path.is_file()}
    figures = {f"figures/block_curved-{n}.png" for n in ("sorted-error", "error-and-truth", "sphere", "iterations")}
    files = {".lock", "manifest.json", "results.parquet", "summary.json", "scene.npz", "report.html"}
    assert found == files | figures


def test_rows_are_in_canonical_order_with_every_column(unbroken: Path) -> None:
    table = polars.read_parquet(unbroken / "results.parquet")
    assert len(table) == 120
    assert table["control_points"].to_list() == ["subsample"] * 60 + ["vertices"] * 60
    assert table["start"].to_list() == [*range(60), *range(60)]
    assert table.columns == [
        "pair", "control_points", "method", "start", *POSE, "error", "matched_fraction", "shared_rate", "steps",
        "switch_1", "switch_2", "increases", "outcome", "basin", "plateau", "rotation_error_deg", "quaternion_error",
        "translation_error", "right",
    ]  # fmt: skip
    assert not [name for name in table.columns if "second" in name or "time" in name]
    R = table.select([name for name in POSE if name[-1] != "3"]).to_numpy().reshape(-1, 3, 3)
    assert np.allclose(R @ np.swapaxes(R, 1, 2), np.eye(3), atol=1e-9)


def test_summary_counts_what_the_table_holds(unbroken: Path) -> None:
    table = polars.read_parquet(unbroken / "results.parquet")
    summary = json.loads((unbroken / "summary.json").read_text())
    for case in summary["cases"]:
        rows = table.filter(polars.col("control_points") == case["control_points"])
        assert case["success"]["count"] == rows["right"].sum() and case["success"]["total"] == 60
        assert sum(case["outcomes"].values()) == 60
        assert case["plateau"]["members"] == rows["plateau"].sum()
        assert case["best"]["error"] == rows["error"][case["best"]["start"]]
        moved = case["claims"]["translation"]
        assert moved["both"] + moved["only_without"] + moved["only_with"] + moved["neither"] == 10
    structured = next(row for row in summary["published"] if row["what"].startswith("structured"))
    assert structured["published"] == {"contours": 0.20, "vertices": 0.19}
    assert structured["ours"]["vertices"]["all_pairs"]["total"] == 60


def test_manifest_says_where_it_came_from(unbroken: Path) -> None:
    manifest = json.loads((unbroken / "manifest.json").read_text())
    assert manifest["config"]["engine"]["chunk"] == 20 and manifest["config"]["starts"]["count"] == 60
    method = manifest["config"]["method"]
    assert method["name"] == "inline" and method["cells"] == 32 and len(method["strategies"]) == 1
    assert {"jax", "numpy", "jaxmodel"} <= set(manifest["versions"]) and manifest["seed"] == 0
    assert manifest["command"].startswith("jaxmodel run quickstart")


def test_other_chunks_and_a_shuffled_order_are_the_same_bytes(
    unbroken: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("run", "quickstart", *SMALL, "--engine.chunk", "7", "--engine.order", "shuffled")
    code = execute([*words, "--out", str(tmp_path / "out"), "--json"])
    output, errors = capsys.readouterr()
    assert code == 0 and errors == ""
    assert (tmp_path / "out" / "results.parquet").read_bytes() == (unbroken / "results.parquet").read_bytes()
    last = json.loads(output.splitlines()[-1])
    assert last["status"] == "ok" and last["summary"]["cases"][0]["starts"] == 60
    for word in ("published", "ours", "20 %", "not run"):
        assert word in output


def test_killed_and_resumed_is_the_same_bytes(
    unbroken: Path, start: Callable[..., subprocess.Popen[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("run", "quickstart", *SMALL, "--engine.chunk", "20")
    out, parts = str(tmp_path / "out"), tmp_path / "out" / "parts"
    running = start(*words, "--out", "out")
    while running.poll() is None and len(list(parts.glob("case000-*.parquet"))) < 2:
        time.sleep(0.002)
    os.kill(running.pid, signal.SIGSTOP)  # alive and holding its folder, in the middle of its work
    assert running.poll() is None, running.communicate()
    assert execute([*words, "--resume", out]) == 2
    assert "another process is running in this folder" in capsys.readouterr().err
    running.kill()
    running.communicate()
    assert not (tmp_path / "out" / "summary.json").exists() and list(parts.glob("*.parquet"))
    assert execute([*words, "--seed", "5", "--resume", out]) == 2
    assert "seed was 0 and is 5 now" in capsys.readouterr().err
    assert execute([*words, "--resume", out]) == 0
    assert (tmp_path / "out" / "results.parquet").read_bytes() == (unbroken / "results.parquet").read_bytes()
    assert not parts.exists()


def test_report_is_redrawn_from_the_folder_alone(unbroken: Path) -> None:
    before = {path.name: path.read_bytes() for path in (unbroken / "figures").iterdir()}
    page = (unbroken / "report.html").read_bytes()
    for path in (unbroken / "figures").iterdir():
        path.unlink()
    (unbroken / "report.html").unlink()
    assert execute(["report", str(unbroken)]) == 0
    assert {path.name: path.read_bytes() for path in (unbroken / "figures").iterdir()} == before
    assert (unbroken / "report.html").read_bytes() == page and len(page) < 10_000_000
