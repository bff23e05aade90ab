"""The experiment ``next_view_environment`` in small: the cube by pan and tilt, two rooms, passes, resume, report."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
import yaml

from jaxmodel.run.cli import execute
from jaxmodel.run.planning.environment_study import Config
from jaxmodel.run.registry import load_experiment

SEARCH = {"views": 150, "spiral": 8, "rays": 256, "best": 2, "rounds": 1}
CUBE: dict[str, Any] = {
    "experiment": "next_view_environment",
    "environment": "cube",
    "planners": ["utility", "hill_climbing"],
    "voxels": [0.1],
    "place": {"pixels": 48, "samples": 1000},
    "loop": {"views": 4},
    "search": SEARCH,
}
ROOMS = CUBE | {
    "environment": "two_rooms",
    "planners": ["utility"],
    "voxels": [0.5, 0.25],
    "loop": {"views": 3, "stride": 2.0},
}


def made(place: Path, config: dict[str, Any]) -> Path:
    (place / "small.yaml").write_text(yaml.safe_dump(config))
    assert execute(["run", str(place / "small.yaml"), "--out", str(place / "run")]) == 0
    return place / "run"


@pytest.fixture(scope="module")
def cube(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("cube"), CUBE)


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("rooms"), ROOMS)


def test_in_the_cube_the_sensor_only_turns_and_sees_more(cube: Path) -> None:
    rows = polars.read_parquet(cube / "results.parquet")
    places = rows.select("T_03", "T_13", "T_23").to_numpy()
    np.testing.assert_array_equal(places, np.zeros_like(places))
    for (_,), of in rows.group_by("planner", maintain_order=True):
        assert len(of) == 4 and (np.diff(of["coverage"].to_numpy()) > 0).all()
        assert of["unknown"].is_sorted(descending=True)
    # from the middle, 60 degrees see a square of side tan 30 on one of six faces of area 1
    assert rows["coverage"][0] == pytest.approx(np.tan(np.pi / 6) ** 2 / 6, abs=0.01)


def test_the_field_of_the_cube_peaks_where_the_next_view_looks(cube: Path) -> None:
    field = polars.read_parquet(cube / "field.parquet")
    rows = polars.read_parquet(cube / "results.parquet").filter(polars.col("planner") == "utility")
    assert sorted(set(field["view"])) == [0, 1, 2, 3] and (cube / "figures" / "field.png").is_file()
    for number in range(3):
        of = field.filter(polars.col("view") == number)
        utility = of["utility"].to_numpy()
        azimuth, elevation = (np.deg2rad(of[name].to_numpy()) for name in ("azimuth_deg", "elevation_deg"))
        looks = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        taken = rows.filter(polars.col("view") == number + 1).select("T_02", "T_12", "T_22").to_numpy()[0]
        nearest = utility[int(np.argmax(taken @ looks))]
        assert nearest >= np.nanquantile(utility, 0.8) or np.isnan(nearest)
        assert np.isfinite(utility).any()


def test_in_the_rooms_it_stays_in_free_space_and_a_finer_pass_goes_on(rooms: Path) -> None:
    rows = polars.read_parquet(rooms / "results.parquet")
    assert rows["pass"].unique().sort().to_list() == [0, 1]
    assert (np.diff(rows["coverage"].to_numpy()) >= 0).all()
    moved = rows.slice(1)
    assert moved["T_23"].is_between(0.5, 2.0).all() and moved["T_13"].is_between(-3.0, 3.0).all()
    first_fine = rows.filter(polars.col("pass") == 1)
    assert first_fine["coverage"][0] > rows["coverage"][0]


def test_the_reports_say_published_beside_ours(cube: Path, rooms: Path) -> None:
    assert "14 views for most of it" in (cube / "report.html").read_text()
    for folder in (cube, rooms):
        for figure in json.loads((folder / "summary.json").read_text())["figures"]:
            assert (folder / figure).read_bytes().startswith(b"\x89PNG")
        assert execute(["report", str(folder)]) == 0


def test_the_same_seed_gives_the_same_bytes(cube: Path, tmp_path: Path) -> None:
    again = made(tmp_path, CUBE | {"planners": ["utility"]})
    first = polars.read_parquet(cube / "results.parquet").filter(polars.col("planner") == "utility")
    assert polars.read_parquet(again / "results.parquet").equals(first)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"voxels": []}, "voxels"),
        ({"voxels": [0.5]}, "at most 0.25"),
        ({"planners": []}, "planners must name at least one"),
        ({"seed": -1}, "seed is -1"),
        ({"place": {"heights": [2.0, 1.0]}}, "the lower one first"),
        ({"place": {"clearance": -1.0}}, "clearance is -1"),
        ({"place": {"lowest_deg": 80.0}}, "expected to rise"),
        ({"place": {"sensor_at": [0.6, 0.0, 0.0]}}, "inside the cube"),
    ],
)
def test_configurations_that_make_no_sense(bad: dict[str, Any], message: str, tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(CUBE | bad))
    assert execute(["run", str(tmp_path / "bad.yaml"), "--out", str(tmp_path / "run")]) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "run").exists()


def test_the_default_is_the_two_rooms() -> None:
    assert load_experiment({"experiment": "next_view_environment"}, "here") == ("next_view_environment", Config())
