"""Where the parabolic segments of scan lines meet, and the tangents on both sides (thesis §2.4.1)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.line_blocks import LineBlock
from jaxmodel.control_points.parabolas import Parabolas, Readings, fit, runs

_BENT = 3.0  # standard deviations a curvature must pass, else the segment is taken for straight
_FEWEST = 6  # readings on each side that a joint is measured on at least
# Their number to the power 3/2, in noise per pitch: a parabola's slope at its end is then known to 14 / that.
_TURN_READINGS, _STEP_READINGS = 200.0, 100.0
_MEETING = 0.5  # pitches beyond the two readings of a joint where its sides may still meet
_STEADY = 0.35  # largest standard deviation of a slope that is told to the lines across


class Joints(NamedTuple):
    """Joints of the segments of all lines along one axis.

    ``line``, and the places of the last reading ``before``, the first ``after``, and the one nearest to the joint,
    ``place``; ``inner`` a place a little way into each side. ``step`` from the left side to the right one, in pitches
    towards the sensor, with its standard deviation; ``turn`` the change of slope; ``certainty`` the turn that curvature
    of the sides does not explain, in its standard deviations and signed; ``tangents`` of both sides at the joint.
    """

    line: Int[np.ndarray, " k"]
    before: Int[np.ndarray, " k"]
    after: Int[np.ndarray, " k"]
    place: Int[np.ndarray, " k"]
    inner: Int[np.ndarray, "k 2"]
    step: Float[np.ndarray, " k"]
    step_deviation: Float[np.ndarray, " k"]
    turn: Float[np.ndarray, " k"]
    certainty: Float[np.ndarray, " k"]
    tangents: Float[np.ndarray, "k 2 3"]

    def take(self, rows: np.ndarray) -> "Joints":
        """Some of the joints."""
        return Joints(*(part[rows] for part in self))


def all_joints(parts: Sequence[Joints]) -> Joints:
    """Those of several blocks, at least one, together."""
    return Joints(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def joints_of(block: LineBlock, starts: Int[np.ndarray, " s"]) -> tuple[Joints, Float[np.ndarray, "n 3"]]:
    """The joints inside the pieces of a segmented block, and the tangent at each reading, NaN where uncertain."""
    x = block.data.x
    parabolas = fit(block.data, starts)
    everywhere = np.repeat(np.arange(len(starts)), parabolas.count)
    here = _at(parabolas.take(everywhere), _bent(parabolas)[everywhere], x)
    tangents = block.tangents(here.slope, np.arange(len(x)))
    tangents[here.slope_deviation > _STEADY] = np.nan
    meeting = _meetings(block, starts, here.slope)
    before, after = meeting.end - 1, meeting.first
    turning = _sides(block.data, starts, meeting, _TURN_READINGS)
    # the sides meet where their tangents cross; beyond the two readings it would be no joint of theirs
    middle, half = 0.5 * (x[before] + x[after]), 0.5 * np.abs(x[after] - x[before])
    sides = [_at(side, _bent(side), middle) for side in turning]
    gap, turn = sides[1].value - sides[0].value, sides[1].slope - sides[0].slope
    crossing = np.clip(
        np.divide(-gap, turn, out=np.zeros_like(gap), where=turn != 0), -half - _MEETING, half + _MEETING
    )
    sides = [_at(side, _bent(side), middle + crossing) for side in turning]
    # turns and steps are certain when no curvature of the sides explains them
    curved = np.ones(len(after), dtype=bool)
    free = [_at(side, curved, middle + crossing) for side in turning]
    close = _sides(block.data, starts, meeting, _STEP_READINGS)
    step, step_deviation = _least_step(close, np.stack([x[before], middle + crossing, x[after]]))
    share = np.clip(0.5 + 0.5 * np.divide(crossing, half, out=np.zeros_like(half), where=half > 0), 0.0, 1.0)
    inside = np.minimum(2, (parabolas.count - 1) // 2)
    joints = Joints(
        line=block.line[after],
        before=block.place[before],
        after=block.place[after],
        place=block.place[before + np.round(share * (after - before)).astype(np.int64)],
        inner=np.stack(
            [block.place[before - inside[meeting.left]], block.place[after + inside[meeting.right]]], axis=1
        ),
        step=step,
        step_deviation=step_deviation,
        turn=sides[1].slope - sides[0].slope,
        certainty=(free[1].slope - free[0].slope) / np.hypot(free[0].slope_deviation, free[1].slope_deviation),
        tangents=np.stack([block.tangents(sides[0].slope, before), block.tangents(sides[1].slope, after)], axis=1),
    )
    return joints, tangents


def _least_step(
    sides: tuple[Parabolas, Parabolas], x: Float[np.ndarray, "3 k"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """The smallest step at three abscissae of each joint, 0 where its sign changes, and its standard deviation.

    Curves that go through each other are no step, though the tangents may cross where the curves are well apart.
    """
    curved = np.ones(x.shape[1], dtype=bool)
    places = [[_at(side, curved, at) for side in sides] for at in x]
    steps = np.stack([right.value - left.value for left, right in places])
    deviations = np.stack([np.hypot(left.value_deviation, right.value_deviation) for left, right in places])
    least = np.argmin(np.abs(steps), axis=0)[None]
    one_sign = np.abs(np.sign(steps).sum(axis=0)) == len(x)
    step, deviation = (np.take_along_axis(part, least, axis=0)[0] for part in (steps, deviations))
    return np.where(one_sign, step, 0.0), deviation


class _Meetings(NamedTuple):
    """Pairs of segments that meet: their numbers, the end row of the left one and the first of the right one."""

    left: Int[np.ndarray, " k"]
    right: Int[np.ndarray, " k"]
    end: Int[np.ndarray, " k"]
    first: Int[np.ndarray, " k"]


def _meetings(block: LineBlock, starts: Int[np.ndarray, " s"], slope: Float[np.ndarray, " n"]) -> _Meetings:
    """Neighbouring segments of a piece, and those on both sides of a short one that rounds an edge off.

    Averaging lines puts such a segment, no wider than what was averaged, in place of an edge that runs across them:
    its slope is between those of its neighbours.
    """
    count = np.diff(np.append(starts, len(slope)))
    inner = ~np.isin(starts, block.pieces)  # not the first of its piece
    joint = np.flatnonzero(inner)
    short = np.flatnonzero(inner[:-1] & inner[1:]) if len(starts) > 1 else joint[:0]
    averaged = block.averaged[starts[short]]
    short = short[(averaged > 1) & (count[short] <= averaged + 1)]
    here = slope[starts[short] + count[short] // 2]
    short = short[(here - slope[starts[short] - 1]) * (slope[starts[short + 1]] - here) > 0]
    short = short[~np.isin(short - 1, short)]
    joint = joint[~np.isin(joint, short) & ~np.isin(joint - 1, short)]
    left, right = np.append(joint - 1, short - 1), np.append(joint, short + 1)
    return _Meetings(left, right, np.append(starts[joint], starts[short]), starts[right])


def _sides(
    data: Readings, starts: Int[np.ndarray, " s"], meeting: _Meetings, share: float
) -> tuple[Parabolas, Parabolas]:
    """Parabolas through the nearest readings of both sides, more of them under noise."""
    stops = np.append(starts[1:], len(data.x))
    noise = 1.0 / np.sqrt(data.weight[meeting.first])
    near = np.ceil(np.maximum((share * noise) ** (2 / 3), _FEWEST)).astype(np.int64)
    left = fit(*runs(data, np.maximum(starts[meeting.left], meeting.end - near), meeting.end))
    return left, fit(*runs(data, meeting.first, np.minimum(stops[meeting.right], meeting.first + near)))


def _bent(parabolas: Parabolas) -> Bool[np.ndarray, " s"]:
    """Whether the curvature is certain; a segment is taken for straight otherwise."""
    bend = parabolas.coefficients[2]
    return bend * bend * parabolas.norms[2] > _BENT**2


class _Place(NamedTuple):
    value: Float[np.ndarray, " k"]
    value_deviation: Float[np.ndarray, " k"]
    slope: Float[np.ndarray, " k"]
    slope_deviation: Float[np.ndarray, " k"]


def _at(parabolas: Parabolas, bent: Bool[np.ndarray, " k"], x: Float[np.ndarray, " k"]) -> _Place:
    """Height and slope at one abscissa each, with standard deviations; straight where not ``bent``."""
    norms = parabolas.norms.copy()
    norms[2, ~bent] = 0.0
    variance = np.divide(1.0, norms, out=np.zeros_like(norms), where=norms > 0)
    used = parabolas.coefficients * (norms > 0)
    # noise that was thought too small shows in what the parabola leaves
    excess = np.sqrt(np.maximum(parabolas.misfit / np.maximum(parabolas.count - 3, 1), 1.0))
    value, slope = parabolas.polynomials(x), parabolas.derivatives(x)
    slope_deviation = np.sqrt(np.sum(slope * slope * variance, axis=0)) * excess
    slope_deviation[parabolas.norms[1] <= 0] = np.inf  # one abscissa
    return _Place(
        np.sum(used * value, axis=0),
        np.sqrt(np.sum(value * value * variance, axis=0)) * excess,
        np.sum(used * slope, axis=0),
        slope_deviation,
    )
