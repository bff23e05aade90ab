"""From absolute poses to pairs of motions, which pairs to take, and how well a set of motions excites the problem."""

from dataclasses import dataclass
from enum import Enum
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3

PairChoice = Literal["all", "consecutive", "spread"]


class Setup(Enum):
    """Who carries the camera and what the camera's poses say; the values are the names users write.

    The hand's poses are always ``T_base_hand``. ``x_name`` and ``z_name`` are the two unknowns.
    """

    EYE_IN_HAND = "eye-in-hand"
    EYE_TO_HAND = "eye-to-hand"
    MOVING_FRAMES = "moving-frames"

    @property
    def sentence(self) -> str:
        return {
            Setup.EYE_IN_HAND: "the camera is on the hand and gives T_camera_target of a fixed target",
            Setup.EYE_TO_HAND: "the camera is fixed and gives T_camera_target of a target on the hand",
            Setup.MOVING_FRAMES: "the camera is on the hand and gives its own pose in a fixed world, T_target_camera",
        }[self]

    @property
    def x_name(self) -> str:
        return "T_base_camera" if self is Setup.EYE_TO_HAND else "T_hand_camera"

    @property
    def z_name(self) -> str:
        return "T_hand_target" if self is Setup.EYE_TO_HAND else "T_base_target"


@dataclass(frozen=True)
class Chain:
    """Both streams brought to one form, ``H_i X C_i = Z`` for every pose i; X and Z are those of the set-up."""

    H: Float[np.ndarray, "*b n 4 4"]
    C: Float[np.ndarray, "*b n 4 4"]


def chain(hand: Float[np.ndarray, "n 4 4"], camera: Float[np.ndarray, "m 4 4"], setup: Setup) -> Chain:
    """``H_i X C_i = Z`` from T_base_hand and the camera's poses, as the set-up gives them."""
    if len(hand) != len(camera):
        raise InputError(f"Each row needs both poses, but the hand has {len(hand)} rows and the camera {len(camera)}.")
    if setup is Setup.EYE_TO_HAND:
        return Chain(se3.inverse(hand), camera)
    if setup is Setup.MOVING_FRAMES:
        return Chain(hand, se3.inverse(camera))
    return Chain(hand, camera)


@dataclass(frozen=True)
class MotionPairs:
    """A (camera) and B (hand) with ``A Y = Y B``, ``Y = X^-1``, and the poses (i, j) that each pair goes between."""

    A: Float[np.ndarray, "m 4 4"]
    B: Float[np.ndarray, "m 4 4"]
    index: Int[np.ndarray, "m 2"]


def motion_pairs(poses: Chain, choice: PairChoice = "all", count: int | None = None) -> MotionPairs:
    """Motions between poses: A = C_j C_i^-1 and B = H_j^-1 H_i, so that ``A Y = Y B`` with Y = X^-1 (RR-3507's X).

    ``all``: every two poses once; ``consecutive``: neighbours in time; ``spread``: ``count`` pairs (default: as many as
    poses) that together say most. Motions of large angle and unlike axes are best (RR-3507 §3.6.1 after Tsai and Lenz).

    A motion and its reverse are not the same measurement to a least-squares method, so ``all`` and ``spread`` put the
    poses in an order of their own first: however the rows are permuted, the pairs are the same.
    """
    n = len(poses.H)
    if choice == "consecutive":
        index = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1) if n > 1 else np.zeros((0, 2), int)
    else:
        index = order_by_content(poses)[np.stack(np.triu_indices(n, 1), axis=1)]
    if choice == "spread":
        index = index[_spread(poses.H, index, n if count is None else count)]
    i, j = index[:, 0], index[:, 1]
    A = poses.C[j] @ se3.inverse(poses.C[i])
    B = se3.inverse(poses.H[j]) @ poses.H[i]
    return MotionPairs(A, B, index)


def order_by_content(poses: Chain) -> Int[np.ndarray, " n"]:
    """The rows in an order that depends on the poses themselves and not on how they are listed."""
    n = len(poses.H)
    return np.lexsort(np.concatenate([poses.C.reshape(n, 16), poses.H.reshape(n, 16)], axis=1).T)


def _spread(H: np.ndarray, index: np.ndarray, count: int) -> np.ndarray:
    """Greedy choice of pairs: each adds most to the determinant of ``sum (R - I)^T (R - I)``."""
    R = np.swapaxes(H[index[:, 1], :3, :3], 1, 2) @ H[index[:, 0], :3, :3]
    excess = R - np.eye(3)
    scatter = np.swapaxes(excess, 1, 2) @ excess
    total, left, chosen = 1e-6 * np.eye(3), np.ones(len(index), bool), []
    for _ in range(min(count, len(index))):
        gain = np.where(left, np.linalg.det(total + scatter), -np.inf)
        best = int(np.argmax(gain))
        chosen.append(best)
        left[best] = False
        total = total + scatter[best]
    return np.sort(np.array(chosen, int))


@dataclass(frozen=True)
class Excitation:
    """How strongly a set of motions excites the problem.

    ``angles_deg``: least, median and largest rotation; ``axis_spread``: smallest over largest eigenvalue of the axes'
    scatter, 0 for parallel axes and 1/1 for evenly spread ones; ``lengths``: least, median and largest translation.
    """

    angles_deg: tuple[float, float, float]
    axis_spread: float
    lengths: tuple[float, float, float]


def excitation(motions: Float[np.ndarray, "n 4 4"]) -> Excitation:
    """The excitation of a set of motions; with none of them, zeros."""
    if len(motions) == 0:
        return Excitation((0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
    angles = se3.rotation_angle_deg(motions[:, :3, :3])
    lengths = np.linalg.norm(motions[:, :3, 3], axis=1)
    excess = motions[:, :3, :3] - np.eye(3)
    # sum (R - I)^T (R - I) = sum 2 (1 - cos) (I - n n^T): its smallest eigenvalue vanishes for parallel axes
    values = np.linalg.eigvalsh(np.einsum("nji,njk->ik", excess, excess))
    spread = float(max(values[0], 0.0) / values[2]) if values[2] > 0 else 0.0
    return Excitation(_range(angles), spread, _range(lengths))


def _range(values: np.ndarray) -> tuple[float, float, float]:
    return float(values.min()), float(np.median(values)), float(values.max())
