"""Fetching: whole or not at all, and one sentence when the network is not there."""

import io
import tarfile
from pathlib import Path

import pooch
import pytest

from jaxmodel.run.cli import execute


def bunny_archive(path: Path, member: str = "bunny/data/bun.conf") -> Path:
    with tarfile.open(path, "w:gz") as archive:
        content = b"bmesh bun000.ply 0 0 0 0 0 0 1\n"
        entry = tarfile.TarInfo(member)
        entry.size = len(content)
        archive.addfile(entry, io.BytesIO(content))
    return path


def test_fetch_unpacks_where_it_is_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    archive = bunny_archive(tmp_path / "bunny.tar.gz")
    monkeypatch.setattr(pooch, "retrieve", lambda *_, **__: str(archive))
    assert execute(["data", "fetch", "--to", str(tmp_path / "data")]) == 0
    assert (tmp_path / "data" / "stanford_bunny" / "data" / "bun.conf").is_file()
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["stanford_bunny"]
    assert execute(["data", "fetch", "--to", str(tmp_path / "data")]) == 2
    assert "already exists" in capsys.readouterr().err


def test_no_network_is_one_sentence_and_code_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ConnectionError("no route\nto host")

    monkeypatch.setattr(pooch, "retrieve", fail)
    assert execute(["data", "fetch", "--to", str(tmp_path / "data")]) == 1
    shown = capsys.readouterr().err
    assert "could not be fetched" in shown and shown.count("\n") == 1
    assert list((tmp_path / "data").iterdir()) == []


@pytest.mark.parametrize("member", ["other/file", "bunny/readme"])
def test_an_archive_of_something_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], member: str
) -> None:
    archive = bunny_archive(tmp_path / "bunny.tar.gz", member)
    monkeypatch.setattr(pooch, "retrieve", lambda *_, **__: str(archive))
    assert execute(["data", "fetch", "--to", str(tmp_path / "data")]) == 1
    assert "holds no bunny/data/bun.conf" in capsys.readouterr().err
    assert list((tmp_path / "data").iterdir()) == []
