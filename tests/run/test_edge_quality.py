"""The experiment ``edges``: scores of every view, an unbroken and a resumed run alike, bad configurations refused."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars
import pytest
import yaml

from jaxmodel.io.results import RunDir
from jaxmodel.run.chapter2.edge_quality import draw, prepare, tables
from jaxmodel.run.chapter2.edge_quality_report import ASKED
from jaxmodel.run.cli import execute
from jaxmodel.run.registry import load_experiment

SMALL = {
    "experiment": "edges",
    "solids": ["box", "cylinder"],
    "smooth": ["ball"],
    "noises": [0.0, 0.002, 0.01],
    "views": 2,
    "sensor": {"width": 100, "height": 100},
}


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("edges")
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    assert execute(["run", str(folder / "small.yaml"), "--out", str(folder / "run")]) == 0
    return folder / "run"


def test_every_view_is_scored_at_every_noise(out: Path) -> None:
    rows = polars.read_parquet(out / "results.parquet")
    assert len(rows) == (2 * 2 + 1) * 2 * 3  # solids with and without a wall, views, noises
    assert not (out / "parts").exists()
    of_box = rows.filter((polars.col("solid") == "box") & (polars.col("noise") == 0.0))
    assert (of_box["precision"] >= 0.95).all() and (of_box["recall"] >= 0.9).all()
    assert (rows.filter(polars.col("smooth"))["creases"] == 0).all()


def test_the_summary_holds_mean_and_least_of_the_rows(out: Path) -> None:
    rows = polars.read_parquet(out / "results.parquet").filter(polars.col("solid") == "cylinder")
    summary = json.loads((out / "summary.json").read_text())
    for of in summary["scores"]:
        if of["solid"] == "cylinder":
            values = rows.filter(polars.col("noise") == of["noise"])["recall"].to_numpy()
            assert of["recall"]["least"] == pytest.approx(np.nanmin(values))
            assert of["recall"]["mean"] == pytest.approx(np.nanmean(values))


def test_what_is_asked_stands_beside_the_least_of_all_views(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    table = tables(summary, "the command")[-1]
    assert len(table.rows) == sum(len(asked.least) for asked in ASKED) + 1
    least = min(of["precision"]["least"] for of in summary["scores"] if of["noise"] <= 0.002)
    assert table.rows[0][1:] == (">= 95 %", f"{100 * least:.1f} %")
    assert (out / "figures" / "edges.png").read_bytes().startswith(b"\x89PNG")
    assert "Asked | ours" in (out / "report.html").read_text()


def test_a_resumed_run_is_the_unbroken_one(out: Path, tmp_path: Path) -> None:
    from jaxmodel.run.console import Progress
    from jaxmodel.run.provenance import manifest

    _, config = load_experiment(SMALL, "small.yaml")
    broken = prepare(config)
    about = manifest("edges", broken.resolved, {}, "a command")
    with RunDir.create(tmp_path / "run", about) as folder:
        folder.write_part("view000", 1, broken._rows(broken.subjects[0], 1))
        broken.execute(folder, Progress())
    assert (tmp_path / "run" / "results.parquet").read_bytes() == (out / "results.parquet").read_bytes()


def test_it_is_drawn_again_from_the_folder(out: Path) -> None:
    (out / "figures" / "edges.png").unlink()
    with RunDir.resume(out) as folder:
        assert draw(folder, json.loads((out / "summary.json").read_text())) == ["figures/edges.png"]
    assert (out / "figures" / "edges.png").is_file()


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("solids", "[bx]", "bx"),
        ("solids", "[]", "solids"),
        ("noises", "[-0.1]", "noises"),
        ("noises", "[.nan]", "noises"),
        ("views", "0", "views"),
        ("seed", "-1", "seed"),
        ("sensor", "{width: 0}", "width"),
    ],
)
def test_bad_configurations_are_refused(refused: Callable[..., str], key: str, value: str, said: str) -> None:
    assert said in refused("run", "configs/experiments/edges.yaml", f"--{key}", value, "--out", "out")
