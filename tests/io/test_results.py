"""A run's folder: one owner, whole files, honest refusals, and the same bytes for the same table."""

import errno
import itertools
import json
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io import results
from jaxmodel.io.results import RunDir, json_text, read_json, table_bytes


def table(rows: int = 10, offset: int = 0) -> polars.DataFrame:
    return polars.DataFrame({"start": np.arange(rows) + offset, "error": np.linspace(0, 1, rows)})


def test_create_writes_the_manifest_and_nothing_else(tmp_path: Path) -> None:
    with RunDir.create(tmp_path / "a" / "run", {"seed": 3}) as folder:
        assert read_json(folder.path / "manifest.json") == {"seed": 3}
    assert sorted(os.listdir(tmp_path / "a" / "run")) == [".lock", "manifest.json"]


def test_existing_folder_is_refused_and_untouched(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    for refuse in (RunDir.refuse, lambda path: RunDir.create(path, {})):
        with pytest.raises(InputError, match=r"already exists; .*--resume"):
            refuse(tmp_path / "run")
    assert os.listdir(tmp_path / "run") == []


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is not a folder"):
        RunDir.create(tmp_path / "file" / "run", {})


def test_unwritable_parent_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="is not writable"):
        RunDir.create(tmp_path / "run", {})
    assert os.listdir(tmp_path) == []


def test_unwritable_place_found_only_when_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", denied)
    with pytest.raises(InputError, match="cannot be written"):
        RunDir.create(tmp_path / "run", {})


def test_too_little_space_is_refused_before_anything_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=10))
    with pytest.raises(InputError, match="the disk is full"):
        RunDir.create(tmp_path / "run", {}, bytes_needed=1_000)
    assert os.listdir(tmp_path) == []


def full(*_: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_disk_full_at_the_manifest_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="the disk is full"):
        RunDir.create(tmp_path / "run", {})
    assert os.listdir(tmp_path) == []


def test_disk_full_later_keeps_the_old_file_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with RunDir.create(tmp_path / "run", {}) as folder:
        folder.write("a.txt", b"old")
        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(InputError, match=r"the disk is full.*--resume"):
            folder.write("a.txt", b"new and longer")
    assert sorted(os.listdir(tmp_path / "run")) == [".lock", "a.txt", "manifest.json"]
    assert (tmp_path / "run" / "a.txt").read_bytes() == b"old"


def test_second_process_is_refused_and_the_lock_dies_with_its_owner(tmp_path: Path) -> None:
    script = textwrap.dedent(
        """
        import sys, time
        from jaxmodel.io.results import RunDir
        folder = RunDir.create(sys.argv[1], {})
        print("locked", flush=True)
        time.sleep(600)
        """
    )
    owner = subprocess.Popen([sys.executable, "-c", script, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True)
    try:
        assert owner.stdout is not None and owner.stdout.readline() == "locked\n"
        with pytest.raises(InputError, match="another process is running in this folder"):
            RunDir.resume(tmp_path / "run")
    finally:
        owner.kill()
        owner.communicate()
    RunDir.resume(tmp_path / "run").close()


def test_resume_needs_the_folder_of_a_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        RunDir.resume(tmp_path / "run")
    with pytest.raises(InputError, match=r"has no manifest\.json"):
        RunDir.resume(tmp_path)


def test_parts_come_back_and_a_damaged_one_is_redone(tmp_path: Path) -> None:
    with RunDir.create(tmp_path / "run", {}) as folder:
        for number in range(3):
            folder.write_part("case000", number, table(5, 5 * number))
        folder.write_part("case001", 0, table(7))
        assert sorted(folder.read_parts("case000")) == [0, 1, 2]
        assert folder.read_parts("case000")[2].equals(table(5, 10))
        damaged = next((folder.path / "parts").glob("case000-000001-*"))
        damaged.write_bytes(damaged.read_bytes()[:-1])
        assert sorted(folder.read_parts("case000")) == [0, 2]
        assert not damaged.exists()
        assert sorted(folder.read_parts("case001")) == [0]
        folder.remove_parts()
        assert not (folder.path / "parts").exists()


@pytest.mark.parametrize("pieces", [1, 2, 7, 50])
def test_equal_tables_are_equal_bytes_however_they_were_put_together(pieces: int) -> None:
    whole = table(200)
    cuts = np.linspace(0, 200, pieces + 1).astype(int)
    parts = [whole[int(a) : int(b)] for a, b in itertools.pairwise(cuts)]
    assert table_bytes(polars.concat(parts[::-1]).sort("start")) == table_bytes(whole)


def test_json_is_standard() -> None:
    value = {"a": np.float32(0.5), "b": np.array([1.0, np.nan, np.inf]), "c": Path("x"), "d": (np.int64(3), True)}
    assert json.loads(json_text(value)) == {"a": 0.5, "b": [1.0, None, None], "c": "x", "d": [3, True]}
    assert "\n" not in json_text(value, indent=None)


@pytest.mark.parametrize("content", ["", "{", "[1]"])
def test_broken_json_is_bad_input(tmp_path: Path, content: str) -> None:
    (tmp_path / "summary.json").write_text(content)
    with pytest.raises(InputError, match=r"summary\.json"):
        read_json(tmp_path / "summary.json")


def test_finished_needs_table_and_summary(tmp_path: Path) -> None:
    with RunDir.create(tmp_path / "run", {}) as folder:
        folder.write_table("results.parquet", table())
        assert not folder.finished()
        folder.write_json("summary.json", {})
        assert folder.finished()
    assert results.ROW_GROUP > 0
