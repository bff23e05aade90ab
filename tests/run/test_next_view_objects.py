"""The experiment ``next_view_objects`` and ``jaxmodel plan`` in small: curves, baselines, resume, report, bad input."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
import trimesh
import yaml

from jaxmodel.errors import RunError
from jaxmodel.run.cli import execute
from jaxmodel.run.planning import objects_study
from jaxmodel.run.planning.object_scene import SceneOptions, object_scene
from jaxmodel.run.planning.objects import planning_object

SMALL: dict[str, Any] = {
    "experiment": "next_view_objects",
    "objects": ["valve"],
    "planners": ["utility", "random", "uniform_free"],
    "registered": ["area_factor"],
    "noises": [0.002],
    "scene": {"pixels": 64, "cells": 32, "samples": 1000, "reaching": 60},
    "loop": {"views": 4},
    "search": {"views": 150, "spiral": 8, "rays": 256, "best": 2, "rounds": 1},
}


def table(folder: Path) -> polars.DataFrame:
    return polars.read_parquet(folder / "results.parquet")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("next_view_objects")
    (place / "small.yaml").write_text(yaml.safe_dump(SMALL))
    assert execute(["run", str(place / "small.yaml"), "--out", str(place / "run")]) == 0
    return place


def test_every_run_sees_more_view_by_view(folder: Path) -> None:
    summary = json.loads((folder / "run" / "summary.json").read_text())
    runs = {(run["planner"], run["registered"]): run for run in summary["runs"]}
    assert set(runs) == {("utility", False), ("random", False), ("uniform_free", False), ("area_factor", True)}
    for run in runs.values():
        curve = np.array(run["coverage"])
        assert (np.diff(curve) >= 0).all() and 0 < curve[0] < curve[-1] <= 1
    assert runs["utility", False]["coverage"][-1] > 0.7
    assert runs["utility", False]["coverage"][-1] > runs["random", False]["coverage"][-1]


def test_views_are_placed_from_where_they_start_or_left_out(folder: Path) -> None:
    views = table(folder / "run").filter(polars.col("registered"))
    tried = views.filter(polars.col("view") > 0)
    assert tried["start_deg"].to_numpy() == pytest.approx(2.0, abs=1e-6)
    placed = tried.filter(polars.col("placed"))
    assert len(placed) >= 2 and (placed["error_deg"] < 0.5 * placed["start_deg"]).all()
    left_out = np.flatnonzero(~views["placed"].to_numpy())
    curve = views["coverage"].to_numpy()
    np.testing.assert_array_equal(curve[left_out], curve[left_out - 1])


def test_planners_held_to_an_overlap_keep_it(folder: Path) -> None:
    rows = table(folder / "run").filter(polars.col("view") > 0)
    assert (rows.filter(~polars.col("planner").str.ends_with("_free"))["overlap"] >= 0.3).all()
    poses = rows.select([f"T_{i}{j}" for i in range(3) for j in range(4)]).to_numpy().reshape(-1, 3, 4)
    np.testing.assert_allclose(
        poses[:, :, :3] @ poses[:, :, :3].transpose(0, 2, 1), np.eye(3)[None].repeat(len(poses), 0), atol=1e-9
    )


def test_the_report_shows_planners_curves_and_the_object(folder: Path) -> None:
    page = (folder / "run" / "report.html").read_text()
    assert "area factor, noise 0.2 %, registered" in page and "uniform without overlap" in page
    for name in ("coverage", "coverage-000", "object-000"):
        assert (folder / "run" / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    before = (folder / "run" / "figures" / "coverage.png").read_bytes()
    assert execute(["report", str(folder / "run")]) == 0
    assert (folder / "run" / "figures" / "coverage.png").read_bytes() == before


def test_a_stopped_study_goes_on_to_the_same_bytes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = objects_study.ObjectsStudy._run
    calls: list[str] = []

    def stops(self: Any, *words: Any) -> polars.DataFrame:
        calls.append(words[4].planner)
        if len(calls) == 3:
            raise RunError("the power went out")
        return run(self, *words)

    monkeypatch.setattr(objects_study.ObjectsStudy, "_run", stops)
    assert execute(["run", str(folder / "small.yaml"), "--out", str(folder / "again")]) == 1
    monkeypatch.setattr(objects_study.ObjectsStudy, "_run", run)
    assert execute(["run", str(folder / "small.yaml"), "--resume", str(folder / "again")]) == 0
    assert (folder / "again" / "results.parquet").read_bytes() == (folder / "run" / "results.parquet").read_bytes()


def test_plan_writes_the_curve_and_the_poses(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = trimesh.creation.icosphere(3, 40.0)
    mesh.export(folder / "ball.ply")
    words = ["plan", str(folder / "ball.ply"), "--views", "3", "--pixels", "64", "--cells", "24", "--json"]
    capsys.readouterr()
    assert execute([*words, "--out", str(folder / "plan")]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    summary = json.loads((folder / "plan" / "summary.json").read_text())
    assert told["summary"]["coverage"] == summary["coverage"]
    assert len(summary["coverage"]) == len(json.loads((folder / "plan" / "poses.json").read_text())) == 3
    # millimetres: the sensor stands 1.6 diameters away from the middle
    poses = np.array(list(json.loads((folder / "plan" / "poses.json").read_text()).values()))
    assert np.linalg.norm(poses[:, :3, 3], axis=1) == pytest.approx(1.6 * 80, rel=1e-3)
    # one view sees the cap of a ball up to the grazing limit
    assert summary["coverage"][0] == pytest.approx(0.3, abs=0.07)


def test_an_open_mesh_is_planned_and_noted(folder: Path) -> None:
    mesh = trimesh.creation.icosphere(3, 1.0)
    mesh.update_faces(mesh.triangles_center[:, 2] < 0.5)
    mesh.export(folder / "bowl.ply")
    words = ["plan", str(folder / "bowl.ply"), "--views", "1", "--pixels", "64", "--cells", "24"]
    assert execute([*words, "--out", str(folder / "bowl")]) == 0
    assert not next(iter(json.loads((folder / "bowl" / "summary.json").read_text())["objects"].values()))["watertight"]
    assert "the mesh is open" in (folder / "bowl" / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing"], "no object|unknown mesh extension"),
        (["gourd", "--distance", "0.2"], "sensor is inside the object"),
        (["gourd", "--cells", "2"], "cells is 2"),
        (["gourd", "--lowest", "95"], "lowest_deg is 95"),
        (["gourd", "--overlap", "1.0"], "minimum_overlap"),
        (["gourd", "--views", "0"], "views"),
        (["gourd", "--noise", "-0.1"], "noises names -0.1"),
        (["gourd", "--field-of-view", "180"], "field_of_view_deg is 180"),
    ],
)
def test_bad_words_are_refused(refused: Callable[..., str], words: list[str], message: str) -> None:
    assert re.search(message, refused("plan", *words, "--out", "run"))


def test_ranges_that_cross_or_see_nothing_are_refused() -> None:
    with pytest.raises(ValueError, match=r"nearest is 3\.0, expected less than farthest, 2\.0"):
        SceneOptions(nearest=3.0, farthest=2.0)
    mesh = planning_object("gourd").mesh
    with pytest.raises(Exception, match="no view of the observation sphere sees any of it"):
        object_scene("gourd", mesh, SceneOptions(farthest=0.5, samples=200, reaching=10))
