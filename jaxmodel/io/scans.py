"""One reader for every scan file: by extension, and by content where an extension says too little."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.io.hoppe import read_hoppe
from jaxmodel.io.osu import looks_like_osu, read_osu
from jaxmodel.io.stanford import read_ply_header, read_range_grid
from jaxmodel.scan.cloud import Cloud, check_points
from jaxmodel.scan.range_image import RangeImage


def load_scan(path: str | Path) -> RangeImage | Cloud:
    """The scan in a file: a :class:`RangeImage` where the file holds a grid, else a :class:`Cloud`.

    Range images: Stanford PLY with a ``range_grid``, OSU/MSU text (``.osu .rif .dat .txt``, by content), NPZ with
    ``points`` of shape (h, w, 3) (NaN where there is no reading; optional ``valid`` and ``eye``). Clouds: PLY,
    PCD, OBJ, STL (vertices, repeated ones once), XYZ text (3 or more columns, ``.xyz .txt .dat .asc .csv``), NPZ
    with ``points`` (n, 3) and optional ``normals``, Hoppe's ``.pts``. Coordinates stay in the file's frame and unit.

    Raises :class:`InputError`, one sentence naming the file: absent, unknown extension, truncated, NaN or
    infinite points (row named), fewer than three, all equal.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: unknown extension {path.suffix!r}; known are {', '.join(sorted(_READERS))}.")
    if not path.is_file():
        raise InputError(f"There is no file {path}." if not path.is_dir() else f"{path} is a folder, expected a file.")
    try:
        if path.stat().st_size == 0:
            raise InputError(f"{path} is empty.")
        scan = reader(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    points = scan.points if isinstance(scan, Cloud) else scan.points[scan.valid]
    check_points(points, str(path))
    return scan


def _load_ply(path: Path) -> RangeImage | Cloud:
    content = path.read_bytes()
    header = read_ply_header(content, path)
    if "range_grid" in header.counts:
        return read_range_grid(content, path)
    if header.counts.get("vertex", 0) == 0:
        raise InputError(f"{path} is empty: expected at least 3 vertices, its header promises none.")
    from jaxmodel.io.meshes import load_vertices

    promised = " and ".join(f"{count} {element} rows" for element, count in header.counts.items())
    if header.format == "ascii":
        found = sum(1 for line in content[header.size :].splitlines() if line.strip())
        if found < sum(header.counts.values()):
            raise InputError(f"{path} is truncated: expected {promised}, found {found} rows in all.")
    try:
        points = load_vertices(path)
    except InputError as error:
        held = len(content) - header.size
        raise InputError(f"{path} is truncated or damaged: expected {promised}, found {held} bytes of them.") from error
    if len(points) != (expected := header.counts.get("vertex", 0)):
        raise InputError(f"{path} is damaged: expected {expected} vertices, found {len(points)}.")
    return Cloud(points=points)


def _load_mesh_vertices(path: Path) -> Cloud:
    from jaxmodel.io.meshes import load_vertices

    _, first = np.unique(points := load_vertices(path), axis=0, return_index=True)
    return Cloud(points=points[np.sort(first)])


def _load_pcd(path: Path) -> Cloud:
    from jaxmodel.io.pcd import load_pcd

    return load_pcd(path)


def _load_hoppe(path: Path) -> Cloud:
    return Cloud(points=read_hoppe(_text(path), path))


def _load_osu(path: Path) -> RangeImage:
    return read_osu(_text(path), path)


def _load_text(path: Path) -> RangeImage | Cloud:
    text = _text(path)
    return read_osu(text, path) if looks_like_osu(text) else _columns(text, path)


def _load_xyz(path: Path) -> Cloud:
    return _columns(_text(path), path)


def _load_npz(path: Path) -> RangeImage | Cloud:
    try:
        # Opened here: numpy leaves its own handle open when the archive is damaged.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, EOFError, zipfile.BadZipFile, AttributeError, TypeError) as error:
        raise InputError(f"{path} is not a readable NPZ archive of numbers: {error}.") from error
    if "points" not in arrays:
        raise InputError(f"{path}: expected an array 'points', found {sorted(arrays)}.")
    points = arrays["points"]
    if points.ndim != 3:
        points = check_points(points, str(path))
        normals = arrays.get("normals")
        if normals is not None and (normals.shape != points.shape or normals.dtype.kind != "f"):
            raise InputError(f"{path}: expected normals of shape {points.shape}, found {normals.shape}.")
        return Cloud(points=points, normals=normals)
    if points.shape[2] != 3 or points.dtype.kind != "f":
        raise InputError(f"{path}: expected points (h, w, 3) of floats, found {points.dtype} {points.shape}.")
    valid = arrays.get("valid", np.isfinite(points).all(axis=2))
    eye = arrays.get("eye", np.array([0.0, 0.0, 0.0, 1.0]))
    if valid.shape != points.shape[:2] or eye.shape != (4,):
        raise InputError(f"{path}: expected valid {points.shape[:2]} and eye (4,), found {valid.shape}, {eye.shape}.")
    valid = valid.astype(bool)
    return RangeImage(np.where(valid[..., None], points, np.nan), valid, eye.astype(np.float64))


def _columns(text: str, path: Path) -> Cloud:
    """Rows of three or more numbers; further columns are ignored, ``#`` and ``//`` start comments."""
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or words[0].startswith(("#", "//")):
            continue
        try:
            rows.append([float(words[0]), float(words[1]), float(words[2])])
        except (ValueError, IndexError):
            raise InputError(f"{path}, line {number}: expected 'x y z', found {line[:60]!r}.") from None
    return Cloud(points=np.array(rows, dtype=np.float64).reshape(-1, 3))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file: byte {error.start} is not UTF-8.") from error


_READERS: dict[str, Callable[[Path], RangeImage | Cloud]] = {
    ".ply": _load_ply,
    ".pcd": _load_pcd,
    ".obj": _load_mesh_vertices,
    ".stl": _load_mesh_vertices,
    ".npz": _load_npz,
    ".pts": _load_hoppe,
    ".osu": _load_osu,
    ".rif": _load_osu,
    ".dat": _load_text,
    ".txt": _load_text,
    ".xyz": _load_xyz,
    ".asc": _load_xyz,
    ".csv": _load_xyz,
}
