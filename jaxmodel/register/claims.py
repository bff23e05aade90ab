"""Two claims of thesis §2.9.2 put to the test on a finished sweep.

"The error on the initial translation has no effect": the same rotations are run again with random offsets, and the
outcomes are compared start by start. "The starts that converge form no coherent set in the space of rotations": the
converging starts' nearest neighbours are compared with those under random relabelling.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from jaxmodel.errors import InputError

_NEIGHBOURS = 24
_TIE = 1e-5


class TranslationEffect(NamedTuple):
    """Outcomes of the same starts without and with an offset: a paired 2 x 2 table and McNemar's exact test."""

    both: int
    only_without: int
    only_with: int
    neither: int
    rate_without: float
    rate_with: float
    p_value: float


class Coherence(NamedTuple):
    """How often a converging start's nearest neighbour in rotation converges too, against random relabelling."""

    distinct: int
    converging: int
    neighbour_rate: float
    random_rate: float
    p_value: float


def offset_starts(
    starts: Float[np.ndarray, "s 4 4"], size: float, seed: int, chosen: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "c 4 4"]:
    """The chosen starts with a random translation added, uniform in a ball.

    Args:
        starts: T_target_source of the whole sweep.
        size: the ball's radius, in the unit of the data; the object's size tests the thesis's claim.
        seed: start i draws from ``[seed, i]``, so it gets the same offset whatever else is chosen.
        chosen: indices into ``starts``.
    """
    moved = np.array(starts[chosen], dtype=np.float64)
    for row, start in enumerate(chosen):
        draw = np.random.default_rng([seed, int(start)])
        direction = draw.normal(size=3)
        moved[row, :3, 3] += size * draw.uniform() ** (1 / 3) * direction / np.linalg.norm(direction)
    return moved


def translation_effect(without: Bool[np.ndarray, " c"], with_offset: Bool[np.ndarray, " c"]) -> TranslationEffect:
    """Compare which of the same starts came out right without and with an offset (McNemar's exact test, two-sided).

    A small ``p_value`` says that the offset matters. Empty input is an ``InputError``.
    """
    if len(without) == 0:
        raise InputError("the translation claim needs at least one start")
    counts = [(without & with_offset), (without & ~with_offset), (with_offset & ~without), ~(without | with_offset)]
    return paired_effect(*(int(np.sum(count)) for count in counts))


def paired_effect(both: int, only_without: int, only_with: int, neither: int) -> TranslationEffect:
    """As ``translation_effect``, from counts already made, for instance summed over several sweeps."""
    changed, total = only_without + only_with, both + only_without + only_with + neither
    return TranslationEffect(
        both=both,
        only_without=only_without,
        only_with=only_with,
        neither=neither,
        rate_without=(both + only_without) / total,
        rate_with=(both + only_with) / total,
        p_value=float(binomtest(only_with, changed).pvalue) if changed else 1.0,
    )


def coherence(
    rotations: Float[np.ndarray, "s 3 3"], converging: Bool[np.ndarray, " s"], permutations: int = 999, seed: int = 0
) -> Coherence | None:
    """Whether converging starts lie together in the space of rotations.

    Equal rotations (the Euler grid holds most of them twice) are counted once, converging if most of their copies are;
    neighbours at the same angle share one vote. A small ``p_value`` says that converging starts have converging
    neighbours more often than under random relabelling: they do form a coherent set.

    Returns:
        ``None`` if fewer than two distinct starts converge or fewer than two do not: nothing to tell.
    """
    quaternions, right = _distinct(rotations, converging)
    n, count = len(right), int(right.sum())
    if count < 2 or n - count < 2:
        return None
    votes = _nearest_votes(quaternions)

    owner = np.repeat(np.arange(n), [len(v) for v in votes])
    neighbour = np.concatenate(votes)
    weight = 1.0 / np.repeat([len(v) for v in votes], [len(v) for v in votes])

    def neighbour_rate(labels: Bool[np.ndarray, " n"]) -> float:
        return float(np.sum(weight[labels[owner] & labels[neighbour]]) / count)

    observed = neighbour_rate(right)
    draw = np.random.default_rng([seed, n])
    relabelled = np.array([neighbour_rate(draw.permutation(right)) for _ in range(permutations)])
    return Coherence(
        distinct=n,
        converging=count,
        neighbour_rate=observed,
        random_rate=(count - 1) / (n - 1),
        p_value=float((1 + np.sum(relabelled >= observed - 1e-12)) / (1 + permutations)),
    )


def _distinct(
    rotations: Float[np.ndarray, "s 3 3"], converging: Bool[np.ndarray, " s"]
) -> tuple[Float[np.ndarray, "n 4"], Bool[np.ndarray, " n"]]:
    quaternions = Rotation.from_matrix(rotations).as_quat()
    rounded = np.round(quaternions, 5) + 0.0
    first = np.argmax(np.abs(rounded) > 0.01, axis=1)  # q and -q are one rotation: make the first large entry positive
    sign = np.sign(np.take_along_axis(rounded, first[:, None], axis=1))
    _, index, group = np.unique(rounded * sign + 0.0, axis=0, return_index=True, return_inverse=True)
    share = np.bincount(group.ravel(), weights=converging) / np.bincount(group.ravel())
    return quaternions[index], share >= 0.5


def _nearest_votes(quaternions: Float[np.ndarray, "n 4"]) -> list[np.ndarray]:
    n = len(quaternions)
    tree = KDTree(np.concatenate([quaternions, -quaternions]))
    distance, index = (np.asarray(found) for found in tree.query(quaternions, k=min(_NEIGHBOURS, 2 * n)))
    votes = []
    for i in range(n):
        other = index[i] % n != i
        nearest = distance[i][other].min()
        votes.append(np.unique(index[i][other & (distance[i] <= nearest + _TIE)] % n))
    return votes
