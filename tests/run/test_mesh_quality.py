"""The experiment ``mesh_quality``: all methods on small clouds, the tables beside the thesis, resumed as unbroken."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
import yaml

from jaxmodel.io.meshes import load_mesh
from jaxmodel.io.results import RunDir
from jaxmodel.mesh.quality import quality
from jaxmodel.mesh.radii import cloud_scale
from jaxmodel.run.cli import execute
from jaxmodel.run.console import Progress
from jaxmodel.run.meshing.quality_study import _meshed, draw, prepare, tables
from jaxmodel.run.meshing.study_objects import Subject
from jaxmodel.run.registry import load_experiment

SMALL = {
    "experiment": "mesh_quality",
    "objects": [
        {"kind": "object", "name": "stone", "object": "boulder", "stands_for": "scurv", "count": 1500},
        {"kind": "pot", "name": "pot", "count": 1500},
    ],
    "methods": ["ball", "ball_thinned", "deformable_5", "marching_cubes"],
    "runs": 1,
    "sweep": ["stone"],
    "radii": [0.1, 1.0, 2.0],
    "passes": ["stone"],
}


def run(folder: Path, tree: dict[str, Any]) -> Path:
    (folder / "small.yaml").write_text(yaml.safe_dump(tree))
    assert execute(["run", str(folder / "small.yaml"), "--out", str(folder / "run")]) == 0
    return folder / "run"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("mesh_quality"), SMALL)


def by_method(out: Path, name: str) -> dict[str, dict[str, Any]]:
    rows = polars.read_parquet(out / "results.parquet").filter(polars.col("object") == name).to_dicts()
    return {row["method"]: row for row in rows}


def test_every_method_has_a_row_that_its_mesh_repeats(out: Path) -> None:
    stone = by_method(out, "stone")
    assert list(stone) == [*SMALL["methods"], "the true mesh"]
    assert "ball_thinned" not in by_method(out, "pot")  # the thesis has no number of vertices for it
    for method in SMALL["methods"]:
        measures = quality(load_mesh(out / "meshes" / f"stone-{method}.ply"))
        assert measures.triangles == stone[method]["triangles"] == sum(stone[method]["Q_equ_counts"])
        assert measures.Q_equ == pytest.approx(stone[method]["Q_equ"], abs=1e-6)
        assert stone[method]["truth_there"] < 0.5  # spacings
    assert stone["ball"]["points_95"] == pytest.approx(0.0, abs=1e-3)
    assert stone["deformable_5"]["border_length"] == 0 and stone["deformable_5"]["triangles"] == 5120
    assert not (out / "parts").exists()


def test_the_sweep_and_the_passes_are_kept(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    nothing, small, large = summary["sweep"]["stone"]
    assert nothing["triangles"] == 0 and nothing["Q_equ"] is None
    assert small["holes"] > large["holes"] and 0 < small["used"] <= large["used"] <= 1
    passes = summary["passes"]["stone"]
    assert [row["radius"] for row in passes[:4]] == pytest.approx([passes[0]["radius"] * f for f in (1, 1.4, 1.8, 4)])
    border = [row["border_length"] for row in passes[:4]]
    assert border == sorted(border, reverse=True)


def test_the_tables_stand_beside_the_thesis(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    shown = {table.title.split(":")[0]: table for table in tables(summary, "jaxmodel run x")}
    assert all(len(row) == len(table.columns) for table in shown.values() for row in table.rows)
    main = next(
        row for row in list(shown.values())[-1].rows if row[:2] == ("stone for scurv", "ball pivoting, all points")
    )
    assert main[2].startswith("5302 | ") and main[4].startswith("0.6905 | ") and main[6].startswith("256 | ")
    known = {row[0]: row[1:] for row in shown["The criteria on known shapes (Figs 3.13, 3.14)"].rows}
    assert known["Q_equ, right isosceles triangle"] == ("0.7174", "0.7174")
    ball, surface = by_method(out, "stone")["ball"], by_method(out, "stone")["deformable_5"]
    verdict = "reproduced" if ball["Q_equ"] > surface["Q_equ"] else "contradicted"
    assert all(
        row[-1].endswith(verdict) for row in shown["The ranking of Table 3.2, row by row"].rows if row[0] == "Q_equ"
    )
    passes = next(table for title, table in shown.items() if title.startswith("Passes of the ball"))
    assert tuple(passes.rows[-1][1:3]) == ("256.37", "10438")  # as summed up in the thesis's own table of passes


def test_a_resumed_run_gives_the_same_table(out: Path, tmp_path: Path) -> None:
    _, config = load_experiment(SMALL, "small.yaml")
    broken = prepare(config)
    about = json.loads((out / "manifest.json").read_text())
    with RunDir.create(tmp_path / "run", about) as folder:
        stone = broken.subjects[0]
        folder.write_part("object000", 2, _meshed(folder, stone, _spacing(stone), "deformable_5", 1))
        broken.execute(folder, Progress())
    assert (tmp_path / "run" / "results.parquet").read_bytes() == (out / "results.parquet").read_bytes()
    assert not (tmp_path / "run" / "parts").exists()


def _spacing(subject: Subject) -> float:
    return cloud_scale(subject.measured.points).spacing


def test_it_is_drawn_again_from_the_folder(out: Path) -> None:
    (out / "report.html").unlink()
    with RunDir.resume(out) as folder:
        written = draw(folder, folder.read_json("summary.json"))
    assert "figures/radius.png" in written and "figures/quality_stone.png" in written
    assert "mesh3d" in (out / "report.html").read_text()


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("runs", "0", "runs is 0"),
        ("sweep", "[nobody]", "sweep and passes name 'nobody'"),
        ("passes", "[pot]", "expected one that stands for scurv or halfhead"),
        ("radii", "[11.0]", "radii is [11.0]"),
        ("methods", "[]", "objects and methods"),
        ("objects", "[{kind: pot, name: pot, count: 5}]", "count is 5"),
    ],
)
def test_bad_configurations_are_refused(refused: Callable[..., str], key: str, value: str, said: str) -> None:
    assert said in refused("run", "configs/experiments/mesh_quality.yaml", f"--{key}", value, "--out", "out")


@pytest.mark.data
def test_the_cat_at_the_vertices_of_the_thesis(data_dir: Path, tmp_path: Path) -> None:
    cat = {"kind": "hoppe", "name": "cat", "file": "cat10.10000", "meshes": "cat10", "stands_for": "cat"}
    out = run(
        tmp_path, {**SMALL, "objects": [cat], "methods": ["ball_thinned", "deformable_5"], "sweep": [], "passes": []}
    )
    rows = by_method(out, "cat")
    ball, surface = rows["ball_thinned"], rows["deformable_5"]
    assert abs(ball["vertices"] - 2231) < 30
    assert ball["Q_equ"] > surface["Q_equ"] and ball["Q_nor"] > surface["Q_nor"]  # as in Table 3.2
    assert ball["points_mean"] < 0.2 < surface["points_mean"]
    assert (rows["Hoppe, phase 1"]["triangles"], rows["Hoppe, phase 2"]["triangles"]) == (6988, 627)
    assert np.isfinite(rows["Hoppe, phase 2"]["Q_nor"])
