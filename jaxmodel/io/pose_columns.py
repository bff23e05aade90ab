"""The names that pose files give their numbers: which stream, which quantity, which unit.

``hand_x_mm`` is the hand's x in millimetres. A stream is ``hand`` (also ``robot``, ``gripper``) or ``camera`` (also
``eye``, ``target``); without one the file has a single stream. Quantities:

* ``x y z``, the position;
* ``qx qy qz qw``, a Hamilton quaternion; ``ux uy uz``, a rotation vector; ``roll pitch yaw``, about the fixed axes x,
  y, z in this order; ``rx ry rz``, which makers of robots use for several things, so that it must be said;
  ``r11 .. r33``, a matrix, with ``r41 .. r44`` where the file has its last row;
* ``t`` in seconds; ``image``, the picture a row belongs to; ``group``, rows whose camera lengths have one scale.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from jaxmodel.errors import InputError
from jaxmodel.io.structuring import nearest, show

StreamName = Literal["hand", "camera"]
STREAMS: Mapping[str, StreamName] = {
    "hand": "hand", "robot": "hand", "gripper": "hand", "effector_wrt_world": "hand",
    "camera": "camera", "eye": "camera", "target": "camera", "object_wrt_sensor": "camera", "optical": "camera",
}  # fmt: skip
POSITION = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
VECTOR = ("ux", "uy", "uz")
ANGLES = ("rx", "ry", "rz")
ROLL_PITCH_YAW = ("roll", "pitch", "yaw")
MATRIX = tuple(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))
LAST_ROW = tuple(f"r4{j}" for j in (1, 2, 3, 4))
ROW_BY_ROW = tuple(name for i in (1, 2, 3) for name in (f"r{i}1", f"r{i}2", f"r{i}3", POSITION[i - 1]))
NOTES = ("t", "image", "group")
SYNONYMS = {
    "tx": "x", "ty": "y", "tz": "z", "time": "t", "timestamp": "t", "file": "image", "name": "image",
}  # fmt: skip
UNITS = {**dict.fromkeys(POSITION, ("m", "mm")), **dict.fromkeys((*ANGLES, *ROLL_PITCH_YAW, *VECTOR), ("rad", "deg"))}
KNOWN = (*NOTES, *POSITION, *QUATERNION, *VECTOR, *ANGLES, *ROLL_PITCH_YAW, *MATRIX, *LAST_ROW)


@dataclass(frozen=True)
class Column:
    """One number of a row: its stream (``None``: the file has one only), quantity and unit (``None``: not said)."""

    stream: StreamName | None
    quantity: str
    unit: str | None = None


def read_name(name: str, where: str) -> Column:
    """The column of a name as a file writes it; an unknown name or unit is an :class:`InputError` with the nearest."""
    words = name.strip().lower()
    stream: StreamName | None = None
    for prefix, meant in STREAMS.items():
        if words.startswith(f"{prefix}_"):
            stream, words = meant, words[len(prefix) + 1 :]
            break
    quantity, _, unit = words.partition("_")
    quantity = SYNONYMS.get(quantity, quantity)
    if quantity not in KNOWN:
        raise InputError(f"{where}: unknown column {show(name.strip())}, {nearest(quantity, list(KNOWN))}")
    if unit and unit not in UNITS.get(quantity, ()):
        expected = " or ".join(UNITS.get(quantity, ())) or "no unit"
        raise InputError(f"{where}: unknown unit {show(unit)} of the column {show(name.strip())}, expected {expected}")
    return Column(stream, quantity, unit or None)


def unnamed(width: int, quaternion: Literal["xyzw", "wxyz"], where: str) -> list[Column]:
    """The columns of rows without names, told by how many numbers they have."""
    turned = tuple(f"q{letter}" for letter in quaternion)
    one: dict[int, Sequence[str]] = {
        6: (*POSITION, *ANGLES),
        7: (*POSITION, *turned),
        12: ROW_BY_ROW,
        16: (*ROW_BY_ROW, *LAST_ROW),
    }
    both = {2 * k: names for k, names in one.items() if k != 6}  # 12 numbers are a 3 x 4 matrix
    if width in one:
        return [Column(None, name) for name in one[width]]
    if width - 1 in one and width - 1 != 6:
        return [Column(None, "t"), *(Column(None, name) for name in one[width - 1])]
    for time in (0, 1):
        if width - time in both:
            streams: tuple[StreamName, StreamName] = ("hand", "camera")
            named = [Column(stream, name) for stream in streams for name in both[width - time]]
            return [Column(None, "t")] * time + named
    raise InputError(
        f"{where}: {width} numbers in a row have no agreed meaning; expected x y z and a quaternion (7), a 3 x 4 or "
        "4 x 4 matrix (12, 16), these after a time or for both streams (14, 24, 32), or a first row of names"
    )


def rotation_of(quantities: Sequence[str], path: Path) -> tuple[str, ...]:
    """The quantities of one stream that are its rotation.

    Raises :class:`InputError` naming what is absent or given twice.
    """
    what = f"{path}: the columns"
    twice = sorted({name for name in quantities if quantities.count(name) > 1})
    if twice:
        raise InputError(f"{what} name {', '.join(twice)} twice")
    absent = [name for name in POSITION if name not in quantities]
    if absent:
        raise InputError(f"{what} lack {', '.join(absent)}; found {', '.join(quantities) or 'none'}")
    kinds = (QUATERNION, VECTOR, ANGLES, ROLL_PITCH_YAW, MATRIX)
    begun = [names for names in kinds if any(name in quantities for name in names)]
    if len(begun) != 1:
        found = " and ".join(" ".join(names) for names in begun) or "none"
        choices = ", ".join(" ".join(names) for names in kinds[:-1])
        raise InputError(f"{what} must hold one rotation ({choices} or r11 .. r33), found {found}")
    absent = [name for name in begun[0] if name not in quantities]
    if absent:
        raise InputError(f"{what} lack {', '.join(absent)}")
    return begun[0]
