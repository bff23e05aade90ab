"""The command as a user starts it: its own process, its own folder."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jaxmodel.run.cli import execute

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def start(tmp_path: Path) -> Callable[..., subprocess.Popen[str]]:
    """Start ``jaxmodel WORDS...`` in ``tmp_path`` and return the running process."""

    def started(*words: str) -> subprocess.Popen[str]:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200"}
        script = "import sys; from jaxmodel.run.cli import main; main(sys.argv[1:])"
        return subprocess.Popen(
            [sys.executable, "-c", script, *words],
            cwd=tmp_path,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return started


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Run a command that must be refused: code 2, one sentence, no traceback, nothing made. Gives the sentence."""
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> str:
        before = sorted(tmp_path.rglob("*"))
        assert execute(list(words)) == 2
        shown = capsys.readouterr()
        assert shown.err.startswith("jaxmodel: ") and shown.err.count("\n") == 1 and shown.err.endswith(".\n")
        assert shown.out == ""
        assert sorted(tmp_path.rglob("*")) == before
        return shown.err

    return run


def small_study(experiment: str, **changes: Any) -> dict[str, Any]:
    """The YAML of a study that takes a second: one polyhedron, one smooth object, all kernels of one shape."""
    kinds = [{"kind": "contours", "labels": ["crease", "depth", "border"]}, {"kind": "vertices"}]

    def group(name: str, stands_for: str) -> dict[str, Any]:
        sensor = {"width": 80, "height": 80}
        scans = {"kind": "objects", "names": [name], "views_deg": [0, 20], "turns_deg": [0, 90], "sensor": sensor}
        return {"scans": scans, "control_points": kinds, "stands_for": stands_for}

    return {
        "experiment": experiment,
        "groups": [group("block_steps", "BLOCK2"), group("torso", "HAPPY")],
        "counts": [120],
        "starts": {"count": 4, "spread_deg": 10, "shift_of_size": 0.05},
        "method": "thesis_2005",
        "resamples": 100,
        **changes,
    }


@pytest.fixture(scope="module")
def run_study(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Run a study given as a tree, with further words for the command; its folder."""

    def run(tree: dict[str, Any], *words: str) -> Path:
        folder = tmp_path_factory.mktemp("study")
        (folder / "study.yaml").write_text(json.dumps(tree))
        assert execute(["run", str(folder / "study.yaml"), *words, "--out", str(folder / "out")]) == 0
        return folder / "out"

    return run
