"""The files of a mesh: named after it, refused before the work begins, written all or none."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from jaxmodel.errors import InputError
from jaxmodel.io.mesh_writing import WRITTEN_SUFFIXES


class Places(NamedTuple):
    """Where the files of one mesh go; the mesh itself is the last to be written."""

    mesh: Path
    quality: Path
    segments: Path
    report: Path


def places_of(out: Path | None) -> Places:
    """The files beside ``out``. Raises :class:`InputError` without one, or for an extension that is no mesh's."""
    known = ", ".join(WRITTEN_SUFFIXES)
    if out is None:
        raise InputError(f"--out is required: the file of the mesh, ending in one of {known}")
    if out.suffix.lower() not in WRITTEN_SUFFIXES:
        raise InputError(f"--out {out}: expected a file ending in one of {known}, found {out.suffix or 'no ending'!r}")
    return Places(out, *(out.with_suffix(f".{name}") for name in ("quality.json", "segments.json", "report.html")))


def refuse(places: Places, inputs: Sequence[Path], overwrite: bool) -> None:
    """Raise :class:`InputError` if a file is in the way, or cannot be written; nothing is touched."""
    for place in places:
        for given in inputs:
            if given.exists() and place.exists() and place.samefile(given):
                raise InputError(f"--out {places.mesh}: {place} is one of the inputs; choose another name")
        if place.is_dir():
            raise InputError(f"{place}: is a folder, expected the name of a file")
        if os.path.lexists(place) and not overwrite:
            raise InputError(f"{place}: already exists; choose another name, or replace it with --overwrite")
    parent = places.mesh.absolute().parent
    if not parent.is_dir():
        raise InputError(f"{places.mesh}: cannot be written, there is no folder {parent}")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"{places.mesh}: cannot be written, the folder {parent} is not writable")


def write_all(contents: Mapping[Path, bytes], stale: Sequence[Path]) -> None:
    """Write all files or none: each whole under another name first, then renamed. ``stale`` ones are removed."""
    waiting = {place: place.with_name(f".{place.name}.{os.getpid()}.tmp") for place in contents}
    place = next(iter(contents))
    try:
        for place, content in contents.items():
            with open(waiting[place], "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        for place in contents:
            os.replace(waiting[place], place)
        for place in stale:
            place.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{place}: cannot be written ({error.strerror or error})") from error
    finally:
        for temporary in waiting.values():
            with suppress(OSError):
                temporary.unlink()
