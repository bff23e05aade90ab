"""What a set of motions determines (RR-3507 §3.2.2 and Table 3.1), computed on the group and aware of the noise.

The rank of the linear system is not enough: two translations, or a rotation with a translation across its axis, leave
it deficient although R_X is unique, and rotations by pi leave answers that it cannot tell apart. So the information
about each unknown is compared with what the noise seen in the residuals would pretend by itself.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation
from scipy.stats import f as fisher

from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.geometry import se3

ROUNDING = 1e-14  # squared ratio of singular values below which exact data are called deficient
CONFIDENCE = 0.99


@dataclass(frozen=True)
class Observability:
    """The verdict on a set of motions. Directions are unit vectors in A's frame.

    ``free_direction``: the translation may be shifted along it (``t + alpha n``). ``free_axis``: the rotation may turn
    about it. ``alternatives``: other X that fit equally well (half turns). ``linear_rank``: ranks of eq. 3.13 (of 9)
    and eq. 3.12 (of 12). ``rotation_noise`` (rad) and ``translation_noise`` (length of B): standard deviation of one
    component of the residuals.
    """

    outcome: Outcome
    independent_axes: int
    free_direction: Float[np.ndarray, "3"] | None
    free_axis: Float[np.ndarray, "3"] | None
    alternatives: Float[np.ndarray, "k 4 4"]
    linear_rank: tuple[int, int]
    rotation_noise: float
    translation_noise: float

    @property
    def sentence(self) -> str:
        """The case in words, with its direction."""
        words = self.outcome.sentence
        direction = self.free_axis if self.free_axis is not None else self.free_direction
        if direction is not None:
            words += " (" + ", ".join(f"{v:.4f}" for v in direction) + " in the frame of A)"
        if len(self.alternatives):
            words += f"; {len(self.alternatives)} other answer{'s' if len(self.alternatives) > 1 else ''} known"
        return words


@dataclass(frozen=True)
class NoiseLevel:
    """Variances of one component of the residuals, and how many degrees of freedom they rest on."""

    rotation: float
    translation: float
    freedom: int


@lru_cache(maxsize=1024)
def _fisher_limit(freedom: int, noise_freedom: int) -> float:
    return float(fisher.ppf(CONFIDENCE, freedom, noise_freedom))


def stands_out(value: float, freedom: int, variance: float, noise_freedom: int) -> bool:
    """Whether a sum of squares is more than noise of that variance makes of ``freedom`` components (F test)."""
    freedom, noise_freedom = max(freedom, 1), max(noise_freedom, 1)
    return bool(value > freedom * variance * _fisher_limit(freedom, noise_freedom))


def noise_level(
    angle: Float[np.ndarray, " n"], distance: Float[np.ndarray, " n"], reach: float, unknowns: int = 3
) -> NoiseLevel:
    """The noise that residual angles (rad) and distances show; never less than rounding at lengths ``reach``."""
    freedom = max(3 * len(angle) - unknowns, 1)
    rounding = 4 * np.finfo(np.float64).eps
    rotation = float(np.sum(angle**2)) / freedom + rounding**2
    translation = float(np.sum(distance**2)) / freedom + (rounding * reach) ** 2
    return NoiseLevel(rotation, translation, freedom)


def only_noise_rotations(A: Float[np.ndarray, "n 4 4"], B: Float[np.ndarray, "n 4 4"]) -> Bool[np.ndarray, " n"]:
    """Which motions' rotations are mere noise.

    The noise is that of the angles, which A and B must share whatever X is; six times its size is taken for a rotation.
    """
    angles = [np.radians(se3.rotation_angle_deg(T[:, :3, :3])) for T in (A, B)]
    noise = np.sqrt(np.mean((angles[0] - angles[1]) ** 2)) + 4 * np.finfo(np.float64).eps
    return np.asarray(np.maximum(*angles) < 6 * noise)


def without_noise_rotations(
    A: Float[np.ndarray, "n 4 4"], B: Float[np.ndarray, "n 4 4"]
) -> tuple[Float[np.ndarray, "n 4 4"], Float[np.ndarray, "n 4 4"]]:
    """The motions with rotations that are mere noise set to the identity: as they stand, t_X could fit anything."""
    none = only_noise_rotations(A, B)
    A, B = A.copy(), B.copy()
    A[none, :3, :3] = B[none, :3, :3] = np.eye(3)
    return A, B


@dataclass(frozen=True)
class Axes:
    """How many independent rotation axes stand out (0, 1 or 2, more counts as 2), and the main one in A's frame."""

    count: int
    main: Float[np.ndarray, "3"]


def rotation_axes(
    A: Float[np.ndarray, "n 4 4"], B: Float[np.ndarray, "n 4 4"], R: Float[np.ndarray, "3 3"], noise: NoiseLevel
) -> Axes:
    """The axes of a set of motions: the scatter ``sum (R - I)^T (R - I)``, the lesser of both streams' counting."""
    n = len(A)
    scatters = []
    for rotations in (A[:, :3, :3], R @ B[:, :3, :3] @ R.T):
        excess = rotations - np.eye(3)
        scatters.append(np.einsum("nji,njk->ik", excess, excess))
    main = np.linalg.eigh(scatters[0] + scatters[1])[1][:, 0]
    count = 2
    for values in map(np.linalg.eigvalsh, scatters):
        if not stands_out(values[2], 2 * n, noise.rotation, noise.freedom):
            return Axes(0, main)
        # an exact set is deficient where the ratio is rounding
        least = max(values[0] - ROUNDING * values[2], 0.0)
        if not stands_out(least, 2 * n - 2, noise.rotation, noise.freedom):
            count = 1
    return Axes(count, main)


def turn_information(
    A: Float[np.ndarray, "n 4 4"],
    moved_B: Float[np.ndarray, "n 3"],
    axis: Float[np.ndarray, "3"],
    scaled: bool,
) -> tuple[float, float]:
    """What the translations say of a turn of R_X about ``axis`` once t_X (and the scale) have taken their share.

    Returns that sum of squares and the one before the others took their share. ``moved_B`` is R_X t_B.
    """
    column = np.cross(axis, moved_B).reshape(-1)
    others = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    if scaled:
        others = np.concatenate([others, A[:, :3, 3].reshape(-1, 1)], axis=1)
    rest = column - others @ np.linalg.lstsq(others, column, rcond=1e-7)[0]
    return float(rest @ rest), float(column @ column)


def scale_information(A: Float[np.ndarray, "n 4 4"], scale: float) -> tuple[float, float]:
    """What the camera's translations say of the scale once t_X has taken its share (eq. 4.3), in B's unit."""
    column = scale * A[:, :3, 3].reshape(-1)
    others = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    rest = column - others @ np.linalg.lstsq(others, column, rcond=1e-7)[0]
    return float(rest @ rest), float(column @ column)


def linear_ranks(
    A: Float[np.ndarray, "n 4 4"], B: Float[np.ndarray, "n 4 4"], noise: NoiseLevel | None = None
) -> tuple[int, int]:
    """Ranks of the linear systems of eq. 3.13 (9 unknowns) and eq. 3.12 (12 unknowns), Table 3.1.

    Without ``noise`` the motions are taken as exact. Lengths are in units of the translations' root mean square.
    """
    n = len(A)
    lengths = float(np.sqrt(np.mean(np.sum(B[:, :3, 3] ** 2, axis=1)))) if n else 1.0
    unit = lengths if lengths > 0 else 1.0
    S = np.eye(9) - np.einsum("nij,nkl->nikjl", A[:, :3, :3], B[:, :3, :3]).reshape(n, 9, 9)
    bottom = np.zeros((n, 3, 12))
    for row in range(3):
        bottom[:, row, 3 * row : 3 * row + 3] = B[:, :3, 3] / unit
    bottom[:, :, 9:] = np.eye(3) - A[:, :3, :3]
    whole = np.concatenate([np.concatenate([S, np.zeros((n, 9, 3))], axis=2), bottom], axis=1).reshape(-1, 12)
    rotation_limit = 0.0 if noise is None else np.sqrt(2 * n * noise.rotation * _fisher_limit(2 * n, noise.freedom))
    whole_limit = rotation_limit
    if noise is not None:
        whole_limit = np.hypot(rotation_limit, np.sqrt(n * noise.translation) / unit)
    return _rank(S.reshape(-1, 9), rotation_limit), _rank(whole, whole_limit)


def _rank(matrix: Float[np.ndarray, "m k"], limit: float) -> int:
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > max(limit, 1e-7 * values[0] if len(values) else 0.0, 1e-12)))


def flips(A: Float[np.ndarray, "n 4 4"], moved_B: Float[np.ndarray, "n 3"], axes: Axes) -> Float[np.ndarray, "3 3 3"]:
    """The half turns Q for which ``Q R_X`` could be another answer.

    Q must leave each axis (up to its sign) and each translation alone, so its own axis is one of two independent
    directions of the set, or perpendicular to both.
    """
    quaternions = Rotation.from_matrix(A[:, :3, :3]).as_quat()
    directions = quaternions[:, :3]
    first = directions[np.argmax(np.linalg.norm(directions, axis=1))]
    if axes.count < 2:
        directions = moved_B
    if axes.count == 0:
        first = directions[np.argmax(np.linalg.norm(directions, axis=1))]
    first = _unit(first)
    across = directions - np.outer(directions @ first, first)
    second = _unit(directions[np.argmax(np.linalg.norm(across, axis=1))])
    third = _unit(np.cross(first, second))
    candidates = np.stack([first, second, third])
    candidates[np.linalg.norm(candidates, axis=1) < 0.5] = [0.0, 0.0, 1.0]
    return Rotation.from_rotvec(np.pi * candidates).as_matrix()


def _unit(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else np.zeros(3)
