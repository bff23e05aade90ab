"""The script of chapter 4 in its quick form, and what it leaves for the READMEs."""

import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("next_view_script")]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("next_view", ROOT / "experiments" / "next_view.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["next_view"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def folder(script: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("next_view")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        script.main(["--quick", "--out", str(out)])
    return out


def test_every_experiment_leaves_rows_and_tables(script: ModuleType, folder: Path) -> None:
    found: dict[str, Any] = json.loads((folder / "results.json").read_text())
    assert {path.name for path in folder.iterdir() if path.is_dir()} == set(script.PARTS)
    rows = [row[0] for row in found["rows"]]
    for words in (
        "views, then pattern",
        "hill climbing",
        "1 objects, utility",
        "cube by pan",
        "two rooms",
        "base moving",
    ):
        assert any(words in row for row in rows), words
    assert all(len(row) == 4 and row[3] == script.COMMAND for row in found["rows"])
    assert all(table["columns"] and table["rows"] for table in found["tables"])
    assert (folder / "next_view.png").read_bytes().startswith(b"\x89PNG")


def test_started_again_it_goes_on_where_it_was(script: ModuleType, folder: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(ROOT)
    before = (folder / "results.json").read_bytes()
    when = (folder / "next_view_search" / "summary.json").stat().st_mtime_ns
    script.main(["--quick", "--out", str(folder)])
    assert (folder / "results.json").read_bytes() == before
    assert (folder / "next_view_search" / "summary.json").stat().st_mtime_ns == when
