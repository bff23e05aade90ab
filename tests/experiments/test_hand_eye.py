"""All hand-eye experiments in their quick form, and the verdicts at the end."""

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import polars
import pytest

from jaxmodel.io.strict_yaml import config_files, override, read_yaml
from jaxmodel.run.cli import execute
from jaxmodel.run.registry import load_experiment

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def hand_eye() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hand_eye", ROOT / "experiments" / "hand_eye.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["hand_eye"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.xdist_group("hand_eye")
def test_the_quick_form_runs_every_experiment_and_is_not_run_twice(
    hand_eye: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    out = tmp_path / "out"
    hand_eye.main(["--quick", "--out", str(out)])
    shown = capsys.readouterr().out
    assert {path.parent.name for path in out.glob("*/results.parquet")} == set(hand_eye.PARTS)
    assert "Published | ours" in shown and "The claims of RR-3507 put to the test" in shown
    assert "Chosen here, not stated in the report" in shown
    content = json.loads((out / "claims.json").read_text())
    assert sum(content["typical_draw"].values()) == len(content["claims"]) > 20
    for name in hand_eye.PARTS:
        summary = json.loads((out / name / "summary.json").read_text())
        assert summary["figures"] and all((out / name / figure).stat().st_size > 0 for figure in summary["figures"])
        assert (out / name / "report.html").is_file()
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/results.parquet")}
    hand_eye.main(["--quick", "--out", str(out)])
    assert {path: path.stat().st_mtime_ns for path in before} == before
    for name in hand_eye.PARTS:
        assert execute(["report", str(out / name)]) == 0
    rows = polars.read_parquet(out / "hand_eye_noise" / "results.parquet")
    exact = rows.filter(polars.col("noise") == 0)
    assert all(exact[f"linear: {of}"].to_numpy().max() < 1e-6 for of in ("rotation_deg", "translation"))
    summary = json.loads((out / "hand_eye_self_calibration" / "summary.json").read_text())
    assert all(of["unpredicted"]["high"] < 1e-9 < 1e-2 < of["bias"]["value"] for of in summary["bias"][:1])
    assert all(of["tied"] == of["solved with the target"] == of["sets"] for of in summary["pure"])


@pytest.mark.parametrize("quick", [True, False])
def test_every_part_is_a_sound_configuration(hand_eye: ModuleType, quick: bool) -> None:
    for name, changes in hand_eye.PARTS.items():
        path = config_files() / "experiments" / f"{name}.yaml"
        tree = override(read_yaml(path), list(changes.items()) if quick else [], str(path))
        assert load_experiment(tree, str(path))[0] == name
