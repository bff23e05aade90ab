"""Readings beside a depth jump that belong to no surface (thesis §2.4.1).

A beam has a width: where it straddles an outline it gives a mean of the surfaces on both sides, a "mixed point". It
lies strictly between them, and next to the far one: an outline crosses the lines of one of the two axes at 45 degrees
or more, and there no more than two readings are spoilt. What lies further in is a surface, however steep.
"""

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.control_points.steps import DOUBT, Steps, run_ends

_BESIDE = 0.4  # of the way left to the far surface: the next step of a spoilt reading is larger
_SPOILT = 0.1  # of the whole way: a reading nearer to a bent surface than that is taken for a part of it
_SHARPER = 4.0  # times the turn it has seen that a surface may still turn by: a crease lies somewhere in its pixel
_REACH = 2  # pixels from a spoilt reading to the far surface


def mixed_points(
    distance: Float[np.ndarray, " n"],
    steps: Steps,
    pitch: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Readings between the two surfaces of a jump, on neither.

    Such a reading has a jump on one side and, on its other side, either a jump of the same sign or a surface which
    it leaves towards the jump's far end, by more than the surface's own slope, a pitch and the noise explain. Where the
    surface has turned that way one reading before, beyond the beam's reach, it is the surface that goes on.
    """
    return (
        _mixed_end(distance, steps, pitch, sigma)
        | _mixed_end(distance[::-1], steps.mirrored(), pitch[::-1], sigma[::-1])[::-1]
    )


def spikes(steps: Steps) -> Bool[np.ndarray, " n"]:
    """Readings with a jump on both sides, of opposite signs."""
    way = np.where(steps.jump, np.sign(steps.step), 0.0)
    return np.append(0.0, way[:-1]) * way < 0


def _mixed_end(
    distance: Float[np.ndarray, " n"], steps: Steps, pitch: Float[np.ndarray, " n"], sigma: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """The mixed points among the readings just before a jump."""
    out = np.zeros(len(distance), dtype=bool)
    at = np.flatnonzero(steps.jump & (steps.gap <= _REACH))
    at = at[at >= 1]
    sign = np.sign(steps.step[at])
    far = run_ends(np.where(steps.jump, np.sign(steps.step), 0.0))[at] + 1
    left = sign * (distance[far] - distance[at])
    last = sign * steps.step[at - 1]
    beside = (last > 0) & (sign * steps.step[at] >= _BESIDE * left) & (steps.gap[far] > 0)
    at, sign, left, last = at[beside], sign[beside], left[beside], last[beside]

    # slopes towards the far surface between the last four readings
    before = [np.maximum(at - k, 0) for k in (1, 2, 3)]
    linked, large = (np.stack([part[row] for row in before]) for part in (steps.gap > 0, steps.large))
    gap = np.maximum(np.stack([steps.gap[row] for row in before]), 1)
    rise = sign * np.stack([steps.step[row] for row in before])
    deep = (at >= 3) & linked.all(axis=0)
    share = gap[0] / (gap[1] + gap[2])
    slope = (rise[1] + rise[2]) / (gap[1] + gap[2])
    deviation = sigma[at] * np.sqrt(1 + (1 + share) ** 2 + share**2)
    leaves = last - slope * gap[0] > np.abs(slope) + pitch[at] + DOUBT * deviation
    one, two = 1 / gap[1], 1 / gap[2]
    deviation = sigma[at] * np.sqrt(one**2 + (one + two) ** 2 + two**2)
    turn = rise[1] * one - rise[2] * two
    turned = deep & (turn > pitch[at] + DOUBT * deviation) & (last < _BESIDE * (last + left))
    more = last - rise[1] * one * gap[0]
    goes_on = turned & (more < _SPOILT * (last + left)) & (more < _SHARPER * turn)
    out[at] = (large[0] | (deep & ~large.any(axis=0) & leaves)) & ~goes_on
    return out
