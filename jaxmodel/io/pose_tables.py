"""Pose files that are tables of text: commas, semicolons, tabs or spaces, with or without a row of names."""

import re
from collections.abc import Sequence
from pathlib import Path

from jaxmodel.errors import InputError
from jaxmodel.io.pose_columns import POSITION, ROLL_PITCH_YAW, STREAMS, Column, read_name, unnamed
from jaxmodel.io.pose_values import Row
from jaxmodel.io.text_files import read_text

Table = tuple[list[Column], list[Row]]


def read_table(path: Path, quaternion: str) -> Table:
    """The columns and rows of a table; lines that begin with # are comments.

    Three forms: a first row of names; numbers alone, told by their count; and lines that begin with the name of their
    stream (``hand``, then ``eye``), which become one row for each two. Four lines of four numbers are a 4 x 4 matrix.
    Raises :class:`InputError` naming the line and what is wrong.
    """
    lines = [
        Row(f"line {number}", _cells(line))
        for number, line in enumerate(read_text(path).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise InputError(f"{path}: holds no poses, the file is empty")
    first = lines[0].values
    if first[0].lower() in STREAMS and len(first) > 1 and all(_is_number(word) for word in first[1:]):
        return _labelled(path, lines)
    if not any(_is_number(word) for word in first):
        columns, lines = [read_name(word, f"{path}, {lines[0].place}") for word in first], lines[1:]
        if not lines:
            raise InputError(f"{path}: holds no poses, only a row of names")
    else:
        if len(first) == 4:
            lines = _blocks(path, lines)
        columns = unnamed(len(lines[0].values), "wxyz" if quaternion == "wxyz" else "xyzw", f"{path}, {lines[0].place}")
    _check_widths(path, lines, len(columns))
    return columns, lines


def _labelled(path: Path, lines: Sequence[Row]) -> Table:
    """Lines of two streams in turn: the hand's, then the camera's."""
    rows = []
    for k, line in enumerate(lines):
        wanted = "hand" if k % 2 == 0 else "camera"
        if STREAMS.get(line.values[0].lower()) != wanted:
            raise InputError(
                f"{path}, {line.place}: expected a line of the {wanted}'s pose, found {line.values[0]!r}; the lines "
                "must alternate, hand first"
            )
    if len(lines) % 2:
        raise InputError(f"{path}, {lines[-1].place}: the last line of the hand has no line of the camera after it")
    width = len(lines[0].values)
    _check_widths(path, lines, width)
    names = (*POSITION, *ROLL_PITCH_YAW) if width == 7 else [c.quantity for c in unnamed(width - 1, "xyzw", str(path))]
    columns = [Column(stream, name) for stream in ("hand", "camera") for name in names]
    for hand, camera in zip(lines[::2], lines[1::2], strict=True):
        place = f"lines {hand.place.removeprefix('line ')} and {camera.place.removeprefix('line ')}"
        rows.append(Row(place, [*hand.values[1:], *camera.values[1:]]))
    return columns, rows


def _blocks(path: Path, lines: Sequence[Row]) -> list[Row]:
    """Four lines of four numbers: one matrix."""
    _check_widths(path, lines, 4)
    if len(lines) % 4:
        raise InputError(f"{path}, {lines[-1].place}: a 4 x 4 matrix has four lines, the last has {len(lines) % 4}")
    groups = [lines[k : k + 4] for k in range(0, len(lines), 4)]
    return [Row(group[0].place, [value for line in group for value in line.values]) for group in groups]


def _check_widths(path: Path, lines: Sequence[Row], width: int) -> None:
    for line in lines:
        if len(line.values) != width:
            raise InputError(f"{path}, {line.place}: expected {width} values, found {len(line.values)}")


def _cells(line: str) -> list[str]:
    for separator in (",", ";", "\t"):
        if separator in line:
            return [cell.strip().strip('"') for cell in line.strip().removesuffix(separator).split(separator)]
    return re.split(r"\s+", line.strip())


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
