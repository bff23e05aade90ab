"""What a finished sweep tells: who is right, how often with which interval, which basins, and without the truth.

Poses are compared by the angle between their rotations and by where they put the source's centroid, never by their
translation at a far origin. ``size`` is a length of the object (diagonal of the source's box), unit of the data.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from jaxmodel.geometry.se3 import quaternion_distance, rotation_angle_deg, rotation_to_quaternion
from jaxmodel.register.outcome import Outcome
from jaxmodel.register.sweep import Sweep

SAME_DEG = 5.0
SAME_OF_SIZE = 0.03
_SLAB = 4096
"""Poses handled at once where the intermediate arrays are larger than the poses themselves."""


class TruthErrors(eqx.Module):
    """Against the true pose: rotation angle, quaternion distance, and distance between the source's centroids."""

    rotation_deg: Float[np.ndarray, " s"]
    quaternion: Float[np.ndarray, " s"]
    translation: Float[np.ndarray, " s"]


class Success(eqx.Module):
    """A success rate with its 95 % Wilson interval."""

    count: int
    total: int
    rate: float
    low: float
    high: float


class Plateau(eqx.Module):
    """The truth-free test of §2.9.2: which starts share the best result, or why none can be named.

    ``level``: median error of the members; ``gap``: error of the best other basin / ``level``.
    """

    found: bool
    members: Bool[np.ndarray, " s"]
    level: float
    gap: float
    sentence: str


def truth_errors(
    T_target_source: Float[np.ndarray, "s 4 4"],
    T_true: Float[np.ndarray, "4 4"],
    source_centroid: Float[np.ndarray, "3"],
) -> TruthErrors:
    """Errors of many poses against the true one; infinite for a pose that is not finite."""
    parts = [
        _truth_errors(T_target_source[first : first + _SLAB], T_true, source_centroid)
        for first in range(0, max(len(T_target_source), 1), _SLAB)
    ]
    return TruthErrors(*(np.concatenate(errors) for errors in zip(*parts, strict=True)))


def _truth_errors(T_target_source: np.ndarray, T_true: np.ndarray, source_centroid: np.ndarray) -> list[np.ndarray]:
    finite = np.all(np.isfinite(T_target_source), axis=(1, 2))
    T = np.where(finite[:, None, None], T_target_source, np.eye(4))
    relative = np.swapaxes(T[:, :3, :3], 1, 2) @ T_true[:3, :3]
    quaternions = rotation_to_quaternion(T[:, :3, :3])
    truth = np.broadcast_to(rotation_to_quaternion(T_true[:3, :3]), quaternions.shape)
    shift = T[:, :3, :3] @ source_centroid + T[:, :3, 3] - (T_true[:3, :3] @ source_centroid + T_true[:3, 3])
    errors = rotation_angle_deg(relative), quaternion_distance(quaternions, truth), np.linalg.norm(shift, axis=1)
    return [np.where(finite, error, np.inf) for error in errors]


def axis_angle_errors(
    T_target_source: Float[np.ndarray, "s 4 4"], T_true: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
    """Errors of the axis and of the angle of the rotation between two views (Tables 2.2, 2.3).

    Returns:
        The distance between the two unit axes, and the difference of the angles in degrees, not negative. Infinite for
        a pose that is not finite. An axis means something only where the true angle is well above the error.
    """
    finite = np.all(np.isfinite(T_target_source), axis=(1, 2))
    turns = Rotation.from_matrix(np.where(finite[:, None, None], T_target_source, np.eye(4))[:, :3, :3]).as_rotvec()
    truth = Rotation.from_matrix(T_true[:3, :3]).as_rotvec()
    angles, true_angle = np.linalg.norm(turns, axis=1), float(np.linalg.norm(truth))
    tiny = np.finfo(float).tiny
    axis_error = np.linalg.norm(turns / np.maximum(angles, tiny)[:, None] - truth / max(true_angle, tiny), axis=1)
    angle_error = np.degrees(np.abs(angles - true_angle))
    return np.where(finite, axis_error, np.inf), np.where(finite, angle_error, np.inf)


def right(errors: TruthErrors, tolerance_deg: float = SAME_DEG, tolerance: float = np.inf) -> Bool[np.ndarray, " s"]:
    """A pose is right within ``tolerance_deg`` and, at the source's centroid, ``tolerance`` (unit of the data)."""
    return (errors.rotation_deg <= tolerance_deg) & (errors.translation <= tolerance)


def success(is_right: Bool[np.ndarray, " s"], confidence: float = 0.95) -> Success:
    """Success rate and Wilson score interval; an empty sweep is refused with a ``ValueError``."""
    total, count = len(is_right), int(np.sum(is_right))
    if total == 0:
        raise ValueError("a success rate needs at least one start")
    z = float(norm.ppf(0.5 + confidence / 2))
    rate = count / total
    centre = (rate + z * z / (2 * total)) / (1 + z * z / total)
    half = z / (1 + z * z / total) * np.sqrt(rate * (1 - rate) / total + z * z / (4 * total * total))
    return Success(count, total, rate, max(0.0, float(centre - half)), min(1.0, float(centre + half)))


def distinct(starts: Float[np.ndarray, "s 4 4"], tolerance_deg: float = 1e-3) -> int:
    """Number of distinct rotations among the starts (the Euler grid of 1000 triples holds 500)."""
    q = _quaternions(starts[:, :3, :3])
    tree = KDTree(np.concatenate([q, -q]))
    reach = 2 * np.sin(np.radians(tolerance_deg) / 4)
    count = 0
    for begin in range(0, len(q), _SLAB):
        found = tree.query_ball_point(q[begin : begin + _SLAB], reach)
        count += sum(min(index % len(q) for index in near) == begin + row for row, near in enumerate(found))
    return count


def _quaternions(R: Float[np.ndarray, "s 3 3"]) -> Float[np.ndarray, "s 4"]:
    return np.concatenate([rotation_to_quaternion(R[first : first + _SLAB]) for first in range(0, len(R), _SLAB)])


def labels(
    T_target_source: Float[np.ndarray, "s 4 4"],
    error: Float[np.ndarray, " s"],
    source_centroid: Float[np.ndarray, "3"],
    size: float,
    same_deg: float = SAME_DEG,
    same_of_size: float = SAME_OF_SIZE,
) -> Int[np.ndarray, " s"]:
    """Basin of each start: 0 for the poses around the lowest error, 1 around the lowest of the rest, and so on.

    Poses within ``same_deg`` and ``same_of_size`` sizes of a basin's best pose belong to it; a pose that is not finite
    gets -1. The labels depend on the set of results only, not on their order.
    """
    result = np.full(len(error), -1)
    valid = np.flatnonzero(np.isfinite(T_target_source).all(axis=(1, 2)))
    if not len(valid):
        return result
    R = T_target_source[valid, :3, :3]
    centroids = R @ source_centroid + T_target_source[valid, :3, 3]
    # poses near in both senses are near in this space, in every coordinate (|q - q'| = 2 sin(angle / 4))
    reach = same_of_size * size
    scale = reach / (2 * np.sin(np.radians(same_deg) / 4))
    place = np.concatenate([centroids, scale * _quaternions(R)], axis=1)
    tree = KDTree(place, balanced_tree=False, compact_nodes=False)
    signs = np.array([[1, 1, 1, 1, 1, 1, 1], [1, 1, 1, -1, -1, -1, -1]])  # q and -q are the same rotation
    rest = np.ones(len(valid), bool)
    label = 0
    columns = [T_target_source[valid, row, column] for row in range(3) for column in range(4)]
    for start in np.lexsort((*columns, error[valid])):
        if not rest[start]:
            continue
        near = np.unique(np.concatenate(tree.query_ball_point(signs * place[start], 1.001 * reach, p=np.inf)))
        near = near.astype(np.int64)
        near = near[rest[near]]
        near = near[np.linalg.norm(centroids[near] - centroids[start], axis=1) <= reach]
        near = near[rotation_angle_deg(np.swapaxes(R[near], 1, 2) @ R[start]) <= same_deg]
        result[valid[near]] = label
        rest[near] = False
        label += 1
    return result


def same_basin(
    first: Sweep, second: Sweep, source_centroid: Float[np.ndarray, "3"], size: float
) -> Bool[np.ndarray, " s"]:
    """Whether each start ended in the same basin in two sweeps (other executor, other machine), labelled jointly."""
    T = np.concatenate([first.T_target_source, second.T_target_source])
    joint = labels(T, np.concatenate([first.error, second.error]), source_centroid, size)
    return joint[: len(first)] == joint[len(first) :]


# A plateau stands out when at least FEWEST starts share it and the best other basin's error is GAP times its level.
# On the real bunny scans right basins reach 1.3 to 1.6 and pairs without common surface stay below 1.1.
FEWEST = 3
GAP = 1.15


def plateau(sweep: Sweep, source_centroid: Float[np.ndarray, "3"], size: float) -> Plateau:
    """The lower plateau of the sorted error curve, found without the truth (§2.9.2: "clearly identifiable").

    Among the starts whose matched fraction is at least half of the sweep's largest, the basin of the lowest error is
    named when enough starts share it and its error stands clear below every other basin's; else the test abstains.
    """
    nobody = np.zeros(len(sweep), bool)
    matched = sweep.matched_fraction >= 0.5 * sweep.matched_fraction.max()
    eligible = matched & np.isfinite(sweep.error) & (sweep.outcome != Outcome.NOT_FINITE)
    if eligible.sum() < FEWEST:
        return Plateau(False, nobody, np.inf, np.nan, f"only {int(eligible.sum())} starts kept enough pairs to compare")
    order = np.where(eligible, sweep.error, np.inf)
    basin = labels(sweep.T_target_source, order, source_centroid, size)
    members = basin == 0
    level = float(np.median(sweep.error[members & eligible]))
    others = eligible & ~members
    gap = float(sweep.error[others].min() / max(level, np.finfo(float).tiny)) if others.any() else np.inf
    share = f"{int(members.sum())} of {len(sweep)} starts share the lowest error"
    if members.sum() < FEWEST:
        return Plateau(False, nobody, level, gap, f"no plateau: only {share}")
    if gap < GAP:
        return Plateau(
            False, nobody, level, gap, f"no plateau: the next basin's error is only {gap:.2f} times the lowest"
        )
    return Plateau(True, members, level, gap, f"{share}; the next basin's error is {gap:.2f} times theirs")
