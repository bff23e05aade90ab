"""From each reading of a scan line to the next one: which steps are depth jumps (thesis §2.4.1)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.scan_lines import LineReadings

_SLOPE_RUN = 4  # steps of one sign in a row, half as large as a jump or more, that make a steep surface, not a jump
_EVEN = 2.5  # times the step before it that one of its steps may be, or the other way round
_MINOR = 0.25  # of a jump: steps next to it up to that are the slope of the surface that ends there
DOUBT = 5.0  # standard deviations a step must pass


class Steps(NamedTuple):
    """From each reading to the next one of its line: ``step`` in distance, over ``gap`` pixels (0: none within reach).

    ``large`` where the two lie on no common surface, whatever its slope; ``jump`` without the small ones of them next
    to a larger one: those are seen where a face almost along the rays ends at an outline.
    """

    step: Float[np.ndarray, " n"]
    gap: Int[np.ndarray, " n"]
    large: Bool[np.ndarray, " n"]
    jump: Bool[np.ndarray, " n"]

    def mirrored(self) -> "Steps":
        """The same steps with the lines read backwards."""
        step, gap, large, jump = (np.append(part[:-1][::-1], part[-1:]) for part in self)
        return Steps(-step, gap, large, jump)


def find_steps(
    distance: Float[np.ndarray, " n"],
    lines: LineReadings,
    pitch: Float[np.ndarray, " n"],
    sigma: Float[np.ndarray, " n"],
    jump: float,
) -> Steps:
    """Jumps along lines: steps beyond ``jump`` pitches and the noise that are not part of a steep surface.

    ``distance``, ``pitch`` (a length at each reading) and ``sigma`` are in the unit of the data.
    """
    linked = lines.gap > 0
    step = np.zeros_like(distance)
    step[:-1] = np.diff(distance)
    nearer = np.minimum(pitch, np.append(pitch[1:], np.inf))
    noise = np.hypot(sigma, np.append(sigma[1:], 0.0))
    limit = jump * nearer * np.sqrt(np.maximum(lines.gap, 1)) + DOUBT * noise
    slanted = np.where(linked & (np.abs(step) > 0.5 * limit), step, 0.0)
    large = linked & (np.abs(step) > limit) & ~_even(slanted)
    return Steps(step, lines.gap, large, large & ~_minor(slanted))


def run_ends(value: np.ndarray) -> Int[np.ndarray, " n"]:
    """The last row of the run of equal values that each row is in."""
    last = np.append(np.diff(value) != 0, True)[: len(value)]
    return np.flatnonzero(last)[np.cumsum(last) - last]


def _even(step: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Several steps in a row, of about one size: a surface seen at a slant."""
    size = np.abs(step)
    differ = np.abs(np.diff(size)) > (1 - 1 / _EVEN) * np.maximum(size[1:], size[:-1])
    new = np.append(True, differ | (np.diff(np.sign(step)) != 0))[: len(step)]
    run = np.cumsum(new) - 1
    return (size > 0) & (np.bincount(run)[run] >= _SLOPE_RUN) if len(step) else size > 0


def _minor(step: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Steps in a row with a much larger one of the same sign."""
    size = np.abs(step)
    new = np.append(True, np.diff(np.sign(step)) != 0)[: len(step)]
    largest = np.maximum.reduceat(size, np.flatnonzero(new)) if len(step) else size
    return (size > 0) & (size <= _MINOR * largest[np.cumsum(new) - 1])
