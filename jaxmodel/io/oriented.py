"""Clouds with the normals their files give; :func:`load_scan` reads PLY, OBJ and text for the positions alone."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.io.scans import load_scan
from jaxmodel.io.stanford import read_ply_header
from jaxmodel.io.text_files import read_text
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage

_UNIT = 0.01
"""How far from 1 the length of a column's triple may be and still be a normal: colours and intensities are not."""


def load_oriented(path: str | Path) -> RangeImage | Cloud:
    """As :func:`load_scan`, the cloud with its normals, as the file has them, where it has one for each point.

    PLY: properties ``nx ny nz``. OBJ: as many ``vn`` as ``v``, in their order. Text: columns 4 to 6, if there are
    just six and each triple has length 1. A cloud without keeps None.
    """
    path = Path(path)
    scan = load_scan(path)
    if isinstance(scan, RangeImage) or scan.normals is not None:
        return scan
    match path.suffix.lower():
        case ".ply":
            normals = _ply_normals(path, len(scan))
            return scan if normals is None else Cloud(points=scan.points, normals=normals)
        case ".obj":
            return _obj_cloud(path) or scan
        case ".xyz" | ".txt" | ".asc" | ".csv":
            normals = _column_normals(path, len(scan))
            return scan if normals is None else Cloud(points=scan.points, normals=normals)
        case _:
            return scan


def _ply_normals(path: Path, count: int) -> Float[np.ndarray, "n 3"] | None:
    header = read_ply_header(path.read_bytes(), path)
    if not {"nx", "ny", "nz"} <= set(header.properties["vertex"]):
        return None
    import open3d

    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        cloud = open3d.io.read_point_cloud(str(path), remove_nan_points=False, remove_infinite_points=False)
    normals = np.array(cloud.normals, dtype=np.float64)
    if len(normals) != count:
        raise InputError(f"{path} is damaged: expected {count} normals, found {len(normals)}.")
    return normals


def _obj_cloud(path: Path) -> Cloud | None:
    """The distinct vertices of an OBJ and their normals, or None where the two lists do not run side by side."""
    rows: dict[str, list[list[float]]] = {"v": [], "vn": []}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if words[0] in rows:
            try:
                rows[words[0]].append([float(word) for word in words[1:4]])
            except ValueError:
                raise InputError(f"{path}, line {number}: expected three numbers, found {line[:60]!r}.") from None
        elif words[0] == "f" and any(not _alike(corner) for corner in words[1:]):
            return None
    if not rows["vn"] or len(rows["v"]) != len(rows["vn"]):
        return None
    points, normals = np.array(rows["v"], dtype=np.float64), np.array(rows["vn"], dtype=np.float64)
    _, first = np.unique(points, axis=0, return_index=True)
    first = np.sort(first)
    return Cloud(points=points[first], normals=normals[first])


def _alike(corner: str) -> bool:
    """Whether a corner ``vertex/texture/normal`` names the normal of its vertex, or none."""
    vertex, *rest = corner.split("/")
    return len(rest) < 2 or vertex == rest[1]


def _column_normals(path: Path, count: int) -> Float[np.ndarray, "n 3"] | None:
    rows = []
    for line in read_text(path).splitlines():
        words = line.replace(",", " ").replace(";", " ").split()
        if words and not words[0].startswith(("#", "//")):
            rows.append(words[3:])
    if len(rows) != count or any(len(row) != 3 for row in rows):
        return None
    try:
        normals = np.array(rows, dtype=np.float64)
    except ValueError:
        return None
    return normals if bool((np.abs(np.linalg.norm(normals, axis=1) - 1) < _UNIT).all()) else None
