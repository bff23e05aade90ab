"""The "binary map" of edges (thesis §2.4.1), with labels, and how it is filled in."""

from enum import IntEnum

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.joints import Joints


class EdgeKind(IntEnum):
    """Label of a pixel of the map."""

    NONE = 0
    CREASE = 1
    DEPTH = 2
    BORDER = 3


class EdgeMap(eqx.Module):
    """The label of every pixel of a range image.

    ``kind (h, w)`` values of :class:`EdgeKind`; ``far`` marks the DEPTH pixels on the occluded side of their jump;
    ``orientation`` has bit 1 where the edge was found along its row (it runs down the image) and bit 2 where along its
    column; ``angle_deg`` is the angle between the normals of the two sides of a crease, positive for a ridge and
    negative for a valley, NaN elsewhere; ``valid`` the readings without the mixed points; ``noise`` the standard
    deviation of the readings along their rays, unit of the data.
    """

    kind: Int[np.ndarray, "h w"]
    far: Bool[np.ndarray, "h w"]
    orientation: Int[np.ndarray, "h w"]
    angle_deg: Float[np.ndarray, "h w"]
    valid: Bool[np.ndarray, "h w"]
    noise: float


class EdgeMarks:
    """A map being filled in: DEPTH wins over BORDER, BORDER over CREASE; marks of one label add their orientations."""

    _RANK = np.array([0, 1, 3, 2])  # of NONE, CREASE, DEPTH, BORDER

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.kind = np.zeros(shape, dtype=np.int8)
        self.far = np.zeros(shape, dtype=bool)
        self.orientation = np.zeros(shape, dtype=np.int8)
        self.angle_deg = np.full(shape, np.nan)

    def mark(self, kind: EdgeKind, axis: int, line: Int[np.ndarray, " k"], place: Int[np.ndarray, " k"]) -> np.ndarray:
        """Label pixels found along ``axis`` (1: rows); True for each one that now has the label."""
        pixel = (line, place) if axis == 1 else (place, line)
        here = self._RANK[self.kind[pixel]]
        wins, same = here < self._RANK[kind], here == self._RANK[kind]
        won = tuple(part[wins] for part in pixel)
        self.kind[won], self.orientation[won] = kind, 0
        joined = tuple(part[wins | same] for part in pixel)
        self.orientation[joined] |= 1 if axis == 1 else 2
        return wins | same

    def mark_jumps(
        self,
        axis: int,
        line: Int[np.ndarray, " k"],
        near: Int[np.ndarray, " k"],
        far: Int[np.ndarray, " k"],
    ) -> None:
        """Label both ends of jumps found along ``axis``; ``near`` and ``far`` are places on the lines."""
        self.mark(EdgeKind.DEPTH, axis, line, near)
        self.mark(EdgeKind.DEPTH, axis, line, far)
        self.far[(line, far) if axis == 1 else (far, line)] = True

    def mark_creases(
        self, axis: int, line: Int[np.ndarray, " k"], place: Int[np.ndarray, " k"], angle_deg: Float[np.ndarray, " k"]
    ) -> None:
        """Label creases found along ``axis``; where a pixel is found twice the larger angle stays."""
        has = self.mark(EdgeKind.CREASE, axis, line, place)
        line, place, angle_deg = line[has], place[has], angle_deg[has]
        order = np.argsort(np.abs(angle_deg), kind="stable")
        pixel = (line[order], place[order]) if axis == 1 else (place[order], line[order])
        before, given = self.angle_deg[pixel], angle_deg[order]
        self.angle_deg[pixel] = np.where(np.abs(before) > np.abs(given), before, given)

    def finished(self, valid: Bool[np.ndarray, "h w"], noise: float) -> EdgeMap:
        """The map; ``valid`` and ``noise`` are handed on."""
        depth, crease = self.kind == EdgeKind.DEPTH, self.kind == EdgeKind.CREASE
        angle = np.where(crease, self.angle_deg, np.nan)
        return EdgeMap(self.kind, self.far & depth, self.orientation, angle, valid, noise)


def crease_angles(joints: Joints, across: Float[np.ndarray, "n m 3"]) -> Float[np.ndarray, " k"]:
    """Angle in degrees between the surface normals of the two sides of each joint, positive for a ridge.

    ``across`` holds the tangents along the other axis, indexed by place and line; a normal is the product of a side's
    tangent with the one across it, a little way in. Where there is none, the angle between the two tangents stands in.
    """
    sides = [across[joints.inner[:, side], joints.line].astype(np.float64) for side in (0, 1)]
    normals = [np.cross(joints.tangents[:, side], sides[side]) for side in (0, 1)]
    known = np.isfinite(np.concatenate(normals, axis=1)).all(axis=1, keepdims=True)
    first, second = (np.where(known, normals[side], joints.tangents[:, side]) for side in (0, 1))
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return np.rad2deg(np.arctan2(sine, np.sum(first * second, axis=1))) * np.where(joints.turn < 0, 1.0, -1.0)
