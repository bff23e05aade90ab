"""``jaxmodel data``: which public data sets are known, where they were found, and fetching the bunny scans."""

import os
import shutil
import tarfile
import tempfile
from pathlib import Path

from jaxmodel.errors import InputError, RunError
from jaxmodel.io.datasets import data_root
from jaxmodel.io.results import json_text
from jaxmodel.run.arguments import DataFetch, DataList
from jaxmodel.run.console import write

BUNNY = "http://graphics.stanford.edu/pub/3Dscanrep/bunny.tar.gz"
_KNOWN = {"stanford_bunny": ("stanford_bunny/data/bun.conf", "ten range scans and their poses (metre), Stanford")}


def run(action: DataList | DataFetch) -> None:
    """``jaxmodel data list`` or ``jaxmodel data fetch``."""
    if isinstance(action, DataFetch):
        _fetch(action)
    else:
        _list(action)


def _list(action: DataList) -> None:
    root = data_root()
    found = {name: root is not None and (root / proof).is_file() for name, (proof, _) in _KNOWN.items()}
    write(f"data folder: {root or 'none, set JAXMODEL_DATA'}")
    for name, (_, what) in _KNOWN.items():
        write(f"{name}: {'found' if found[name] else 'not found, get it with jaxmodel data fetch'} ({what})")
    write("objects: built in, no file needed")
    if action.json:
        write(json_text({"status": "ok", "root": str(root) if root else None, "found": found}, indent=None))


def _fetch(action: DataFetch) -> None:
    root = action.to or Path(os.environ.get("JAXMODEL_DATA") or "data")
    place = root / "stanford_bunny"
    if place.exists():
        raise InputError(f"{place}: already exists, nothing fetched")
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{root}: cannot be made ({error.strerror})") from None
    with tempfile.TemporaryDirectory(dir=root, prefix=".fetch-") as scratch:
        archive = download(BUNNY, Path(scratch))
        try:
            with tarfile.open(archive) as content:
                content.extractall(scratch, filter="data")
        except (tarfile.TarError, OSError) as error:
            raise RunError(f"{BUNNY}: the archive could not be unpacked ({error})") from None
        if not (Path(scratch) / "bunny" / "data" / "bun.conf").is_file():
            raise RunError(f"{BUNNY}: the archive holds no bunny/data/bun.conf")
        shutil.move(str(Path(scratch) / "bunny"), str(place))
    write(f"wrote {place}; let JAXMODEL_DATA={root.absolute()} so that it is found")
    if action.json:
        write(json_text({"status": "ok", "out": str(place)}, indent=None))


def download(address: str, folder: Path) -> Path:
    """Fetch one file; any failure of the network is a ``RunError`` of one sentence."""
    import logging

    import pooch

    pooch.get_logger().setLevel(logging.ERROR)
    try:
        name = pooch.retrieve(address, known_hash=None, fname=address.rsplit("/", 1)[-1], path=folder)
    except Exception as error:
        reason = " ".join(str(error).split())[:160]
        raise RunError(f"{address}: could not be fetched, check the network ({reason})") from None
    return Path(str(name))
