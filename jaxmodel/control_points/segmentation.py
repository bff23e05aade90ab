"""Scan lines cut into parabolic segments (thesis §2.4.1): chord splitting, then joints moved, merged and added.

All pieces of all lines are treated at once; the loops are over rounds. Splitting at the farthest point from the chord
finds the joints roughly and cheaply. The rounds after it put each joint where two parabolas fit best, take it away
where one does nearly as well, and cut again where two do significantly better.
"""

import numpy as np
from jaxtyping import Bool, Int

from jaxmodel.control_points.parabolas import Cuts, Readings, best_cuts, first_rows, fit, runs

LEAST = 3  # readings in a segment: a parabola's


def segment_pieces(
    data: Readings, pieces: Int[np.ndarray, " p"], gain: float, doubt: float = 4.0, rounds: int = 4
) -> Int[np.ndarray, " s"]:
    """First rows of the parabolic segments, those of the pieces among them.

    Args:
        data: readings of all pieces, one piece after another.
        pieces: first row of each piece.
        gain: a joint stays where two parabolas lower the chi-square of one by at least this much.
        doubt: a segment is split at its chord while its chi-square passes its expectation by so many standard
            deviations.
        rounds: at most so many times are the joints moved, merged and added.
    """
    starts = split_at_chords(data, pieces, doubt)
    fresh = np.ones(len(starts), dtype=bool)
    for _ in range(rounds):
        starts, fresh = _fuse(data, starts, fresh, pieces, gain)
        for parity in (0, 1):
            starts, fresh = _settle(data, starts, fresh, pieces, parity, gain)
        added = _cuts_of(data, starts, np.flatnonzero(fresh), gain)
        if len(added) == 0 and not fresh.any():
            break
        starts, fresh = _with(starts, added)
        if len(added) == 0:
            break
    return starts


def split_at_chords(data: Readings, pieces: Int[np.ndarray, " p"], doubt: float) -> Int[np.ndarray, " s"]:
    """Cut at the farthest point from the chord until each segment is a parabola within the noise (§2.4.1)."""
    found = [pieces]
    active, starts = data, pieces  # the rows of segments still in doubt
    rows = np.arange(len(data.x))
    while len(starts):
        parabolas = fit(active, starts)
        count = parabolas.count
        free = np.maximum(count - 3, 1)
        poor = (count >= 2 * LEAST) & (parabolas.misfit > free + doubt * np.sqrt(2.0 * free))
        kept = np.repeat(poor, count)
        active, rows, count = active.take(kept), rows[kept], count[poor]
        if len(rows) == 0:
            break
        starts = np.cumsum(count) - count
        last = starts + count - 1
        run, rise = active.x[last] - active.x[starts], active.y[last] - active.y[starts]
        slope = np.divide(rise, run, out=np.zeros_like(rise), where=run != 0)
        chord = np.repeat(active.y[starts] - slope * active.x[starts], count) + np.repeat(slope, count) * active.x
        off = active.y - chord
        row = np.arange(len(rows)) - np.repeat(starts, count)
        size = np.where((row < LEAST) | (row > np.repeat(count - LEAST, count)), -1.0, np.abs(off))
        at = first_rows(size == np.repeat(np.maximum.reduceat(size, starts), count), starts)
        # at a step the farthest reading may be the last one before it
        at += (off[at] * off[at + 1] < 0) & (row[at] < count - LEAST)
        found.append(rows[at])
        starts = np.sort(np.concatenate([starts, at]))
    return np.sort(np.concatenate(found))


def _fuse(
    data: Readings,
    starts: Int[np.ndarray, " s"],
    fresh: Bool[np.ndarray, " s"],
    pieces: Int[np.ndarray, " p"],
    gain: float,
) -> tuple[Int[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
    """Share a segment too short to be cut between its neighbours, where one joint does nearly as well as its two.

    Splitting at a chord may leave a joint inside such a segment, which moving its two ends one by one cannot mend.
    """
    ends = np.append(starts[1:], len(data.x))
    first = np.isin(starts, pieces)
    inner = ~first & ~np.append(first[1:], True)
    changed = fresh | np.append(fresh[1:], False) | np.append(False, fresh[:-1])
    short = np.flatnonzero(inner & changed & (ends - starts < 2 * LEAST))
    short = short[np.diff(short, prepend=-3) >= 3]  # triples that share no segment
    if len(short) == 0:
        return starts, fresh
    cuts = _cut(data, starts[short - 1], ends[short + 1])
    triples = (short[:, None] + np.array([-1, 0, 1])).ravel()
    three = runs(data, starts[triples], ends[triples])
    apart = np.add.reduceat(fit(*three).misfit, 3 * np.arange(len(short)))
    fused = cuts.parts - apart < gain
    starts, fresh = starts.copy(), fresh.copy()
    starts[short[fused]] = cuts.row[fused]
    fresh[short[fused]] = fresh[short[fused] - 1] = True
    kept = np.ones(len(starts), dtype=bool)
    kept[short[fused] + 1] = False
    return starts[kept], fresh[kept]


def _settle(
    data: Readings,
    starts: Int[np.ndarray, " s"],
    fresh: Bool[np.ndarray, " s"],
    pieces: Int[np.ndarray, " p"],
    parity: int,
    gain: float,
) -> tuple[Int[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
    """Move or remove every other joint of each piece, where one of its two segments has changed."""
    heads = np.searchsorted(starts, pieces)
    number = np.arange(len(starts)) - np.repeat(heads, np.diff(np.append(heads, len(starts))))
    joint = np.flatnonzero((number % 2 == 1 - parity) & (number > 0))
    joint = joint[fresh[joint] | fresh[joint - 1]]
    if len(joint) == 0:
        return starts, fresh
    ends = np.append(starts[1:], len(data.x))
    cuts = _cut(data, starts[joint - 1], ends[joint])
    stays = cuts.whole - cuts.parts >= gain
    moved = stays & (cuts.row != starts[joint])
    starts, fresh = starts.copy(), fresh.copy()
    fresh[joint] = fresh[joint - 1] = False
    fresh[joint[moved]] = fresh[joint[moved] - 1] = True
    fresh[joint[~stays] - 1] = True
    # the neighbours of a segment that has changed are to be looked at with it: a joint asks both of its sides
    starts[joint[stays]] = cuts.row[stays]
    kept = np.ones(len(starts), dtype=bool)
    kept[joint[~stays]] = False
    return starts[kept], fresh[kept]


def _cuts_of(
    data: Readings, starts: Int[np.ndarray, " s"], chosen: Int[np.ndarray, " c"], gain: float
) -> Int[np.ndarray, " t"]:
    """First rows of new segments: the best cuts of the chosen ones, where they gain enough."""
    if len(chosen) == 0:
        return chosen
    ends = np.append(starts[1:], len(data.x))
    cuts = _cut(data, starts[chosen], ends[chosen])
    return cuts.row[cuts.whole - cuts.parts >= gain]


def _with(
    starts: Int[np.ndarray, " s"], added: Int[np.ndarray, " t"]
) -> tuple[Int[np.ndarray, " u"], Bool[np.ndarray, " u"]]:
    """All first rows in order, and whether each begins or ends a segment that has just been cut."""
    joined = np.sort(np.concatenate([starts, added]))
    new = np.isin(joined, added)
    return joined, new | np.append(new[1:], False)


def _cut(data: Readings, first: Int[np.ndarray, " c"], end: Int[np.ndarray, " c"]) -> Cuts:
    """The best cuts of separate runs of rows, ``first`` to ``end``."""
    taken, begin = runs(data, first, end)
    cuts = best_cuts(taken, begin, LEAST)
    return Cuts(first + cuts.row - begin, cuts.whole, cuts.parts)
