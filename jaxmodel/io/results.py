"""A run's folder: one owner at a time, every file written whole or not at all, and a killed run picks up where it was.

::

    DIR/.lock              held by the running process, released by the kernel when it dies
    DIR/manifest.json      what was asked and on what machine (run/provenance.py fills it)
    DIR/parts/*.parquet    one finished chunk each, its content hash in the name; gone when the run is complete
    DIR/results.parquet    the table, rows in canonical order: the same bytes for any chunking, order or resume
    DIR/summary.json       what came out, times included
"""

import errno
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import polars

from jaxmodel.errors import InputError

ROW_GROUP = 8192
"""Rows of one parquet row group: fixed, so the same table is the same bytes."""


class RunDir:
    """The folder of one run, locked for this process until ``close`` (or the end of a ``with`` block).

    Make one with ``create`` (a new folder) or ``resume`` (an existing one).
    """

    def __init__(self, path: Path, lock: int) -> None:
        self.path = path
        self._lock = lock

    @staticmethod
    def refuse(path: str | Path, bytes_needed: int = 0) -> None:
        """Raise the ``InputError`` that ``create`` would, before any work is done and without leaving a trace."""
        path = Path(path)
        if os.path.lexists(path):
            raise InputError(f"{path}: already exists; choose another folder, or continue its run with --resume {path}")
        parent = _existing_parent(path)
        if not parent.is_dir():
            raise InputError(f"{path}: cannot be made, {parent} is not a folder")
        if not os.access(parent, os.W_OK | os.X_OK):
            raise InputError(f"{path}: cannot be made, the folder {parent} is not writable")
        free = shutil.disk_usage(parent).free
        if free < bytes_needed:
            raise InputError(
                f"{path}: the disk is full, this run needs about {bytes_needed / 1e6:.0f} MB "
                f"and {free / 1e6:.0f} MB are free"
            )

    @classmethod
    def create(cls, path: str | Path, manifest: Mapping[str, Any], bytes_needed: int = 0) -> "RunDir":
        """Make the folder and write its manifest; an existing, unwritable or full place is an ``InputError``."""
        path = Path(path)
        cls.refuse(path, bytes_needed)
        with _readable_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                path.mkdir()
            except FileExistsError:
                raise InputError(f"{path}: already exists, another process made it just now") from None
        try:
            run = cls(path, _take_lock(path))
            run.write_json("manifest.json", manifest)
        except BaseException:
            shutil.rmtree(path, ignore_errors=True)
            raise
        return run

    @classmethod
    def resume(cls, path: str | Path) -> "RunDir":
        """Open the folder of an earlier run; refused while another process holds it, or if it is no run's folder."""
        path = Path(path)
        if not path.is_dir():
            raise InputError(f"{path}: no such folder, nothing to resume")
        if not (path / "manifest.json").is_file():
            raise InputError(f"{path}: has no manifest.json, so it is not the folder of a run that can be resumed")
        return cls(path, _take_lock(path))

    def __enter__(self) -> "RunDir":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the lock."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def write(self, name: str, content: bytes) -> Path:
        """Write ``DIR/name`` atomically: readers see the old file or the whole new one, never a part."""
        target = self.path / name
        with _readable_errors(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(target, content)
        return target

    def write_json(self, name: str, value: Any) -> Path:
        """As ``write``, for a plain tree; not-a-number becomes null, so the file is standard JSON."""
        return self.write(name, json_text(value).encode())

    def write_table(self, name: str, table: polars.DataFrame) -> Path:
        """As ``write``, for a table; equal tables give equal bytes."""
        return self.write(name, table_bytes(table))

    def read_json(self, name: str) -> dict[str, Any]:
        """Read ``DIR/name``; missing or broken is an ``InputError``."""
        return read_json(self.path / name)

    def finished(self) -> bool:
        """Whether the run reached its end: the summary is the last thing written."""
        return (self.path / "summary.json").is_file() and (self.path / "results.parquet").is_file()

    def write_part(self, case: str, chunk: int, table: polars.DataFrame) -> None:
        """Keep one finished chunk of a case."""
        content = table_bytes(table)
        self.write(f"parts/{case}-{chunk:06d}-{_digest(content)}.parquet", content)

    def read_parts(self, case: str) -> dict[int, polars.DataFrame]:
        """The finished chunks of a case by number; one whose bytes do not match its hash is dropped, to be redone."""
        parts = {}
        for path in sorted((self.path / "parts").glob(f"{case}-*.parquet")):
            _, number, digest = path.stem.rsplit("-", 2)
            if _digest(path.read_bytes()) == digest:
                parts[int(number)] = polars.read_parquet(path)
            else:
                path.unlink()
        return parts

    def remove_parts(self) -> None:
        """Delete the parts, once the table that holds their rows is written."""
        shutil.rmtree(self.path / "parts", ignore_errors=True)


def write_atomically(target: Path, content: bytes) -> None:
    """Write beside the target, flush to disk, rename; on failure the half-written file is removed."""
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


def table_bytes(table: polars.DataFrame) -> bytes:
    """A table as parquet with every writer setting fixed: equal tables give equal bytes."""
    import io

    buffer = io.BytesIO()
    table.rechunk().write_parquet(
        buffer, compression="zstd", compression_level=3, row_group_size=ROW_GROUP, statistics=True
    )
    return buffer.getvalue()


def json_text(value: Any, indent: int | None = 2) -> str:
    """Standard JSON (no NaN, no infinity: they become null), keys in the order given."""
    return json.dumps(_plain(value), indent=indent, ensure_ascii=False, allow_nan=False) + ("\n" if indent else "")


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON mapping; missing or broken is an ``InputError``."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file, so {path.parent} holds no finished run") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not readable as JSON ({error})") from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: expected a JSON mapping")
    return value


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not (abs(value) < float("inf")):
        return None
    return str(value) if isinstance(value, Path) else value


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:24]


def _existing_parent(path: Path) -> Path:
    parent = path.absolute().parent
    while not os.path.lexists(parent) and parent != parent.parent:
        parent = parent.parent
    return parent


def _take_lock(path: Path) -> int:
    with _readable_errors(path):
        lock = os.open(path / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        raise InputError(f"{path}: another process is running in this folder; wait for it, or stop it first") from None
    return lock


@contextmanager
def _readable_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise InputError(f"{path}: the disk is full; free some space, then continue with --resume") from error
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
