"""The experiment ``search`` and ``jaxmodel register`` with no first guess, as a user meets them."""

import json
from pathlib import Path

import numpy as np
import polars
import pytest

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.io.datasets import ObjectViews
from jaxmodel.run.cli import execute
from jaxmodel.run.searching.judging import area_under_curve, maps_onto_itself, operating_curve, pose_error
from jaxmodel.scan.known_solids import known_solid
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.sensor import Sensor


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ObjectViews]:
    """Three views of the gourd as files: two that share much, one from behind the first."""
    folder = tmp_path_factory.mktemp("scans")
    views = ObjectViews("gourd", (0, 50, 180), Sensor(width=120, height=120), Laser(sigma=0.001), seed=4)
    for name in views.names:
        image = views.scan(name)
        points = np.where(image.valid[..., None], image.points, np.nan)
        np.savez(folder / f"{name}.npz", points=points, valid=image.valid)
    return folder, views


def test_register_searches_and_says_how_sure_it_is(scans, tmp_path, capsys):
    folder, views = scans
    files = [str(folder / f"{name}.npz") for name in views.names]
    assert execute(["register", files[0], files[1], "--out", str(tmp_path / "one"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    saved = json.loads((tmp_path / "one" / "transform.json").read_text())
    assert told["status"] == "ok" and told["T_target_source"] == saved["T_target_source"]
    assert saved["outcome"] == "found" and saved["confidence"] > 0.8 and saved["equivalents"] == []
    assert 0 < saved["error"] < 0.003 and 0.3 < saved["overlap"] < 0.9 and saved["contradicted"] < 0.01
    true = views.T_target_source(*views.names[:2])
    assert rotation_angle_deg(np.array(saved["T_target_source"])[:3, :3].T @ true[:3, :3]) < 0.5
    for name in ("manifest.json", "results.parquet", "summary.json", "report.html", "figures/pair-000.png"):
        assert (tmp_path / "one" / name).stat().st_size > 0


def test_register_ends_with_1_where_nothing_is_believed(scans, tmp_path, capsys):
    folder, views = scans
    files = [str(folder / f"{views.names[k]}.npz") for k in (0, 2)]
    assert execute(["register", *files, "--out", str(tmp_path / "none")]) == 1
    shown = capsys.readouterr().err
    assert "no pose is convincing" in shown and shown.count("\n") == 1
    assert json.loads((tmp_path / "none" / "transform.json").read_text())["outcome"] == "refused"


def test_scans_of_other_units_are_refused(scans, tmp_path, refused):
    folder, views = scans
    with np.load(folder / f"{views.names[1]}.npz", allow_pickle=False) as image:
        np.savez(tmp_path / "large.npz", points=1000 * image["points"], valid=image["valid"])
    sentence = refused("register", str(folder / f"{views.names[0]}.npz"), "large.npz", "--out", "out")
    assert "a factor of 1000" in sentence


def test_a_study_goes_on_where_it_was_cut_off(tmp_path, capsys):
    words = ["run", "search", "--scans", "[{kind: objects, names: [gourd, ball], views_deg: [0, 50], "
             "sensor: {width: 120, height: 120}}]"]  # fmt: skip
    assert execute([*words, "--out", str(tmp_path / "whole")]) == 0
    whole = (tmp_path / "whole" / "results.parquet").read_bytes()
    summary = json.loads((tmp_path / "whole" / "summary.json").read_text())
    assert summary["pairs"][0]["right"] and summary["all"]["alike"] == 2
    shown = capsys.readouterr().out
    assert "Registered with no first guess" in shown
    (tmp_path / "whole" / "summary.json").unlink()  # as if it had been killed before the end
    assert execute([*words, "--out", str(tmp_path / "whole"), "--resume"]) == 0
    assert (tmp_path / "whole" / "results.parquet").read_bytes() == whole
    assert execute(["report", str(tmp_path / "whole")]) == 0
    rows = polars.read_parquet(tmp_path / "whole" / "results.parquet")
    assert rows["outcome"].to_list() == ["found", "several"] and len(rows["equivalents"][1]) >= 3


def test_a_ball_maps_onto_itself_and_a_box_only_by_its_symmetries():
    draw = np.random.default_rng(0)
    true = np.eye(4)
    turned = np.eye(4)
    turned[:3, :3] = np.diag([-1.0, -1.0, 1.0])
    slight = np.eye(4)
    slight[:3, :3] = [[0.995, -0.0998, 0], [0.0998, 0.995, 0], [0, 0, 1]]
    ball, box = known_solid("ball"), known_solid("box")
    assert maps_onto_itself(ball, slight, true, 1.0) and not maps_onto_itself(box, slight, true, 1.0)
    assert maps_onto_itself(box, turned, true, 1.0)
    error = pose_error(turned, true, draw.normal(size=3))
    assert np.isclose(error.turn_deg, 180) and error.shift > 0
    assert pose_error(inverse(turned), turned, np.zeros(3)).shift == 0


def test_area_under_the_curve_by_hand():
    probability, right = np.array([0.9, 0.8, 0.7, 0.2]), np.array([True, False, True, False])
    assert area_under_curve(probability, right) == 0.75
    wrong, accepted = operating_curve(probability, right)
    assert accepted.tolist() == [0, 0.5, 0.5, 1, 1] and wrong.tolist() == [0, 0, 0.5, 0.5, 1]
    assert np.isnan(area_under_curve(probability, np.ones(4, bool)))


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"scans": []}, "scans is empty"),
        ({"right_deg": 0}, "right_deg is 0"),
        ({"least_overlap": 2}, "least_overlap is 2"),
        ({"search": {"grid": 0}}, "grid must be greater than 0"),
        ({"scans": [{"kind": "objects", "names": ["teapot"]}]}, "teapot"),
    ],
)
def test_bad_configurations_are_named(change, sentence, tmp_path, refused):
    raw = {"experiment": "search", "scans": [{"kind": "objects", "names": ["gourd"]}], **change}
    (tmp_path / "bad.yaml").write_text(json.dumps(raw))
    assert sentence in refused("run", "bad.yaml", "--out", "out")
