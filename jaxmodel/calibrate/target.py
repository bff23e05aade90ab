"""Calibration targets: which one hangs there, and where its corners are in its own frame."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError

TargetKind = Literal["chessboard", "charuco", "apriltag"]
KINDS = ("chessboard", "charuco", "apriltag")
MARKERS = {
    **{f"{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "ARUCO_ORIGINAL": 1024,
    "ARUCO_MIP_36H12": 250,
    "APRILTAG_16H5": 30,
    "APRILTAG_25H9": 35,
    "APRILTAG_36H10": 2320,
    "APRILTAG_36H11": 587,
}
"""OpenCV's dictionaries, without their DICT_, and how many markers each holds."""


@dataclass(frozen=True)
class Target:
    """A flat calibration target; lengths in the unit that the poses are wanted in.

    ``chessboard``: ``columns`` x ``rows`` *inner corners*, one number odd and the other even (else the board looks the
    same after half a turn), ``square``: side of a square. ``charuco``: ``columns`` x ``rows`` *squares*, ``square``
    and ``marker``: sides of a square and of a marker. ``apriltag``: a grid of ``columns`` x ``rows`` tags (1 x 1: a
    single one), ``marker``: side of a tag's black border, ``square``: from one tag to the next. Markers are numbered
    from 0 along the rows, as OpenCV prints them, of ``dictionary``.

    Frame: x along the columns, y along the rows, both from the target's first corner; z into the target, away from
    the viewer. A chessboard's origin is its first inner corner, the one whose inner square is black; the others' is
    the outer corner of the first square or tag. Raises :class:`InputError` for anything that is not such a target.
    """

    kind: str
    columns: int
    rows: int
    square: float
    marker: float = 0.0
    dictionary: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"A target must be one of {', '.join(KINDS)}, not {self.kind!r}.")
        fewest = 1 if self.kind == "apriltag" else 3
        if self.columns < fewest or self.rows < fewest:
            raise InputError(f"A {self.kind} needs at least {fewest} x {fewest}, not {self.columns} x {self.rows}.")
        if not (np.isfinite(self.square) and self.square > 0):
            raise InputError(f"A target's square must be a length > 0, not {self.square}.")
        if self.kind == "chessboard":
            if (self.columns + self.rows) % 2 == 0:
                raise InputError(
                    f"A chessboard of {self.columns} x {self.rows} inner corners looks the same after half a turn; use "
                    "one with an odd and an even number of them, or a ChArUco board."
                )
            return
        if not (np.isfinite(self.marker) and 0 < self.marker <= self.square):
            raise InputError(f"A {self.kind}'s marker must be a length > 0, at most its square {self.square}.")
        if self.dictionary_name not in MARKERS:
            raise InputError(
                f"A {self.kind}'s dictionary must be one of {', '.join(MARKERS)}, not {self.dictionary!r}."
            )
        count = self.columns * self.rows // (2 if self.kind == "charuco" else 1)
        if count > MARKERS[self.dictionary_name]:
            raise InputError(
                f"A {self.kind} of {self.columns} x {self.rows} has {count} markers, but {self.dictionary} holds only "
                f"{MARKERS[self.dictionary_name]}."
            )

    @property
    def dictionary_name(self) -> str:
        """The dictionary's name as ``MARKERS`` has it; users may write DICT_ and small letters."""
        return self.dictionary.upper().removeprefix("DICT_")

    @property
    def sentence(self) -> str:
        """What to look for, in words."""
        what = {"chessboard": "inner corners", "charuco": "squares", "apriltag": "tags"}[self.kind]
        return f"{self.kind} of {self.columns} x {self.rows} {what}" + (f", {self.dictionary}" * bool(self.dictionary))

    @property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """Corners in the target's frame: row by row; for tags four each, clockwise from the first."""
        if self.kind == "apriltag":
            corners = self.marker * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
            return (self.square * _lattice(self.columns, self.rows)[:, None] + corners).reshape(-1, 3)
        if self.kind == "charuco":
            return self.square * (_lattice(self.columns - 1, self.rows - 1) + np.array([1.0, 1.0, 0.0]))
        return self.square * _lattice(self.columns, self.rows)


def _lattice(columns: int, rows: int) -> Float[np.ndarray, "m 3"]:
    k = np.arange(columns * rows)
    return np.stack([k % columns, k // columns, np.zeros(len(k))], axis=1)
