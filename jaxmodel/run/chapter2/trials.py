"""What a study consists of: the nodes of its YAML, and the trials they lead to."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxmodel.control_points import ControlPoints
from jaxmodel.errors import InputError
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.register import IcpMethod
from jaxmodel.register.starts import plausible_starts
from jaxmodel.run.config import Execution, PlausibleStarts, Right, Scans
from jaxmodel.run.pairs import Pair, load_pairs, source_extent


@dataclass(frozen=True)
class Group:
    """Pairs that are registered with the same kinds of control points."""

    scans: Scans
    control_points: tuple[ControlPoints, ...]
    stands_for: str = ""
    """The published object, for the tables."""

    def __post_init__(self) -> None:
        if not self.control_points:
            raise ValueError("control_points is empty, expected at least one kind")


@dataclass(frozen=True, kw_only=True)
class StudyConfig:
    """What the YAML of every study has.

    ``draws``: how often the noise of simulated scans is drawn. ``compared``: the two kinds the verdict is about.
    """

    groups: tuple[Group, ...]
    seed: int = 0
    draws: int = 1
    counts: tuple[int, ...] = (1000,)
    starts: PlausibleStarts = field(default_factory=PlausibleStarts)
    method: str | IcpMethod = "thesis_2005"
    right: Right = field(default_factory=Right)
    compared: tuple[str, str] = ("contours", "vertices")
    resamples: int = 2000
    engine: Execution = field(default_factory=Execution)

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("draws", 1), ("resamples", 100)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {least} or more")
        for name in ("groups", "counts"):
            if not getattr(self, name):
                raise ValueError(f"{name} is empty, expected at least one")
        kinds = {kind.kind for group in self.groups for kind in group.control_points}
        absent = [kind for kind in self.compared if kind not in kinds]
        if absent:
            raise ValueError(f"compared names '{absent[0]}', expected one of: {', '.join(sorted(kinds))}")
        if min(self.counts) < 3:
            raise ValueError(f"counts holds {min(self.counts)}, expected at least 3 points to fit a motion to")


@dataclass(frozen=True)
class Trial:
    """One pair, one number of points for each view, one set of starts: a test for every kind of control points."""

    pair: Pair
    kinds: tuple[ControlPoints, ...]
    counts: tuple[int, int]
    """Asked for: of the target, of the source."""
    starts: Float[np.ndarray, "s 4 4"]
    draw: int = 0
    stands_for: str = ""
    """The published object."""
    variant: str = ""
    """What sets the trial apart from others of the same pair, in words."""
    traced: int = 0
    """So many of the first starts are run again, iteration by iteration."""
    follows: int | None = None
    """Number of an earlier trial whose results, kind by kind, are the starts of this one."""

    @property
    def labels(self) -> tuple[str, ...]:
        """One word for each kind; kinds that occur twice are told apart by their other options."""
        words = [kind.kind for kind in self.kinds]
        return tuple(_label(kind, words.count(kind.kind) > 1) for kind in self.kinds)


@dataclass(frozen=True)
class Placed:
    """A pair with where it came from."""

    group: Group
    draw: int
    pair: Pair


def placed_pairs(config: StudyConfig, groups: Sequence[Group] | None = None) -> list[Placed]:
    """Every pair of the groups, simulated ones once for each draw of the noise; pairs need their true pose."""
    found = []
    for group in config.groups if groups is None else groups:
        for draw in range(config.draws if hasattr(group.scans, "noise") else 1):
            for pair in load_pairs(group.scans, 1000 * config.seed + draw):
                if pair.T_target_source is None:
                    raise InputError(f"{pair.name}: a study needs the true pose, expected scans with a truth")
                found.append(Placed(group, draw, pair))
    return found


def starts_of(config: StudyConfig, pair: Pair, number: int) -> Float[np.ndarray, "s 4 4"]:
    """Plausible starts of a pair; ``number`` sets its draws apart from those of others."""
    wanted, truth = config.starts, pair.T_target_source
    assert truth is not None
    centroid, size = source_extent(pair)
    shift = wanted.shift_of_size * size
    seed = 1_000_003 * config.seed + number
    return plausible_starts(truth, centroid, wanted.count, seed, wanted.spread_deg, shift, wanted.most_deg)


def plain_trials(config: StudyConfig) -> list[Trial]:
    """Each pair with each of the counts, the same starts for all of them."""
    return [
        Trial(placed.pair, placed.group.control_points, (count, count), starts, placed.draw, placed.group.stands_for)
        for number, placed in enumerate(placed_pairs(config))
        for starts in [starts_of(config, placed.pair, number)]
        for count in config.counts
    ]


def _label(kind: ControlPoints, ambiguous: bool) -> str:
    if not ambiguous:
        return kind.kind
    own: dict[str, Any] = {key: value for key, value in unstructure(kind).items() if key not in ("kind", "count")}
    words = ["+".join(value) if isinstance(value, list) else str(value) for value in own.values()]
    return f"{kind.kind} {' '.join(words)}"
