"""Hand-eye pose files: one reader for each form, each checked, its conventions stated.

Every reader returns poses as 4 x 4 float64 matrices. What the poses are (T_base_hand, T_camera_target, ...) is the
set-up's business, not the file's, unless the file says so.
"""

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import yaml
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.opencv_storage import read_opencv_storage
from jaxmodel.io.text_files import read_text

Angle = Literal["deg", "rad"]
ROTATION_TOLERANCE = 1e-3
QUATERNION = ("qx", "qy", "qz", "qw")
EULER = ("rx", "ry", "rz")
POSITION = ("x", "y", "z")


@dataclass(frozen=True)
class PosePairs:
    """Both streams, row by row. ``times`` in seconds where the file has them."""

    hand: Float[np.ndarray, "n 4 4"]
    camera: Float[np.ndarray, "n 4 4"]


@dataclass(frozen=True)
class TimedPoses:
    """One stream with its times in seconds, as the file has them (not sorted, repeats kept)."""

    times: Float[np.ndarray, " n"]
    poses: Float[np.ndarray, "n 4 4"]


def read_timed_csv(path: str | Path) -> TimedPoses:
    """Rows ``t, x, y, z, qx, qy, qz, qw``: seconds, the file's length unit, Hamilton quaternion with its scalar last.

    A first row of names is allowed and then checked. Raises :class:`InputError` naming the row and what is wrong.
    """
    path = Path(path)
    rows = _csv_rows(path)
    expected = ("t", *POSITION, *QUATERNION)
    if rows and not _is_number(rows[0][1][0]):
        names = tuple(word.strip().lower() for word in rows[0][1])
        if names != expected:
            raise InputError(f"{path}, line {rows[0][0]}: expected the columns {', '.join(expected)}, found {names}.")
        rows = rows[1:]
    values = _numbers(path, rows, 8, ", ".join(expected))
    _check_quaternions(path, rows, values[:, 4:])
    return TimedPoses(values[:, 0], se3.compose(Rotation.from_quat(values[:, 4:]).as_matrix(), values[:, 1:4]))


def read_labelled_csv(path: str | Path, angle: Angle) -> PosePairs:
    """Lines alternating ``hand,x,y,z,rx,ry,rz`` and ``eye,x,y,z,rx,ry,rz``; ``R = Rz(rz) Ry(ry) Rx(rx)``.

    ``angle`` is the unit of rx, ry, rz: it is asked for, since the file does not say. Angles beyond a full turn given
    as radians are refused. Raises :class:`InputError` naming the line.
    """
    path = Path(path)
    rows = _csv_rows(path)
    labels = [row[0].strip().lower() for _, row in rows]
    for k, (line, label) in enumerate(zip((line for line, _ in rows), labels, strict=True)):
        wanted = "hand" if k % 2 == 0 else "eye"
        if label != wanted:
            raise InputError(f"{path}, line {line}: expected a line '{wanted},x,y,z,rx,ry,rz', found {label!r}.")
    if len(rows) % 2:
        raise InputError(f"{path}: the last 'hand' line, {rows[-1][0]}, has no 'eye' line after it.")
    values = _numbers(path, [(line, row[1:]) for line, row in rows], 6, "x, y, z, rx, ry, rz")
    if angle == "rad" and np.abs(values[:, 3:]).max(initial=0.0) > 2 * np.pi:
        line = rows[int(np.argmax(np.abs(values[:, 3:]).max(axis=1) > 2 * np.pi))][0]
        raise InputError(f"{path}, line {line}: an angle is larger than a full turn in radians; are these degrees?")
    R = Rotation.from_euler("xyz", values[:, 3:], degrees=angle == "deg").as_matrix()
    poses = se3.compose(R, values[:, :3])
    return PosePairs(poses[0::2], poses[1::2])


def read_visp_pose(path: str | Path) -> Float[np.ndarray, "4 4"]:
    """One pose of ViSP: YAML with ``rows: 6, cols: 1, data``: ``tx, ty, tz`` and ``theta u`` (rad)."""
    path = Path(path)
    try:
        content = yaml.safe_load(read_text(path))
        values = np.array(content["data"], dtype=np.float64).reshape(-1)
    except (yaml.YAMLError, TypeError, KeyError, ValueError) as error:
        raise InputError(f"{path}: expected ViSP's 'rows: 6, cols: 1, data: [...]'.") from error
    if values.shape != (6,) or not np.isfinite(values).all():
        raise InputError(f"{path}: expected 6 finite numbers (tx, ty, tz, theta u), found {values.size}.")
    return se3.compose(Rotation.from_rotvec(values[3:]).as_matrix(), values[:3])


def read_visp_poses(folder: str | Path, pattern: str = "*_pose_rPe_*.yaml") -> dict[int, Float[np.ndarray, "4 4"]]:
    """All poses of a ViSP folder, ``{number in the name: T_base_hand}``, in order."""
    folder = Path(folder)
    found = {}
    for path in folder.glob(pattern):
        number = re.search(r"(\d+)$", path.stem)
        if number:
            found[int(number.group(1))] = read_visp_pose(path)
    if not found:
        raise InputError(f"{folder} holds no file named {pattern}.")
    return dict(sorted(found.items()))


def read_pairs_storage(path: str | Path, hand: str = "T1", camera: str = "T2") -> PosePairs:
    """OpenCV FileStorage with ``frameCount`` and matrices ``T1_k``, ``T2_k`` (4 x 4), as handeye_calib_camodocal has.

    Raises :class:`InputError` naming the matrix that is absent or not rigid.
    """
    path = Path(path)
    content = read_opencv_storage(path)
    count = content.get("frameCount")
    if not isinstance(count, int):
        raise InputError(f"{path}: expected an integer 'frameCount', found {count!r}.")
    streams = []
    for name in (hand, camera):
        poses = []
        for k in range(count):
            key = f"{name}_{k}"
            value = content.get(key)
            if not isinstance(value, np.ndarray) or value.shape != (4, 4):
                raise InputError(f"{path}: expected a 4 x 4 matrix {key!r}.")
            if not se3.is_rigid(value, ROTATION_TOLERANCE):
                raise InputError(f"{path}: {key!r} is not a rigid motion.")
            poses.append(value)
        streams.append(np.stack(poses) if poses else np.zeros((0, 4, 4)))
    return PosePairs(*streams)


def _csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """The rows that hold something, with their line numbers; lines that begin with # are comments."""
    lines = read_text(path).splitlines()
    rows = [(number, row) for number, row in enumerate(csv.reader(lines), start=1) if row and row[0].strip()]
    rows = [(number, row) for number, row in rows if not row[0].lstrip().startswith("#")]
    if not rows:
        raise InputError(f"{path} holds no rows.")
    return rows


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _numbers(path: Path, rows: list[tuple[int, list[str]]], count: int, names: str) -> Float[np.ndarray, "n k"]:
    values = np.zeros((len(rows), count))
    for k, (line, row) in enumerate(rows):
        if len(row) != count or not all(_is_number(word) for word in row):
            raise InputError(f"{path}, line {line}: expected {count} numbers ({names}), found {','.join(row)!r}.")
        values[k] = [float(word) for word in row]
        if not np.isfinite(values[k]).all():
            raise InputError(f"{path}, line {line}: holds a value that is not a finite number.")
    return values


def _check_quaternions(path: Path, rows: list[tuple[int, list[str]]], xyzw: Float[np.ndarray, "n 4"]) -> None:
    norm = np.linalg.norm(xyzw, axis=1)
    for k in np.flatnonzero(np.abs(norm - 1.0) > ROTATION_TOLERANCE):
        raise InputError(f"{path}, line {rows[k][0]}: expected a unit quaternion, found one of norm {norm[k]:.6g}.")
