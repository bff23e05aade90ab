"""From the numbers of a pose file to 4 x 4 matrices in metres, each defect named by its row.

What a file does not say and a number cannot show (the unit of an angle, what rx ry rz are) is asked for, never guessed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.rigid import TOLERANCE, first_defect
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.pose_columns import (
    ANGLES,
    LAST_ROW,
    MATRIX,
    POSITION,
    QUATERNION,
    ROLL_PITCH_YAW,
    VECTOR,
    Column,
    StreamName,
    rotation_of,
)

Angle = Literal["deg", "rad"]
Length = Literal["m", "mm"]
QuaternionOrder = Literal["xyzw", "wxyz"]
RotationKind = Literal[
    "vector", "xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"
]  # fmt: skip
FAR = 20.0
"""Positions beyond it are taken for millimetres, and asked about."""


@dataclass(frozen=True)
class PoseForm:
    """What the numbers of one stream mean where the file does not say; ``None``: unknown.

    ``rotation`` is what rx ry rz are: a rotation vector, or angles about x, y and z applied in the order of the
    letters, small ones for fixed axes, capitals for moving axes. ``quaternion`` is the order of four unnamed numbers.
    """

    angle: Angle | None = None
    length: Length | None = None
    rotation: RotationKind | None = None
    quaternion: QuaternionOrder = "xyzw"


@dataclass(frozen=True)
class Forms:
    """The form of each stream."""

    hand: PoseForm = PoseForm()
    camera: PoseForm = PoseForm()

    def of(self, stream: StreamName) -> PoseForm:
        return self.hand if stream == "hand" else self.camera


@dataclass(frozen=True)
class PoseStream:
    """Poses of one stream in metres, and for each the place in its file (``line 7``), time, picture and group.

    ``path`` is what the user named, ``files`` what was read.
    """

    path: Path
    files: tuple[Path, ...]
    poses: Float[np.ndarray, "n 4 4"]
    places: tuple[str, ...]
    times: Float[np.ndarray, " n"] | None = None
    images: tuple[str, ...] | None = None
    groups: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Row:
    """One row of a file: where it stands, and its values in the order of the columns."""

    place: str
    values: Sequence[Any]


def make_stream(
    path: Path, columns: Sequence[Column], rows: Sequence[Row], stream: StreamName, form: PoseForm
) -> PoseStream:
    """The stream of ``columns`` (those of no stream belong to it too); ``form`` says what the names leave open."""
    chosen = [k for k, column in enumerate(columns) if column.stream in (None, stream)]
    notes: dict[str, Sequence[str]] = {}
    for k in chosen:
        if columns[k].quantity in ("image", "group"):
            notes[columns[k].quantity] = tuple(str(row.values[k]).strip() for row in rows)
    numeric = [k for k in chosen if columns[k].quantity not in notes]
    quantities = [columns[k].quantity for k in numeric]
    rotation_names = rotation_of(quantities, path)
    table = np.array([[_number(path, row, columns[k], k) for k in numeric] for row in rows]).reshape(len(rows), -1)

    def values(names: Sequence[str]) -> Float[np.ndarray, "n k"]:
        return table[:, [quantities.index(name) for name in names]]

    def unit(names: Sequence[str]) -> str | None:
        said = {columns[numeric[quantities.index(name)]].unit for name in names}
        if len(said) > 1:
            raise InputError(f"{path}: {', '.join(names)} must have one unit, found {', '.join(map(str, said))}")
        return said.pop()

    places = tuple(row.place for row in rows)
    t = values(POSITION) * _metres(path, values(POSITION), unit(POSITION) or form.length, stream)
    R = _rotations(path, places, rotation_names, values(rotation_names), unit(rotation_names), form, stream)
    T = se3.compose(R, t)
    if all(name in quantities for name in LAST_ROW):
        T[:, 3] = values(LAST_ROW)
    found = first_defect(T) if len(T) else None
    if found is not None:
        raise InputError(f"{path}, {places[found[0]]}: the {stream}'s pose is no rigid motion; {found[1]}")
    times = values(("t",))[:, 0] if "t" in quantities else None
    return PoseStream(path, (path,), T, places, times, *(_texts(notes.get(name)) for name in ("image", "group")))


def _texts(found: Sequence[str] | None) -> tuple[str, ...] | None:
    return None if found is None else tuple(found)


def _number(path: Path, row: Row, column: Column, k: int) -> float:
    raw = row.values[k]
    try:
        if isinstance(raw, bool):
            raise ValueError
        value = float(raw)
    except (TypeError, ValueError):
        raise InputError(f"{path}, {row.place}: {column.quantity} must be a number, found {raw!r}") from None
    if not np.isfinite(value):
        raise InputError(f"{path}, {row.place}: {column.quantity} is {raw}, expected a finite number")
    return value


def _option(name: str, stream: StreamName) -> str:
    return f"--camera-{name}" if stream == "camera" else f"--{name}"


def _metres(path: Path, position: np.ndarray, unit: str | None, stream: StreamName) -> float:
    largest = float(np.abs(position).max(initial=0.0))
    if unit is None and largest > FAR:
        option = _option("length", stream)
        raise InputError(
            f"{path}: the {stream}'s positions reach {largest:.4g}; are these millimetres? Say {option} mm, or "
            f"{option} m if they are metres"
        )
    return 1e-3 if unit == "mm" else 1.0


def _rotations(
    path: Path,
    places: Sequence[str],
    names: Sequence[str],
    values: Float[np.ndarray, "n k"],
    unit: str | None,
    form: PoseForm,
    stream: StreamName,
) -> Float[np.ndarray, "n 3 3"]:
    if names == MATRIX:
        return values.reshape(-1, 3, 3)
    if names == QUATERNION:
        norm = np.linalg.norm(values, axis=1)
        for k in np.flatnonzero(np.abs(norm - 1.0) > TOLERANCE).tolist():
            raise InputError(
                f"{path}, {places[k]}: the {stream}'s quaternion has the norm {norm[k]:.6g}, expected a unit quaternion"
            )
        return Rotation.from_quat(values).as_matrix()
    kind = form.rotation
    if names == ROLL_PITCH_YAW:
        kind = "xyz"
    elif names == VECTOR:
        kind = "vector"
    elif kind is None:
        option = _option("rotation", stream)
        raise InputError(
            f"{path}: the {stream}'s rx, ry, rz may be a rotation vector or angles about axes; say {option} vector, "
            f"{option} xyz (fixed axes, R = Rz Ry Rx) or another order of the axes"
        )
    unit = unit or form.angle or ("rad" if kind == "vector" else None)
    option = _option("angle", stream)
    largest = float(np.abs(values).max(initial=0.0))
    if unit is None:
        raise InputError(
            f"{path}: are the {stream}'s angles degrees or radians (the largest is {largest:.4g})? "
            f"Say {option} deg or {option} rad"
        )
    if unit == "rad" and largest > 2 * np.pi:
        row = int(np.argmax(np.abs(values).max(axis=1) > 2 * np.pi))
        raise InputError(
            f"{path}, {places[row]}: the {stream}'s angle {np.abs(values[row]).max():.4g} is more than a full turn in "
            f"radians; are these degrees? Say {option} deg"
        )
    angles = np.radians(values) if unit == "deg" else values
    if kind == "vector":
        return Rotation.from_rotvec(angles).as_matrix()
    columns = [ANGLES.index(f"r{letter.lower()}") for letter in kind]
    return Rotation.from_euler(kind, angles[:, columns]).as_matrix()
