"""Whether a registration is right, without the truth: a probability from what speaks for and against it.

Two figures tell right from wrong: how much of each scan the other also shows, and how much of each contradicts what the
other's sensor read. Their weights were fitted once, by logistic regression, to 240 pairs of simulated views of fifteen
objects (seven built in, four plain solids, four scanned or designed meshes; 30 to 180 degrees apart, noise 0, 0.1 and
0.3 % of the size) of which 146 came out right; each object judged by the others' pairs, the area under the curve was
0.967. That a sensor read nothing where a surface should be says less than that it looked through it: real sensors miss
some of what they look at, simulated ones do not.

Right is up to the object's own symmetries: nothing in two scans tells its equivalent poses apart, so these are listed
beside it. The experiment ``search`` measures the probability on other pairs.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.register.candidates import Candidates
from jaxmodel.register.degeneracy import Freedom
from jaxmodel.register.evidence import Evidence

CONSTANT, OF_OVERLAP, OF_CONTRADICTION = 4.33, 1.17, -25.3
"""Of the logit: of the logarithm of the smaller share near the other scan, and of the root of what contradicts, as a
share of what is near."""
NOTHING_READ = 0.15
"""What a point counts that lies where the other sensor read nothing, beside one that it looked through."""
LEAST_OVERLAP, LEAST_NEAR = 1e-3, 0.02
"""What is not met is not less than this, so that logarithm and quotient stay finite."""
CONVINCING = 0.5
"""Probability from which on a pose is taken for right."""
EQUAL = 0.85
"""Least score, of the best one's, of a pose that explains the scans as well."""


class SearchOutcome(IntEnum):
    """How a search ended."""

    FOUND = 0
    SEVERAL = 1
    REFUSED = 2
    SAME_SCAN = 3

    @property
    def sentence(self) -> str:
        """What the outcome means."""
        return {
            SearchOutcome.FOUND: "one pose stands out and nothing contradicts it",
            SearchOutcome.SEVERAL: "several poses explain the scans as well as each other: the object looks alike",
            SearchOutcome.REFUSED: "no pose is convincing: the scans share too little, or nothing that tells",
            SearchOutcome.SAME_SCAN: "target and source hold the same points",
        }[self]


class Found(NamedTuple):
    """What a search found.

    ``probability`` that the surfaces are put together rightly, up to the object's symmetries; ``overlap``: share of
    the target near the source, and of the source near the target; ``contradicted``: shares of both, added, that stand
    where the other's sensor saw through; ``scatter``: root mean square distance to tangent planes where they meet, unit
    of the data; ``rival``: score of the next different pose in the best one's, 0 to 1; ``equivalents (k, 4, 4)``: other
    poses that explain the scans as well, best first; ``freedom`` of the part they share: motions that the surfaces do
    not feel, target frame, None where they share too little to tell. The pose is the best one also where it is refused.
    """

    T_target_source: Float[np.ndarray, "4 4"]
    outcome: SearchOutcome
    probability: float
    overlap: tuple[float, float]
    contradicted: float
    scatter: float
    rival: float
    equivalents: Float[np.ndarray, "k 4 4"]
    freedom: Freedom | None = None


def probability_of(evidence: Evidence) -> Float[np.ndarray, " n"]:
    """That each pose is right, from its evidence alone."""
    source, target = evidence.source, evidence.target
    near = np.minimum(source.near, target.near)
    broken = source.front + target.front + NOTHING_READ * (source.empty + target.empty)
    share = np.asarray(broken / (source.near + target.near + LEAST_NEAR), np.float64)
    logit = CONSTANT + OF_OVERLAP * np.log(np.maximum(near, LEAST_OVERLAP)) + OF_CONTRADICTION * np.sqrt(share)
    return 1 / (1 + np.exp(-logit))


def judged(found: Candidates) -> Found:
    """The best of the candidates (best first), and how far to trust it."""
    probability = probability_of(found.evidence)
    best = found.score[0]
    as_good = (found.score >= EQUAL * best) & (probability >= CONVINCING)
    as_good[0] = False
    source, target = found.evidence.source, found.evidence.target
    convincing = probability[0] >= CONVINCING
    outcome = (
        SearchOutcome.REFUSED if not convincing else SearchOutcome.SEVERAL if as_good.any() else SearchOutcome.FOUND
    )
    rival = float(np.clip(found.score[1] / best, 0, 1)) if len(found.score) > 1 and best > 0 else float(best <= 0)
    return Found(
        T_target_source=found.T_target_source[0],
        outcome=outcome,
        probability=float(probability[0]),
        overlap=(float(target.near[0]), float(source.near[0])),
        contradicted=float(source.front[0] + source.empty[0] + target.front[0] + target.empty[0]),
        scatter=float(np.sqrt((source.scatter[0] ** 2 + target.scatter[0] ** 2) / 2)),
        rival=rival,
        equivalents=found.T_target_source[as_good] if convincing else np.zeros((0, 4, 4)),
    )


def same_scan() -> Found:
    """What is found where both scans hold the same points."""
    return Found(np.eye(4), SearchOutcome.SAME_SCAN, 1.0, (1.0, 1.0), 0.0, 0.0, 0.0, np.zeros((0, 4, 4)))
