"""The command as a user starts it: its own process, its own folder."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

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
