"""The experiment ``next_view_arm`` in small: views in reach, a base that moves, resume, report, bad input."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
import yaml

from jaxmodel.errors import InputError
from jaxmodel.plan.arm_check import check_reached
from jaxmodel.run.cli import execute
from jaxmodel.run.planning import arm_study
from jaxmodel.run.planning.arm_scene import ArmOptions, arm_scene
from jaxmodel.run.planning.arm_study import Config, ReachOptions
from jaxmodel.run.planning.object_scene import SceneOptions

LOOKS = {"pixels": 64, "cells": 32, "samples": 500, "reaching": 60, "lowest_deg": 0.0}
SMALL: dict[str, Any] = {
    "experiment": "next_view_arm",
    "object": "valve",
    "scene": LOOKS,
    "reach": {"views": 60, "places": 3, "elevations": [45.0], "circle_views": 24},
    "loop": {"views": 6, "worth": 0.05},
    "search": {"views": 150, "spiral": 8, "rays": 256, "fine": 256, "best": 2, "rounds": 1},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("next_view_arm")
    (place / "small.yaml").write_text(yaml.safe_dump(SMALL))
    assert execute(["run", str(place / "small.yaml"), "--out", str(place / "run")]) == 0
    return place


def rows_of(folder: Path, bases: str) -> polars.DataFrame:
    return polars.read_parquet(folder / "run" / "results.parquet").filter(polars.col("bases") == bases)


def test_every_view_is_reached_within_the_limits(folder: Path) -> None:
    scene = arm_scene("valve", ArmOptions(), SceneOptions(**LOOKS))
    for bases in ("fixed", "moving"):
        rows = rows_of(folder, bases)
        assert len(rows) >= 3 and rows["within_limits"].all()
        for row in rows.iter_rows(named=True):
            c, s = np.cos(np.deg2rad(row["base_yaw_deg"])), np.sin(np.deg2rad(row["base_yaw_deg"]))
            base = np.eye(4)
            base[:2, :2], base[:3, 3] = [[c, -s], [s, c]], (row["base_x"], row["base_y"], -0.3)
            T = np.array([row[f"T_{i}{j}"] for i in range(3) for j in range(4)] + [0, 0, 0, 1.0]).reshape(4, 4)
            check = check_reached(scene.arm.at(base), np.array([row[f"q{k}"] for k in range(1, 7)]), T)
            assert check.position_error < 1e-6 and check.rotation_error < 1e-6 and check.within_limits
            assert np.linalg.norm(T[:3, 3]) == pytest.approx(scene.object.sphere.radius, rel=1e-5)


def test_a_base_that_moves_sees_more_and_stands_where_it_may(folder: Path) -> None:
    summary = json.loads((folder / "run" / "summary.json").read_text())
    run = {of["bases"]: of for of in summary["runs"]}
    assert run["moving"]["coverage"][-1] > run["fixed"]["coverage"][-1] + 0.02
    assert len(run["moving"]["stations"]) >= 2 and len(run["fixed"]["stations"]) == 1
    for _, x, y, yaw in run["moving"]["stations"]:
        assert np.hypot(x, y) == pytest.approx(min((0.5, 0.6, 0.7), key=lambda d: abs(np.hypot(x, y) - d)), abs=1e-9)
        assert np.cos(np.deg2rad(yaw)) * x + np.sin(np.deg2rad(yaw)) * y < 0
    assert run["free"]["checked"] == 0 and run["moving"]["within_limits"] == run["moving"]["checked"]


def test_reach_and_report(folder: Path) -> None:
    radius = polars.read_parquet(folder / "run" / "reach_by_radius.parquet")
    assert ((radius["whole"] >= 0) & (radius["upper"] <= 1)).all()
    assert radius["upper"][0] > radius["upper"][-1]
    circles = polars.read_parquet(folder / "run" / "circles.parquet")
    assert len(circles) == 25 and (circles["stretch"] >= 0).any()
    page = (folder / "run" / "report.html").read_text()
    assert "best place of the object" in page and "within the joint limits" in page
    summary = json.loads((folder / "run" / "summary.json").read_text())
    assert all((folder / "run" / name).is_file() for name in summary["figures"]) and len(summary["figures"]) == 8


def test_an_interrupted_run_goes_on_to_the_same_bytes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stopped: list[str] = []
    whole = arm_study.ArmStudy._run

    def stops(self: Any, at: Any, progress: Any, bases: Any, number: int) -> Any:
        if bases == "moving" and not stopped:
            stopped.append(bases)
            raise KeyboardInterrupt
        return whole(self, at, progress, bases, number)

    monkeypatch.setattr(arm_study.ArmStudy, "_run", stops)
    out = str(folder / "again")
    assert execute(["run", str(folder / "small.yaml"), "--out", out]) == 130
    assert execute(["run", str(folder / "small.yaml"), "--resume", out]) == 0
    for name in ("results.parquet", "circles.parquet", "reach.parquet"):
        assert (folder / "again" / name).read_bytes() == (folder / "run" / name).read_bytes()


def test_an_arm_that_reaches_nothing_is_an_outcome(folder: Path) -> None:
    config = SMALL | {"bases": ["moving"], "arm": {"distance": 9.0, "stands": [8.0]}}
    (folder / "far.yaml").write_text(yaml.safe_dump(config))
    assert execute(["run", str(folder / "far.yaml"), "--out", str(folder / "far")]) == 0
    (run,) = json.loads((folder / "far" / "summary.json").read_text())["runs"]
    assert run["views"] == 0 and "reaches no view of the sphere" in run["ending"]


def test_the_command_takes_an_arm_and_a_calibrated_mount(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    X = np.eye(4)
    X[2, 3] = 0.1
    (folder / "calibration.json").write_text(json.dumps({"T_hand_camera": X.tolist(), "unit": "metre"}))
    words = ["plan", "gourd", "--arm", "gt6a_like", "--mount", str(folder / "calibration.json"), "--views", "2"]
    words += ["--cells", "32", "--pixels", "48", "--out", str(folder / "plan")]
    assert execute(words) == 0
    poses = json.loads((folder / "plan" / "poses.json").read_text())
    assert list(poses) == ["view000", "view001"] and len(poses["view000"]["joints"]) == 6
    assert "gourd with gt6a_like" in capsys.readouterr().out


def test_bad_input_is_one_sentence(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "broken.urdf").write_text("<robot/>")
    (folder / "mount.json").write_text(json.dumps({"T_hand_eye": np.eye(4).tolist()}))
    cases = [
        (["--arm", str(folder / "broken.urdf")], "broken.urdf holds no joint"),
        (["--arm", str(folder / "none.urdf")], "none.urdf"),
        (["--arm", "gt6a_like", "--mount", str(folder / "mount.json")], "expected the key 'T_hand_camera'"),
        (["--mount", str(folder / "mount.json")], "--mount needs --arm"),
        (["--arm", "gt6a_like", "--register"], "--register"),
    ]
    for words, told in cases:
        assert execute(["plan", "gourd", *words, "--out", str(folder / "bad")]) == 2
        error = capsys.readouterr().err
        assert told in error and not (folder / "bad").exists()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: ArmOptions(size=0.0), "size is 0.0"),
        (lambda: ArmOptions(stands=(0.5, -1.0)), "stands is"),
        (lambda: ArmOptions(rolls=0), "rolls is 0"),
        (lambda: ArmOptions(below=float("nan")), "finite lengths"),
        (lambda: ReachOptions(views=1), "views is 1"),
        (lambda: ReachOptions(elevations=(90.0,)), "elevations is"),
        (lambda: Config(bases=()), "bases must name at least one"),
        (lambda: Config(noise=0.5), "noise is 0.5"),
    ],
)
def test_bad_configurations_are_told(make: Any, told: str) -> None:
    with pytest.raises((ValueError, InputError), match=told):
        make()
