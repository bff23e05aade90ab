"""Range grids of the Stanford 3D Scanning Repository: ASCII PLY files with a ``range_grid`` element.

trimesh and Open3D read the vertices of such a file but drop the grid, so the grid has its own small reader here.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage

_TO_SENSOR = (0.0, 0.0, 1.0, 0.0)  # Cyberware 3030MS: parallel rays along z, the sensor on the side of +z


@dataclass(frozen=True)
class PlyHeader:
    """What the header of a PLY file promises: format, element counts, property names, ``obj_info`` integers."""

    format: str
    counts: dict[str, int]
    properties: dict[str, tuple[str, ...]]
    info: dict[str, str]
    size: int


def read_ply_header(content: bytes, path: Path) -> PlyHeader:
    """Parse the header at the start of ``content``. Raises :class:`InputError` naming ``path`` and the bad line."""
    if not content.startswith(b"ply"):
        raise InputError(f"{path} is not a PLY file: it starts with {content[:12]!r}, expected 'ply'.")
    end = content.find(b"end_header")
    newline = content.find(b"\n", end)
    if end < 0 or newline < 0:
        raise InputError(f"{path} is truncated: its PLY header has no 'end_header' line.")
    kind = ""
    counts: dict[str, int] = {}
    properties: dict[str, tuple[str, ...]] = {}
    info: dict[str, str] = {}
    element = ""
    for number, line in enumerate(content[:end].decode("latin-1").splitlines(), start=1):
        words = line.split()
        try:
            match words:
                case ["format", kind, *_]:
                    pass
                case ["element", element, count]:
                    counts[element], properties[element] = int(count), ()
                case ["property", *_, name]:
                    properties[element] = (*properties[element], name)
                case ["obj_info", key, *rest]:
                    info[key] = " ".join(rest)
                case _:
                    pass
        except (KeyError, ValueError) as error:
            raise InputError(f"{path}, line {number}: expected a PLY header line, found {line!r}.") from error
    return PlyHeader(format=kind, counts=counts, properties=properties, info=info, size=newline + 1)


def read_range_grid(content: bytes, path: Path) -> RangeImage:
    """A range image from the bytes of a Stanford PLY file with a ``range_grid`` element.

    The grid is row-major, ``num_rows`` rows of ``num_cols`` cells, each ``0`` (no reading) or ``1 i`` (vertex i);
    points are in the scanner's own frame, in the file's unit (metre for the bunny), seen from +z along parallel
    rays. Raises :class:`InputError` naming ``path`` and what was expected and found.
    """
    header = read_ply_header(content, path)
    if header.format != "ascii":
        raise InputError(f"{path} holds a range_grid in format {header.format!r}; expected 'ascii'.")
    rows, columns = (_info_count(header, name, path) for name in ("num_rows", "num_cols"))
    vertex_count = header.counts.get("vertex", 0)
    cell_count = header.counts["range_grid"]
    if cell_count != rows * columns:
        raise InputError(
            f"{path}: expected num_rows x num_cols = {rows} x {columns} = {rows * columns} range_grid cells, "
            f"found {cell_count} in the header."
        )
    if not {"x", "y", "z"} <= set(header.properties["vertex"] if vertex_count else ()):
        raise InputError(f"{path}: expected vertices with properties x, y, z.")
    lines = content[header.size :].split(b"\n")
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) < vertex_count + cell_count:
        vertices, cells = min(len(lines), vertex_count), max(len(lines) - vertex_count, 0)
        raise InputError(
            f"{path} is truncated: expected {vertex_count} vertices and {cell_count} grid cells, "
            f"found {vertices} and {cells}."
        )
    vertices = _vertices(lines[:vertex_count], header.properties["vertex"], path)
    index = _cells(lines[vertex_count : vertex_count + cell_count], vertex_count, path).reshape(rows, columns)
    valid = index >= 0
    points = np.where(valid[..., None], vertices[index], np.nan)
    bad = valid & ~np.isfinite(points).all(axis=-1)
    if bad.any():
        raise InputError(f"{path}: vertex {int(index[bad][0])} (counted from 0) is not finite.")
    return RangeImage(points=points, valid=valid, eye=np.array(_TO_SENSOR))


def _info_count(header: PlyHeader, name: str, path: Path) -> int:
    """The positive integer ``obj_info name``."""
    text = header.info.get(name, "")
    if not text.isdigit() or int(text) == 0:
        raise InputError(f"{path}: expected a header line 'obj_info {name} COUNT', found {text or 'none'!r}.")
    return int(text)


def _vertices(lines: list[bytes], properties: tuple[str, ...], path: Path) -> np.ndarray:
    """Vertex coordinates (n, 3) from the lines of the vertex element."""
    rows = [line.split() for line in lines]
    for number, row in enumerate(rows):
        if len(row) != len(properties):
            raise InputError(
                f"{path}: expected {len(properties)} numbers for vertex {number}, found {lines[number][:40]!r}."
            )
    try:
        table = np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{path}: a vertex is not made of numbers: {error}.") from error
    return table[:, [properties.index(axis) for axis in ("x", "y", "z")]]


def _cells(lines: list[bytes], vertex_count: int, path: Path) -> np.ndarray:
    """Vertex index of each grid cell, -1 where there is no reading."""
    index = np.full(len(lines), -1, dtype=np.int64)
    for number, line in enumerate(lines):
        words = line.split()
        if words == [b"0"]:
            continue
        if len(words) != 2 or words[0] != b"1" or not words[1].isdigit() or int(words[1]) >= vertex_count:
            raise InputError(
                f"{path}: expected '0' or '1 i' with i below {vertex_count} in grid cell {number}, found {line[:40]!r}."
            )
        index[number] = int(words[1])
    return index
