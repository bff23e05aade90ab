"""The whole chapter in its quick form, and the conclusion's words."""

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from jaxmodel.io.strict_yaml import config_files, override, read_yaml
from jaxmodel.run.registry import load_experiment

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def chapter2() -> ModuleType:
    spec = importlib.util.spec_from_file_location("chapter2", ROOT / "experiments" / "chapter2.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["chapter2"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.xdist_group("study")
def test_the_quick_form_runs_every_experiment_and_is_not_run_twice(
    chapter2: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    chapter2.main(["--quick", "--out", str(tmp_path / "out")])
    shown = capsys.readouterr().out
    made = {path.parent.name: path.read_bytes() for path in (tmp_path / "out").glob("*/results.parquet")}
    assert set(made) == {part.config for part in chapter2.PARTS if not part.bunny}
    assert "The conclusion of chapter 2 put to the test" in shown and "Published | ours" in shown
    content = json.loads((tmp_path / "out" / "conclusion.json").read_text())
    assert set(content["comparison"]) == {"close starts", "starts as by a user", "all rotations"}
    assert all(set(families) == {"structured", "free_form"} for families in content["comparison"].values())
    assert len(content["answers"]) == 3 and (tmp_path / "out" / "conclusion.png").is_file()
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*/results.parquet")}
    chapter2.main(["--quick", "--out", str(tmp_path / "out")])
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.parametrize("quick", [True, False])
@pytest.mark.parametrize("has_data", [True, False])
def test_the_changes_of_every_part_make_a_sound_configuration(
    chapter2: ModuleType, quick: bool, has_data: bool
) -> None:
    for part in chapter2.PARTS:
        path = config_files() / "experiments" / f"{part.config}.yaml"
        tree = override(read_yaml(path), chapter2.changes(part, quick, has_data), str(path))
        _, config = load_experiment(tree, str(path))
        needs_data = [g for g in getattr(config, "groups", ()) if g.scans.kind != "objects"]
        assert (quick or not has_data) <= (not needs_data or part.bunny)


def figure(contours: float, vertices: float, low: float, high: float) -> dict[str, Any]:
    def estimate(value: float, low: float, high: float) -> dict[str, Any]:
        return {"value": value, "low": low, "high": high, "units": 9, "count": 90}

    difference = estimate(contours - vertices, low, high)
    return {"contours": estimate(contours, 0, 1), "vertices": estimate(vertices, 0, 1), "difference": difference}


def compared(**figures: dict[str, Any]) -> dict[str, Any]:
    nothing = {kind: {"value": None, "low": None, "high": None} for kind in ("contours", "vertices", "difference")}
    keys = ("rate", "rate_either", "rotation_error_deg", "translation_error_of_size", "steps", "seconds")
    return {
        "kinds": ["contours", "vertices"],
        "tests": 90,
        "pairs": 9,
        "both_right": 50,
        "figures": {key: figures.get(key, nothing) for key in keys},
    }


def test_verdicts_agree_contradict_or_stay_open(chapter2: ModuleType) -> None:
    found = {
        "close starts": {
            "structured": compared(rate=figure(0.9, 0.5, 0.3, 0.5), rotation_error_deg=figure(2, 1, 0.5, 1.5)),
            "free_form": compared(rate=figure(0.5, 0.6, -0.3, 0.1), seconds=figure(1, 2, -1.5, -0.5)),
        }
    }
    lines = {(line[0], line[1]): line for line in chapter2.verdict_lines(found)}
    assert lines["structured, close starts", "converged"][-1] == "contours: confirmed"
    assert lines["structured, close starts", "true rotation error"][-1] == "vertices: contradicted"
    assert lines["free-form, close starts", "converged"][-1] == "undecided"
    assert lines["free-form, close starts", "time with extraction"][2:][-1] == "contours"  # the thesis says nothing
    assert len(lines) == 4  # what could not be measured has no line
    structured, free_form, tests = chapter2.answers([*lines.values()], found)
    assert "confirmed in 1: converged (close starts)" in structured and "contradicted in 1" in structured
    assert free_form.startswith("free-form objects, vertices better? undecided in 1")
    assert tests == "Tests, each with both kinds: 180 from close starts."
