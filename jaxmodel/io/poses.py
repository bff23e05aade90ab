"""Pose files: Stanford ``.conf``, JSON and plain 4 x 4 matrices, with their rotations checked."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.io.text_files import read_text

_ROTATION_TOLERANCE = 1e-3  # files print as few as 6 digits; anything further off is not a rotation
SCAN_SUFFIXES = (".ply", ".pcd", ".obj", ".stl", ".npz", ".pts", ".xyz", ".osu", ".rif")


def read_conf(path: str | Path) -> dict[str, Float[np.ndarray, "4 4"]]:
    """The poses of a Stanford ``.conf`` file: ``{scan name: T_world_scan}``, names without their extension.

    A line ``bmesh FILE tx ty tz qx qy qz qw`` (or ``mesh``) stores
    the *inverse* of the turning quaternion, scalar last: ``p_world = R(q)ᵀ p_scan + t``. The ``camera`` line is a
    viewer setting and is skipped. Raises :class:`InputError` naming the file and line.
    """
    path = Path(path)
    poses: dict[str, np.ndarray] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        if not words or words[0] not in ("bmesh", "mesh"):
            continue
        expected = f"{path}, line {number}: expected 'bmesh FILE tx ty tz qx qy qz qw', found {line.strip()!r}."
        if len(words) != 9:
            raise InputError(expected)
        try:
            numbers = np.array(words[2:], dtype=np.float64)
        except ValueError as error:
            raise InputError(expected) from error
        norm = float(np.linalg.norm(numbers[3:]))
        if not np.isfinite(numbers).all() or abs(norm - 1.0) > _ROTATION_TOLERANCE:
            raise InputError(f"{path}, line {number}: expected a unit quaternion, found one of norm {norm:.6g}.")
        T_world_scan = np.eye(4)
        T_world_scan[:3, :3] = quaternion_matrix(numbers[3:] / norm).T
        T_world_scan[:3, 3] = numbers[:3]
        poses[_scan_name(words[1])] = T_world_scan
    if not poses:
        raise InputError(f"{path} holds no 'bmesh FILE tx ty tz qx qy qz qw' line.")
    return poses


def check_conf(path: str | Path) -> dict[str, Path]:
    """The scan files a ``.conf`` names, which must lie beside it: ``{scan name: file}``.

    Raises :class:`InputError` naming the first absent scan and the ``.conf``.
    """
    path = Path(path)
    files: dict[str, Path] = {}
    read_conf(path)
    for line in read_text(path).splitlines():
        words = line.split()
        if words and words[0] in ("bmesh", "mesh"):
            file = path.parent / words[1]
            if not file.is_file():
                raise InputError(f"{path} names the scan {words[1]!r}, but there is no file {file}.")
            files[_scan_name(words[1])] = file
    return files


def quaternion_matrix(xyzw: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix (Hamilton, active, for column vectors) of a unit quaternion, scalar last."""
    x, y, z, w = xyzw
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def load_transform(path: str | Path, key: str = "T_target_source") -> Float[np.ndarray, "4 4"]:
    """A transform from a file: 4 x 4 text, ``.npy``, or JSON (a 4 x 4 list, or an object that has it under ``key``).

    The matrix must be a rigid motion (rotation within 1e-3, last row 0 0 0 1). Raises :class:`InputError` naming
    the file and what is wrong.
    """
    path = Path(path)
    if path.suffix.lower() == ".json":
        value = _read_json(path)
        if isinstance(value, dict):
            if key not in value:
                raise InputError(f"{path}: expected the key {key!r}, found {sorted(value)}.")
            value = value[key]
        return _rigid(value, str(path))
    if path.suffix.lower() == ".npy":
        _require_file(path)
        try:
            return _rigid(np.load(path, allow_pickle=False), str(path))
        except (ValueError, OSError, EOFError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{path} is not a .npy file of a 4 x 4 matrix: {error}.") from error
    try:
        rows = [[float(word) for word in line.replace(",", " ").split()] for line in _content_lines(path)]
    except ValueError as error:
        raise InputError(f"{path}: expected four rows of four numbers: {error}.") from error
    return _rigid(rows, str(path))


def load_truth(path: str | Path, target_path: str | Path, source_path: str | Path) -> Float[np.ndarray, "4 4"]:
    """The true ``T_target_source`` of two scan files.

    ``path`` is a ``.conf``, a JSON file ``{scan name: T_world_scan (4, 4)}`` (names with or without extension), or a
    transform as :func:`load_transform` takes it. Raises :class:`InputError` naming the file and the absent scan.
    """
    poses = _named_poses(Path(path))
    if poses is None:
        return load_transform(path)
    T_world_target, T_world_source = (_pose_of(poses, Path(p), Path(path)) for p in (target_path, source_path))
    return relative_pose(T_world_target, T_world_source)


def load_scan_poses(path: str | Path, scans: Sequence[str | Path]) -> list[Float[np.ndarray, "4 4"]]:
    """``T_world_scan`` of each scan file, from a ``.conf`` or a JSON of poses (see :func:`load_truth`).

    Raises :class:`InputError` naming the file and the absent scan.
    """
    path = Path(path)
    poses = _named_poses(path)
    if poses is None:
        raise InputError(f"{path}: expected a Stanford .conf, or JSON {{scan name: T_world_scan, 4 x 4}}.")
    return [_pose_of(poses, Path(scan), path) for scan in scans]


def _named_poses(path: Path) -> dict[str, Float[np.ndarray, "4 4"]] | None:
    """The poses of a file that names its scans, None for any other."""
    if path.suffix.lower() == ".conf":
        return read_conf(path)
    if path.suffix.lower() == ".json" and isinstance(value := _read_json(path), dict) and _holds_poses(value):
        return {_scan_name(name): _rigid(matrix, f"{path}, scan {name!r}") for name, matrix in value.items()}
    return None


def relative_pose(
    T_world_target: Float[np.ndarray, "4 4"], T_world_source: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "4 4"]:
    """``T_target_source`` of two rigid poses in one world frame."""
    R, t = T_world_target[:3, :3], T_world_target[:3, 3]
    T_target_source = np.eye(4)
    T_target_source[:3, :3] = R.T @ T_world_source[:3, :3]
    T_target_source[:3, 3] = R.T @ (T_world_source[:3, 3] - t)
    return T_target_source


def save_transform(path: str | Path, T_target_source: Float[np.ndarray, "4 4"], **fields: object) -> None:
    """Write JSON with ``T_target_source`` and ``fields`` (JSON values); :func:`load_transform` reads it back."""
    content = {"T_target_source": np.asarray(T_target_source, dtype=np.float64).tolist(), **fields}
    Path(path).write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _holds_poses(value: dict) -> bool:
    return "T_target_source" not in value


def _scan_name(name: str) -> str:
    """A scan's name without folder and without the extension of a scan file."""
    base = Path(name)
    return base.stem if base.suffix.lower() in SCAN_SUFFIXES else base.name


def _pose_of(poses: dict[str, np.ndarray], scan: Path, path: Path) -> np.ndarray:
    for name in (scan.stem, scan.name):
        if name in poses:
            return poses[name]
    raise InputError(f"{path} has no pose for the scan {scan.name!r}; it has {', '.join(sorted(poses))}.")


def _rigid(value: object, where: str) -> Float[np.ndarray, "4 4"]:
    try:
        T = np.array(value, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(f"{where}: expected a 4 x 4 matrix of numbers.") from error
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InputError(f"{where}: expected a 4 x 4 matrix of finite numbers, found shape {T.shape}.")
    R = T[:3, :3]
    off = float(np.abs(R.T @ R - np.eye(3)).max())
    if off > _ROTATION_TOLERANCE or np.linalg.det(R) < 0 or np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise InputError(
            f"{where}: expected a rigid motion; R'R is off the identity by {off:.3g}, det R = {np.linalg.det(R):.3g}, "
            f"last row {T[3].tolist()}."
        )
    return T


def _require_file(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"There is no file {path}.")


def _content_lines(path: Path) -> list[str]:
    return [line for line in read_text(path).splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _read_json(path: Path) -> object:
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise InputError(f"{path} is not JSON: {error}.") from error
