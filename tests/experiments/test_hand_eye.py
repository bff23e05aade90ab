"""All hand-eye experiments in their quick form, and the verdicts at the end."""

import contextlib
import importlib.util
import io
import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import polars
import pytest

from jaxmodel.io.strict_yaml import config_files, override, read_yaml
from jaxmodel.run.cli import execute
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
def hand_eye() -> ModuleType:
    return script("hand_eye")


class Quick(NamedTuple):
    """One run of the quick form: its folder and what it printed."""

    out: Path
    shown: str

    def summary(self, name: str) -> dict[str, Any]:
        return json.loads((self.out / name / "summary.json").read_text())


@pytest.fixture(scope="module")
def quick(hand_eye: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Quick:
    out, shown = tmp_path_factory.mktemp("hand_eye") / "out", io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(shown):
        patch.chdir(ROOT)
        hand_eye.main(["--quick", "--out", str(out)])
    return Quick(out, shown.getvalue())


@pytest.mark.slow
@pytest.mark.xdist_group("hand_eye")
def test_the_quick_form_runs_every_experiment(hand_eye: ModuleType, quick: Quick) -> None:
    assert {path.parent.name for path in quick.out.glob("*/results.parquet")} == set(hand_eye.PARTS)
    assert "Published | ours" in quick.shown and "The claims of RR-3507 put to the test" in quick.shown
    assert "Chosen here, not stated in the report" in quick.shown
    content = json.loads((quick.out / "claims.json").read_text())
    assert sum(content["typical_draw"].values()) == len(content["claims"]) > 20
    assert sum(content["stated"].values()) == len(content["statements"]) >= 8
    for name in hand_eye.PARTS:
        figures = quick.summary(name)["figures"]
        assert figures and all((quick.out / name / figure).stat().st_size > 0 for figure in figures)
        assert (quick.out / name / "report.html").is_file()
    assert (quick.out / "hand_eye.png").stat().st_size > 0


@pytest.mark.slow
@pytest.mark.xdist_group("hand_eye")
def test_every_claim_of_the_published_data_is_put_to_the_test(hand_eye: ModuleType, quick: Quick) -> None:
    content = json.loads((quick.out / "claims.json").read_text())
    tested = {line[0] for line in (*content["claims"], *content["statements"])}
    said = published_table("hand_eye")["claims"]
    timed = {"count_time", "count_short"}  # the quick form times one number of motions only
    untested = {key for key, words in said.items() if not any(line.startswith(words) for line in tested)}
    assert untested == timed


@pytest.mark.slow
@pytest.mark.xdist_group("hand_eye")
def test_a_finished_run_is_not_run_twice_and_is_drawn_again_from_its_folder(
    hand_eye: ModuleType, quick: Quick, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    before = {path: path.stat().st_mtime_ns for path in quick.out.glob("*/results.parquet")}
    hand_eye.main(["--quick", "--out", str(quick.out)])
    assert {path: path.stat().st_mtime_ns for path in before} == before
    for name in hand_eye.PARTS:
        assert execute(["report", str(quick.out / name)]) == 0


@pytest.mark.slow
@pytest.mark.xdist_group("hand_eye")
def test_what_is_exact_in_the_quick_form(quick: Quick) -> None:
    rows = polars.read_parquet(quick.out / "hand_eye_noise" / "results.parquet")
    exact = rows.filter(polars.col("noise") == 0)
    assert all(exact[f"linear: {of}"].to_numpy().max() < 1e-6 for of in ("rotation_deg", "translation"))
    summary = quick.summary("hand_eye_self_calibration")
    assert all(of["unpredicted"]["high"] < 1e-9 < 1e-2 < of["bias"]["value"] for of in summary["bias"][:1])
    assert all(of["tied"] == of["solved with the target"] == of["sets"] for of in summary["pure"])
    table = next(of for of in quick.summary("hand_eye_averaging")["statements"] if "Table 3.2" in of["says"])
    assert table["verdict"] == "confirmed" and table["ours"].startswith("8 of 8")
    ranks = {of["motions"]: of for of in quick.summary("hand_eye_observability")["ranks"]}
    expected = {  # ERRATA, §4.2: ranks of eqs 4.3 (of 4) and 4.4
        "two rotations": ([3], [4]),
        "two rotations and a translation": ([4], [5]),
        "two general motions": ([4], [5]),
    }
    assert {name: (ranks[name]["scale"], ranks[name]["scales"]) for name in expected} == expected


@pytest.mark.slow
@pytest.mark.xdist_group("hand_eye")
def test_the_readme_tables_hold_every_claim_and_published_value(quick: Quick, tmp_path: Path) -> None:
    readme = script("readme_results")
    lines = readme.hand_eye_tables(quick.out)
    content, data = json.loads((quick.out / "claims.json").read_text()), published_table("hand_eye")
    text = "\n".join(lines).replace("\\|", "|")
    assert all(line[0] in text for line in (*content["claims"], *content["statements"]))
    values = sum(len(of["rotation"]) for key in ("table_3_3", "table_4_1") for of in data[key].values())
    assert sum("Table 3.3" in line or "Table 4.1" in line for line in lines[:40]) == values
    bars = [len(re.findall(r"(?<!\\)\|", line)) for line in lines if line]
    assert all(count in (4, 7) for count in bars)
    path = tmp_path / "page.md"
    path.write_text("before <a>old<b> after")
    readme.write_between(path, ("<a>", "<b>"), ["new"])
    assert path.read_text() == "before <a>\n\nnew\n\n<b> after"


@pytest.mark.parametrize("tiny", [True, False])
def test_every_part_is_a_sound_configuration(hand_eye: ModuleType, tiny: bool) -> None:
    for name, changes in hand_eye.PARTS.items():
        path = config_files() / "experiments" / f"{name}.yaml"
        tree = override(read_yaml(path), list(changes.items()) if tiny else [], str(path))
        assert load_experiment(tree, str(path))[0] == name
