"""Edges of a range image by scan lines (thesis §2.4.1, after Jiang and Bunke 1999): the "binary map", with labels.

Every row and every column is treated as a scan line. First come the jump edges, and the mixed points beside them are
removed; each piece between jumps is split into parabolic segments, and a joint of two of them whose sides differ in
direction is a crease edge.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.edge_map import EdgeKind, EdgeMap, EdgeMarks, crease_angles
from jaxmodel.control_points.joints import Joints, all_joints, joints_of
from jaxmodel.control_points.jumps import joined_readings, without_mixed_points
from jaxmodel.control_points.line_blocks import LineArrays, line_arrays, line_block
from jaxmodel.control_points.scan_lines import blocks, line_view, local_noise, noise
from jaxmodel.control_points.segmentation import segment_pieces
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import JUMP, Scan

__all__ = ["EdgeKind", "EdgeMap", "EdgeOptions", "find_edges"]

_AROUND, _SUPPORT = 5, 3  # an edge has so many pixels, itself among them, in a window of that side
_WEAK = 0.75  # of the significance asked for: enough for a crease that leads on from a certain one
_MIXED_WIDTH = 2  # rounds of removal: readings a beam's footprint spoils on each side of a jump


@dataclass(frozen=True)
class EdgeOptions:
    """Thresholds, none of them a length.

    ``jump``: steps between neighbouring readings beyond so many pitches, and beyond the noise, are jump edges.
    ``angle_deg``: least angle between the normals of the two sides of a crease. ``step``: a joint whose two sides
    differ by so many pitches in depth is a jump edge too. ``significance``: standard deviations a turn or step passes;
    a turn next to a certain one passes three quarters of it.
    ``gain``: what a joint must lower the chi-square of the parabola through both its segments by.
    """

    jump: float = JUMP
    angle_deg: float = 20.0
    step: float = 1.0
    significance: float = 4.0
    gain: float = 25.0

    def __post_init__(self) -> None:
        for name in ("jump", "angle_deg", "step", "significance", "gain"):
            if not getattr(self, name) > 0:
                raise InputError(f"edges: {name} is {getattr(self, name)}, expected a number above 0")


def find_edges(image: Scan, options: EdgeOptions = EdgeOptions()) -> EdgeMap:
    """Jump edges, creases and borders of a range image.

    Both ends of a jump are marked DEPTH; a reading at the image's edge or beside missing readings, with no surface
    within reach behind them, BORDER; the reading nearest to a crease CREASE. Where a pixel is several, DEPTH wins over
    BORDER over CREASE. Thresholds scale with the image's pitch and with its noise, which is estimated from it.

    Raises:
        InputError: ``image`` is not a range image.
    """
    view = line_view(image)
    marks = EdgeMarks(view.distance.shape)
    if not np.isfinite(view.distance).any():
        return marks.finished(np.isfinite(view.distance), 0.0)
    sigma = noise(view)
    everywhere = np.full(view.distance.shape, sigma)
    for _ in range(_MIXED_WIDTH):
        view = without_mixed_points(view, everywhere, options.jump)
    sigma_here = local_noise(view, joined_readings(view, everywhere, options.jump), sigma)
    joined = joined_readings(view, sigma_here, options.jump, marks)
    lines = [line_arrays(view, axis, sigma_here, joined) for axis in (0, 1)]
    joints, tangents = zip(*(_segmented(arrays, options.gain) for arrays in lines), strict=True)
    _mark_joints(marks, [_edges_among(joints[axis], tangents[1 - axis], options) for axis in (0, 1)])
    return marks.finished(np.isfinite(view.distance), sigma)


def _segmented(arrays: LineArrays, gain: float) -> tuple[Joints, Float[np.ndarray, "m n 3"]]:
    """The joints of all lines, and the tangents along them."""
    tangents = np.full(arrays.points.shape, np.nan, dtype=np.float32)
    parts = []
    for lines in blocks(arrays.distance.shape):
        if np.isfinite(arrays.distance[lines]).any():
            block = line_block(arrays, lines)
            joints, here = joints_of(block, segment_pieces(block.data, block.pieces, gain))
            parts.append(joints)
            tangents[block.line, block.place] = here
    return all_joints(parts), tangents


class _Found(NamedTuple):
    """Joints along one axis that are edges: jumps, and creases with their angles and whether they are certain."""

    jumps: Joints
    creases: Joints
    angle_deg: Float[np.ndarray, " k"]
    certain: Bool[np.ndarray, " k"]


def _edges_among(joints: Joints, across: Float[np.ndarray, "n m 3"], options: EdgeOptions) -> _Found:
    """Joints whose sides differ in depth are jumps; those whose sides differ in direction are creases."""
    apart = np.abs(joints.step) > options.step * (joints.after - joints.before)
    apart &= np.abs(joints.step) > options.significance * joints.step_deviation
    certainty = joints.certainty * np.sign(joints.turn)
    bent = joints.take(~apart & (certainty > _WEAK * options.significance))
    angle = crease_angles(bent, across)
    sharp = np.abs(angle) >= options.angle_deg
    bent = bent.take(sharp)
    return _Found(joints.take(apart), bent, angle[sharp], bent.certainty * np.sign(bent.turn) > options.significance)


def _mark_joints(marks: EdgeMarks, found: list[_Found]) -> None:
    """Mark the edges found along both axes that others of their sort go on from."""
    shape = marks.kind.shape
    ridges, valleys, weak_ridges, weak_valleys, depth = (np.zeros(shape, dtype=bool) for _ in range(5))
    depth |= marks.kind == EdgeKind.DEPTH
    for axis, (jumps, creases, angle, certain) in enumerate(found):
        here = _pixels(creases, axis, creases.place)
        ridges[here] |= (angle > 0) & certain
        valleys[here] |= (angle < 0) & certain
        weak_ridges[here] |= angle > 0
        weak_valleys[here] |= angle < 0
        for end in (jumps.before, jumps.after):
            depth[_pixels(jumps, axis, end)] = True
    depth = _supported(depth)
    ridges, valleys = _continued(_supported(ridges), weak_ridges), _continued(_supported(valleys), weak_valleys)
    for axis, (jumps, creases, angle, _) in enumerate(found):
        here = _pixels(creases, axis, creases.place)
        kept = np.where(angle > 0, ridges[here], valleys[here])
        marks.mark_creases(axis, creases.line[kept], creases.place[kept], angle[kept])
        kept = depth[_pixels(jumps, axis, jumps.before)] & depth[_pixels(jumps, axis, jumps.after)]
        jumps = jumps.take(kept)
        nearer = jumps.step < 0  # the first side is nearer to the sensor
        near, far = np.where(nearer, jumps.before, jumps.after), np.where(nearer, jumps.after, jumps.before)
        marks.mark_jumps(axis, jumps.line, near, far)


def _pixels(joints: Joints, axis: int, place: Int[np.ndarray, " k"]) -> tuple[np.ndarray, np.ndarray]:
    return (joints.line, place) if axis == 1 else (place, joints.line)


def _continued(sure: Bool[np.ndarray, "h w"], marked: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """The sure pixels and the marked ones that lead on from them without a gap."""
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(sure, np.ones((3, 3)), iterations=-1, mask=marked | sure), dtype=bool)


def _supported(marked: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Marked pixels with others around them: an edge goes on from line to line, chance does not."""
    from scipy.ndimage import uniform_filter

    near = uniform_filter(marked.astype(np.float64), _AROUND, mode="constant") * _AROUND**2
    return marked & (near > _SUPPORT - 0.5)
