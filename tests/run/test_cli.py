"""The command line: quick help, exit codes, one sentence for each fault, nothing left behind by bad input."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.run.arguments import Run, parse, split_overrides
from jaxmodel.run.cli import execute

BAD = Path(__file__).resolve().parents[1] / "bad_configs"
HEAVY = ("jax", "open3d", "polars", "matplotlib", "plotly", "scipy", "numpy", "trimesh", "yaml", "cattrs", "pooch")


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["run"],
        ["sweep"],
        ["register"],
        ["calibrate"],
        ["mesh"],
        ["report"],
        ["data"],
        ["data", "list"],
        ["data", "fetch"],
    ],
)
def test_help_has_an_example_and_imports_nothing_heavy(words: list[str]) -> None:
    script = (
        "import sys; from jaxmodel.run.cli import execute; code = execute(sys.argv[1:]);"
        f"print('HEAVY', [m for m in {HEAVY!r} if m in sys.modules]); sys.exit(code)"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(
        [sys.executable, "-c", script, *words, "--help"],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(root)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Example: jaxmodel" in done.stdout
    assert "HEAVY []" in done.stdout


@pytest.mark.parametrize("words", [["swep"], ["sweep", "a"], ["sweep", "a", "b", "--starts", "many"], []])
def test_wrong_usage_is_code_two(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(words) == 2


def test_overrides_are_taken_out_wherever_they_stand() -> None:
    words = ["run", "--engine.chunk", "3", "c.yaml", "--scans.names=[a, b]", "--json", "--out", "x"]
    kept, changes = split_overrides(words)
    assert kept == ["run", "c.yaml", "--json", "--out", "x"]
    assert changes == [("engine.chunk", "3"), ("scans.names", "[a, b]")]
    command, changes = parse(words)
    assert command == Run(config=Path("c.yaml"), out=Path("x"), json=True) and len(changes) == 2


def test_an_override_without_value_is_refused() -> None:
    with pytest.raises(InputError, match=r"--engine\.chunk: expected a value"):
        split_overrides(["run", "c.yaml", "--engine.chunk"])


def test_a_bare_resume_means_the_out_folder() -> None:
    command, _ = parse(["sweep", "a", "b", "--out", "d", "--resume", "--starts", "5"])
    assert command == parse(["sweep", "a", "b", "--out", "d", "--resume", "d", "--starts", "5"])[0]


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("unknown_key.yaml", "sede: unknown key, did you mean 'seed'?"),
        ("unknown_nested_key.yaml", "engine.chnuk: unknown key, did you mean 'chunk'?"),
        ("wrong_type.yaml", "seed: expected a whole number, got the text 'zero'"),
        ("negative_seed.yaml", "seed is -1"),
        ("negative_starts.yaml", "starts: count is -5"),
        ("negative_count.yaml", "control_points.0: count is -2000"),
        ("zero_chunk.yaml", "engine: chunk is 0"),
        ("unknown_kind.yaml", "control_points.0"),
        ("no_control_points.yaml", "control_points is empty"),
        ("unknown_method.yaml", "thesis_2004"),
        ("unknown_object.yaml", "bolder"),
        ("unknown_experiment.yaml", "did you mean 'convergence'?"),
        ("no_experiment.yaml", "the key 'experiment' is required"),
        ("missing_scans.yaml", "scans: this key is required and missing"),
        ("duplicate_key.yaml", "given twice"),
        ("broken.yaml", "not valid YAML"),
        ("empty.yaml", "the file is empty"),
        ("absent.yaml", "no such file"),
    ],
)
def test_bad_config_is_one_sentence_and_nothing_is_made(refused: Callable[..., str], file: str, words: str) -> None:
    assert words in refused("run", str(BAD / file), "--out", "out")


def test_bad_override_is_the_same_sentence(refused: Callable[..., str]) -> None:
    sentence = refused("run", "quickstart", "--engine.chnuk", "3", "--out", "out")
    assert "engine.chnuk: unknown key, did you mean 'chunk'?" in sentence


def test_labels_of_contours_are_checked_in_a_config(refused: Callable[..., str]) -> None:
    first = ("run", "quickstart", "--control_points.0.kind", "contours", "--out", "out", "--control_points.0.labels")
    assert "control_points.0.labels.1: got the text 'valley'" in refused(*first, "[crease, valley]")
    assert "labels is empty" in refused(*first, "[]")


def test_existing_folder_without_resume(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    assert "already exists" in refused("run", "quickstart", "--out", "out")


def test_folder_below_a_file(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "is not a folder" in refused("run", "quickstart", "--out", "file/out")


def test_resume_of_nothing(refused: Callable[..., str]) -> None:
    assert "nothing to resume" in refused("run", "quickstart", "--resume", "out")


def test_two_folders(refused: Callable[..., str]) -> None:
    assert "name two folders" in refused("run", "quickstart", "--resume", "a", "--out", "b")


def test_sweep_faults(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n")
    (tmp_path / "bad.txt").write_text("1 2 3\n")
    assert "--starts is -3" in refused("sweep", "a.xyz", "a.xyz", "--starts", "-3", "--out", "out")
    assert "--out is required" in refused("sweep", "a.xyz", "a.xyz")
    assert "absent.ply" in refused("sweep", "a.xyz", "absent.ply", "--out", "out")
    assert "bad.txt" in refused("sweep", "a.xyz", "a.xyz", "--truth", "bad.txt", "--out", "out")
    assert "bad.txt" in refused("register", "a.xyz", "a.xyz", "--init", "bad.txt", "--out", "out")
    for kind in ("vertices", "contours", "split_vertices"):
        words = ("sweep", "a.xyz", "a.xyz", "--control-points", kind, "--out", "out")
        assert "this cloud has no grid" in refused(*words)


def grid_file(path: Path, z: np.ndarray) -> None:
    row, column = np.indices(z.shape)
    np.savez(path, points=np.stack([column, row, z], axis=-1).astype(float))


def test_contour_faults(refused: Callable[..., str], tmp_path: Path) -> None:
    flat, missing = np.full((20, 30), 50.0), np.full((20, 30), np.nan)
    for name, z in (("flat", flat), ("missing", missing), ("row", flat[:1])):
        grid_file(tmp_path / f"{name}.npz", z)
    contours = ("--control-points", "contours", "--out", "out")
    for command in ("sweep", "register"):
        sentence = refused(command, "flat.npz", "flat.npz", *contours)
        assert "no crease contour" in sentence and "single smooth surface" in sentence
        assert "no crease contour" in refused(command, "row.npz", "row.npz", *contours)
        assert "missing" in refused(command, "missing.npz", "missing.npz", *contours)
        twice = refused(command, "flat.npz", "flat.npz", *contours, "--labels", "crease", "crease")
        assert "labels names one kind of edge twice" in twice
        alone = refused(command, "flat.npz", "flat.npz", "--labels", "depth", "--out", "out")
        assert "--labels needs --control-points contours, not subsample" in alone
    assert execute(["sweep", "flat.npz", "flat.npz", *contours, "--labels", "valley"]) == 2
    assert execute(["sweep", "flat.npz", "flat.npz", *contours, "--labels"]) == 2


def test_report_of_no_run(refused: Callable[..., str], tmp_path: Path) -> None:
    assert "holds no finished run" in refused("report", str(tmp_path))


def test_data_list_says_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path))
    assert execute(["data", "list", "--json"]) == 0
    line = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert line["found"] == {"stanford_bunny": False} and line["root"] == str(tmp_path)
    (tmp_path / "stanford_bunny" / "data").mkdir(parents=True)
    (tmp_path / "stanford_bunny" / "data" / "bun.conf").write_text("")
    assert execute(["data", "list", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["found"] == {"stanford_bunny": True}


def test_unexpected_failure_is_code_one_without_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from jaxmodel.run import cli

    def fail(*_: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(cli, "_run", fail)
    assert execute(["data", "list"]) == 1
    assert capsys.readouterr().err == "jaxmodel: ZeroDivisionError: by zero (JAXMODEL_DEBUG=1 shows where).\n"


def test_interrupt_is_code_130_with_the_way_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from jaxmodel.run import cli

    def stop(*_: object) -> None:
        raise KeyboardInterrupt("finished chunks are kept, go on with --resume out")

    monkeypatch.setattr(cli, "_run", stop)
    assert execute(["data", "list"]) == 130
    assert "go on with --resume out" in capsys.readouterr().err
