"""Both experiments on meshes in their quick form, and what the READMEs take of them."""

import contextlib
import importlib.util
import io
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest

from jaxmodel.io.strict_yaml import config_files, override, read_yaml
from jaxmodel.run.published import published_table
from jaxmodel.run.registry import load_experiment

ROOT = Path(__file__).resolve().parents[2]


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "experiments" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def meshing() -> ModuleType:
    return script("meshing")


class Quick(NamedTuple):
    out: Path
    shown: str

    def results(self) -> dict[str, Any]:
        return json.loads((self.out / "results.json").read_text())


@pytest.fixture(scope="module")
def quick(meshing: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Quick:
    out, shown = tmp_path_factory.mktemp("meshing") / "out", io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(shown):
        patch.chdir(ROOT)
        meshing.main(["--quick", "--out", str(out)])
    return Quick(out, shown.getvalue())


@pytest.mark.slow
@pytest.mark.xdist_group("meshing")
def test_the_quick_form_runs_both(meshing: ModuleType, quick: Quick) -> None:
    assert {path.parent.name for path in quick.out.glob("*/results.parquet")} == set(meshing.PARTS)
    assert "Table 3.2, published | ours" in quick.shown and "Thesis Table 5.2: published | ours" in quick.shown
    assert all((quick.out / name / "report.html").is_file() for name in meshing.PARTS)
    assert (quick.out / "meshing.png").stat().st_size > 10_000


@pytest.mark.slow
@pytest.mark.xdist_group("meshing")
def test_the_rows_hold_what_is_published_and_what_came_out(quick: Quick) -> None:
    rows = {row[0]: row for row in quick.results()["rows"]}
    assert all(len(row) == 4 and all(row) for row in rows.values())
    said = published_table("mesh_quality")["objects"]["teapot"]
    pot = next(row for what, row in rows.items() if "pot for teapot" in what)
    assert pot[1].startswith(f"{said['ball']['Q_equ']:.3f}, {said['ball']['Q_nor']:.3f}; ")
    summary = json.loads((quick.out / "mesh_quality" / "summary.json").read_text())
    ours = next(row for row in summary["rows"] if (row["object"], row["method"]) == ("pot", "deformable_5"))
    assert pot[2].endswith(f"; {ours['Q_equ']:.3f}, {ours['Q_nor']:.3f}")
    scenes = published_table("mesh_segments")["scenes"]
    for name, of in ((name, scenes[name]) for name in ("one_plane", "crossing_planes", "nine_facets")):
        row = next(row for what, row in rows.items() if name in what)
        assert row[1] == f"{of['after']}; {of['segments']}"
        assert row[2].endswith(f"0 of them over another; {of['segments']} of {of['segments']}")
    titles = [table["title"] for table in quick.results()["tables"]]
    assert any("Fig. 3.15" in title for title in titles) and any("Table 3.1" in title for title in titles)


@pytest.mark.slow
@pytest.mark.xdist_group("meshing")
def test_started_again_nothing_is_meshed_twice(
    meshing: ModuleType, quick: Quick, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    kept = [*quick.out.glob("*/results.parquet"), *quick.out.glob("*/meshes/*.ply")]
    before, results = {path: path.stat().st_mtime_ns for path in kept}, quick.results()
    assert len(before) > 5
    meshing.main(["--quick", "--out", str(quick.out)])
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert quick.results() == results


@pytest.mark.slow
@pytest.mark.xdist_group("meshing")
def test_the_readmes_take_the_rows_and_keep_those_of_other_scripts(
    quick: Quick, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    readme = script("readme_results")
    for name in ("README.md", "experiments/README.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text((ROOT / name).read_text())
    (tmp_path / "experiments" / "pictures").mkdir()
    before = readme.rows_by_script((tmp_path / "README.md").read_text())
    assert set(before) == set(readme.GROUPS)
    monkeypatch.setattr(readme, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["readme_results.py", "--only", "meshing", "--meshes", str(quick.out)])
    readme.main()
    after = readme.rows_by_script((tmp_path / "README.md").read_text())
    assert [list(row) for row in after.pop("meshing")] == quick.results()["rows"]
    assert after == {name: rows for name, rows in before.items() if name != "meshing"}
    page = (tmp_path / "experiments" / "README.md").read_text()
    assert all(table["title"] in page for table in quick.results()["tables"])
    assert (tmp_path / "experiments" / "pictures" / "meshing.png").is_file()


@pytest.mark.parametrize("without_data", [True, False])
@pytest.mark.parametrize("tiny", [True, False])
def test_every_part_is_a_sound_configuration(meshing: ModuleType, tiny: bool, without_data: bool) -> None:
    for name, part in meshing.PARTS.items():
        path = config_files() / "experiments" / f"{name}.yaml"
        changes = part.quick if tiny else part.without_data if without_data else {}
        assert load_experiment(override(read_yaml(path), list(changes.items()), str(path)), str(path))[0] == name
