"""A text file whole, or one sentence saying why not."""

from pathlib import Path

from jaxmodel.errors import InputError


def read_text(path: Path) -> str:
    """The content of a UTF-8 text file; a missing or binary one is an :class:`InputError` naming it."""
    if path.is_dir():
        raise InputError(f"{path} is a folder, expected a file")
    if not path.is_file():
        raise InputError(f"There is no file {path}")
    try:
        return path.read_text(encoding="utf-8-sig")
    except (UnicodeDecodeError, OSError) as error:
        raise InputError(f"{path} cannot be read as text: {error}") from error
