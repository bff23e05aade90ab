"""Bad files, values and folders given to the command: exit code 2, one sentence naming the fault, no folder left."""

import errno
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxmodel.run.cli import execute

Refused = Callable[..., str]
GOOD = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n0.5 0.2 0.7\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
GRID_PLY = """ply
format ascii 1.0
obj_info num_cols 2
obj_info num_rows 3
element vertex 6
property float x
property float y
property float z
element range_grid 6
property list uchar int vertex_indices
end_header
"""
OSU = "type range\nrows 4\ncols 4\n" + "1 " * 16 + "0.5 " * 20
TRUTH = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"


@pytest.fixture
def good(tmp_path: Path) -> str:
    """A sound scan of six points, beside which the bad ones are put."""
    (tmp_path / "good.xyz").write_text(GOOD)
    return "good.xyz"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("cut.ply", PLY + "0 0 0\n1 0 0\n", "truncated"),
        ("cut_grid.ply", GRID_PLY + GOOD + "1 0\n1 1\n", "cut_grid.ply"),
        ("cut_header.ply", PLY[:40], "no 'end_header' line"),
        ("cut.osu", OSU, "cut.osu"),
        ("cut.npz", b"PK\x03\x04 and no more", "not a readable NPZ archive"),
        ("cut.pcd", "VERSION 0.7\nFIELDS x y z\n", "cut.pcd"),
        ("words.ply", "this is a letter\n", "not a PLY file"),
        ("words.xyz", "one two three\n", "line 1: expected 'x y z'"),
        ("two_columns.xyz", "0 0\n1 1\n2 2\n", "line 1: expected 'x y z'"),
        ("picture.xyz", b"\x89PNG\r\n\x1a\n\xff\xfe", "not a text file"),
        ("scan.jpeg", b"\xff\xd8", "unknown extension '.jpeg'"),
        ("empty.ply", "", "is empty"),
        ("comment.xyz", "# nothing else\n", "is empty: expected at least 3 points"),
        ("two.xyz", "0 0 0\n1 1 1\n", "has only 2 points"),
        ("equal.xyz", "1 2 3\n" * 8, "all 8 points are equal"),
        ("nan.xyz", GOOD + "0 nan 0\n", "point 6 (counted from 0) is [0.0, nan, 0.0]"),
        ("inf.ply", PLY + GOOD.replace("0 1 0", "0 inf 0"), "point 2 (counted from 0) is [0.0, inf, 0.0]"),
    ],
)
@pytest.mark.parametrize("command", ["sweep", "register"])
def test_bad_scan_file(
    refused: Refused, tmp_path: Path, good: str, command: str, name: str, content: str | bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    sentence = refused(command, good, name, "--out", "out")
    assert name in sentence and words in sentence


def test_nan_in_an_archive_of_points(refused: Refused, tmp_path: Path, good: str) -> None:
    points = np.eye(4, 3)
    points[1, 2] = np.nan
    np.savez(tmp_path / "nan.npz", points=points)
    assert "nan.npz: point 1 (counted from 0)" in refused("sweep", "nan.npz", good, "--out", "out")


def test_a_folder_in_place_of_a_scan(refused: Refused, tmp_path: Path, good: str) -> None:
    (tmp_path / "scan.ply").mkdir()
    assert "scan.ply is a folder" in refused("sweep", "scan.ply", good, "--out", "out")


def test_conf_names_an_absent_scan(refused: Refused, tmp_path: Path, good: str) -> None:
    (tmp_path / "poses.conf").write_text("bmesh good.xyz 0 0 0 0 0 0 1\n")
    (tmp_path / "other.xyz").write_text(GOOD)
    sentence = refused("sweep", good, "other.xyz", "--truth", "poses.conf", "--out", "out")
    assert "poses.conf has no pose for the scan 'other.xyz'; it has good" in sentence


def test_data_set_whose_conf_names_an_absent_file(
    refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "data" / "stanford_bunny" / "data"
    folder.mkdir(parents=True)
    (folder / "bun.conf").write_text("bmesh bun000.ply 0 0 0 0 0 0 1\n")
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path / "data"))
    sentence = refused("run", "bunny_convergence", "--out", "out")
    assert "bun.conf names the scan 'bun000.ply', but there is no file" in sentence


def test_data_set_that_is_not_there(refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "data").mkdir()
    monkeypatch.setenv("JAXMODEL_DATA", str(tmp_path / "data"))
    assert "bunny" in refused("run", "bunny_convergence", "--out", "out")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("t.txt", "1 0 0\n0 1 0\n0 0 1\n", "found shape (3, 3)"),
        ("t.txt", TRUTH * 2, "found shape (8, 4)"),
        ("t.txt", "1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n", "expected a 4 x 4 matrix"),
        ("t.txt", TRUTH.replace("0 1 0 0", "0 a 0 0"), "expected four rows of four numbers"),
        ("t.txt", TRUTH.replace("0 1 0 0", "0 nan 0 0"), "finite numbers"),
        ("t.txt", TRUTH.replace("1 0 0 0", "2 0 0 0"), "expected a rigid motion"),
        ("t.txt", TRUTH.replace("0 0 1 0", "0 0 -1 0"), "det R = -1"),
        ("t.json", "[[1, 0], [0, 1]]", "found shape (2, 2)"),
        ("t.json", '{"T_source_target": [[1]]}', "t.json"),
        ("t.json", "{", "t.json"),
        ("t.npy", b"\x93NUMPY", "not a .npy file"),
        ("t.conf", "bmesh good.xyz 0 0 0 0 0 0\n", "line 1: expected 'bmesh FILE"),
        ("t.conf", "bmesh good.xyz 0 0 0 0 0 0 2\n", "expected a unit quaternion"),
    ],
)
def test_bad_truth(refused: Refused, tmp_path: Path, good: str, name: str, content: str | bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    sentence = refused("sweep", good, good, "--truth", name, "--out", "out")
    assert name in sentence and words in sentence


def test_bad_first_guess(refused: Refused, tmp_path: Path, good: str) -> None:
    assert "absent.txt: cannot be read" in refused("register", good, good, "--init", "absent.txt", "--out", "out")
    np.save(tmp_path / "guess.npy", np.eye(3))
    sentence = refused("register", good, good, "--init", "guess.npy", "--out", "out")
    assert "guess.npy" in sentence and "found shape (3, 3)" in sentence
    np.save(tmp_path / "objects.npy", np.array([{}]), allow_pickle=True)
    assert "objects.npy" in refused("register", good, good, "--init", "objects.npy", "--out", "out")


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("--starts", "0"), "--starts is 0"),
        (("--count", "-4"), "count is -4"),
        (("--lanes", "-1"), "lanes is -1"),
        (("--chunk", "0"), "chunk is 0"),
        (("--seed", "-2"), "seed is -2"),
        (("--starts", "10000000000"), "--starts is 10000000000, expected 1 to 10000000"),
        (("--method", "thesis_2004"), "unknown method 'thesis_2004'"),
        (("--method", "../methods/thesis_2005"), "unknown method"),
    ],
)
def test_bad_values_of_a_sweep(refused: Refused, good: str, words: tuple[str, ...], fault: str) -> None:
    assert fault in refused("sweep", good, good, *words, "--out", "out")


@pytest.mark.parametrize(
    ("key", "value", "fault"),
    [
        ("engine.chunk", "1e6", "engine.chunk: expected a whole number"),
        ("engine.chunk", "'100'", "engine.chunk: expected a whole number"),
        ("engine.chunk", "1.5", "engine.chunk: expected a whole number"),
        ("engine.chunk", "true", "engine.chunk: expected a whole number"),
        ("engine.chunk", "[1]", "engine.chunk: expected a whole number"),
        ("engine.lanes", "-256", "lanes is -256"),
        ("engine.executor", "gpu", "engine.executor"),
        ("starts.count", "100000000000", "count is 100000000000"),
        ("starts", "{kind: euler, steps: 100000}", "steps is 100000"),
        ("scans.views_deg", "[0]", "scans.views_deg"),
        ("scans.views_deg", "[10, 10]", "the angle 10 is given twice"),
        ("scans.sensor.width", "-3", "width"),
        ("scans.noise", "{kind: laserr}", "did you mean 'laser'?"),
        ("control_points.0.kind", "vertexes", "did you mean 'vertices'?"),
        ("control_points.7.count", "3", "'7' must be the number of one of"),
        ("right.tolerance_deg", "0", "tolerance_deg is 0"),
        ("right.tolerance", "far", "right.tolerance"),
        ("claims.starts", "-1", "starts is -1"),
        ("method", "{max_iteration: 3}", "method.max_iteration: unknown key, did you mean 'max_iterations'?"),
        ("method", "{max_iterations: -3}", "max_iterations must be at least 1"),
        ("method", "{strategies: [{slope_percent: low}]}", "method.strategies.0.slope_percent"),
        ("method", "thesis", "unknown method 'thesis'"),
        ("seed", "[", "not valid YAML"),
    ],
)
def test_bad_value_of_an_experiment(refused: Refused, key: str, value: str, fault: str) -> None:
    assert fault in refused("run", "quickstart", f"--{key}", value, "--out", "out")


def test_existing_folder_is_refused_before_anything_is_read(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    for command in ("sweep", "register"):
        sentence = refused(command, "absent.ply", "absent.ply", "--out", "out")
        assert "out: already exists" in sentence and "--resume out" in sentence


def test_a_folder_that_may_not_be_written(
    refused: Refused, tmp_path: Path, good: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "is not writable" in refused("sweep", good, good, "--out", "new/out")


def test_a_folder_that_may_not_be_read(refused: Refused, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "summary.json").write_text("{}")

    def denied(*_: object, **__: object) -> str:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "read_text", denied)
    assert "Permission denied" in refused("report", "out")


def test_a_full_disk_is_seen_before_the_run(refused: Refused, good: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1000))
    assert "the disk is full" in refused("sweep", good, good, "--out", "out")


def test_a_disk_that_fills_up_keeps_whole_files_to_go_on_from(
    tmp_path: Path, good: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    flush, written = os.fsync, []

    def full_at_the_third(handle: int) -> None:
        written.append(handle)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        flush(handle)

    monkeypatch.setattr(os, "fsync", full_at_the_third)
    words = ("sweep", good, good, "--starts", "8", "--chunk", "4", "--method", "point_to_point")
    assert execute([*words, "--out", "out"]) == 2
    shown = capsys.readouterr().err
    assert "the disk is full" in shown and "--resume" in shown and shown.count("\n") == 1
    kept = sorted(path.name for path in (tmp_path / "out").rglob("*") if path.is_file())
    assert kept[:1] == [".lock"] and kept[2:] == ["manifest.json"] and kept[1].startswith("case000-000000-")
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["seed"] == 0
