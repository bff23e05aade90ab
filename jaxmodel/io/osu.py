"""Text range images of the OSU/MSU range data base: a three-line header, then flag, X, Y and Z images."""

import re
from pathlib import Path

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage

_TO_SENSOR = (0.0, 0.0, 1.0, 0.0)  # the sensor looks down on the XY plane, Z is height towards it
_ROWS = r"(?:rows?|height)"
_COLUMNS = r"(?:col(?:umn)?s?|width)"
_INTEGER = re.compile(r"(?<![\w.+-])\d+(?![\w.])")


def read_osu(text: str, path: Path) -> RangeImage:
    """The range image in the text of an OSU/MSU file, in the sensor's frame and the file's unit.

    The first three lines are the header. The rows and columns are the integers that stand beside the words
    ``row(s)``/``height`` and ``col(s)``/``column(s)``/``width`` (before or after, in any line: ``200 rows``,
    ``rows: 200``, ``200 rows 240 columns``, ``rows 200`` / ``cols 240``), or, where there are no such words, the
    first two integers of the header, rows first (``200 240``, ``rows x columns: 200 x 240``). The rest is
    ``4 · rows · columns`` numbers separated by white space, line breaks free: the flag image (0 = no reading),
    then X, Y and Z, each row-major. Seen from +z along parallel rays. Raises :class:`InputError` naming ``path``.
    """
    lines = text.split("\n", 3)
    shape = _shape(lines[:3]) if len(lines) == 4 else None
    if shape is None:
        raise InputError(f"{path} is not an OSU range image: expected three header lines holding rows and columns.")
    rows, columns = shape
    words = lines[3].split()
    expected = 4 * rows * columns
    if len(words) != expected:
        state = "is truncated" if len(words) < expected else "is too long"
        raise InputError(
            f"{path} {state}: expected 4 images of {rows} x {columns} = {expected} numbers after the header, "
            f"found {len(words)}."
        )
    try:
        flag, x, y, z = np.array(words, dtype=np.float64).reshape(4, rows, columns)
    except ValueError as error:
        raise InputError(f"{path}: a value after the header is not a number: {error}.") from error
    valid = np.isfinite(flag) & (flag != 0)
    points = np.stack([x, y, z], axis=-1)
    bad = valid & ~np.isfinite(points).all(axis=-1)
    if bad.any():
        row, column = (int(i[0]) for i in np.nonzero(bad))
        raise InputError(f"{path}: the pixel in row {row}, column {column} is flagged valid but is not finite.")
    return RangeImage(np.where(valid[..., None], points, np.nan), valid, np.array(_TO_SENSOR))


def write_osu(path: str | Path, image: RangeImage) -> None:
    """Write ``image`` in the OSU/MSU text format, readable back to the last bit by :func:`read_osu`.

    The format has no sensor position, so ``image.eye`` is not kept; pixels without reading become 0 0 0.
    """
    h, w = image.valid.shape
    points = np.where(image.valid[..., None], image.points, 0.0)
    out = [f"{h} rows", f"{w} columns", "pixels (flag, x, y, z)"]
    out += [" ".join(str(int(flag)) for flag in row) for row in image.valid]
    for axis in range(3):
        out += [" ".join(repr(float(value)) for value in row) for row in points[..., axis]]
    Path(path).write_text("\n".join(out) + "\n", encoding="utf-8")


def looks_like_osu(text: str) -> bool:
    """Whether a text starts with an OSU/MSU header rather than with points.

    It does when its first three lines name both rows and columns in words, or when the first line is exactly two
    positive integers and the next two are no rows of numbers.
    """
    lines = text.split("\n", 3)
    if len(lines) < 4:
        return False
    if all(_beside("\n".join(lines[:3]), word) is not None for word in (_ROWS, _COLUMNS)):
        return True
    return re.fullmatch(r"\s*\d+\s+\d+\s*", lines[0]) is not None and not any(
        re.fullmatch(r"\s*[-+.\deE]+(\s+[-+.\deE]+)+\s*", line) for line in lines[1:3]
    )


def _shape(header: list[str]) -> tuple[int, int] | None:
    """Rows and columns named in the header, or None."""
    joined = "\n".join(header)
    rows, columns = _beside(joined, _ROWS), _beside(joined, _COLUMNS)
    if rows is None or columns is None:
        numbers = [int(word) for word in _INTEGER.findall(joined)]
        if len(numbers) < 2:
            return None
        rows, columns = numbers[:2]
    return (rows, columns) if rows > 0 and columns > 0 else None


def _beside(text: str, word: str) -> int | None:
    """The integer just before or just after ``word`` on its line."""
    for line in text.splitlines():
        # "200 rows 240 columns": a number before the word wins when the line starts with a number.
        before = re.search(rf"(?<![\w.+-])(\d+)[ \t]*{word}\b", line, re.IGNORECASE)
        after = re.search(rf"\b{word}[ \t]*[:=]?[ \t]*(\d+)\b", line, re.IGNORECASE)
        starts_with_number = re.match(r"\s*\d", line) is not None
        for match in (before, after) if starts_with_number else (after, before):
            if match is not None:
                return int(match.group(1))
    return None
