"""How a search is judged with the truth: right or wrong, up to the object's own symmetries, and how well it knew."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import rankdata

from jaxmodel.geometry.se3 import inverse, rotation_angle_deg
from jaxmodel.mesh.distance import sample_surface, to_surface
from jaxmodel.scan.triangle_mesh import ObjectMesh

ALIKE = 0.01
"""Root mean square distance, in the length of the search, of an object moved onto itself by a symmetry."""
SAMPLES = 3000


class PoseError(NamedTuple):
    """``turn_deg`` between found and true rotation; ``shift`` of the source's centroid, unit of the data."""

    turn_deg: float
    shift: float


def pose_error(
    found: Float[np.ndarray, "4 4"], true: Float[np.ndarray, "4 4"], centroid: Float[np.ndarray, "3"]
) -> PoseError:
    """Of T_target_source; ``centroid (3,)`` of the source, its frame."""
    turn = rotation_angle_deg(found[:3, :3].T @ true[:3, :3])
    shift = (found[:3, :3] - true[:3, :3]) @ centroid + found[:3, 3] - true[:3, 3]
    return PoseError(float(turn), float(np.linalg.norm(shift)))


def maps_onto_itself(solid: ObjectMesh, found: np.ndarray, true: np.ndarray, length: float) -> bool:
    """Whether the found T_target_source is the true one after a symmetry of the object (in the target's frame)."""
    T = found @ inverse(true)
    moved = sample_surface(solid, SAMPLES) @ T[:3, :3].T + T[:3, 3]
    return bool(np.sqrt(np.mean(to_surface(moved, solid) ** 2)) < ALIKE * length)


def area_under_curve(probability: Float[np.ndarray, " n"], right: Bool[np.ndarray, " n"]) -> float:
    """Chance that a right pair has the greater probability of a right and a wrong one; NaN where one kind lacks."""
    positive, count = int(right.sum()), len(right)
    if positive in (0, count):
        return float("nan")
    return float((rankdata(probability)[right].sum() - positive * (positive + 1) / 2) / (positive * (count - positive)))


def operating_curve(
    probability: Float[np.ndarray, " n"], right: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Shares of the wrong and of the right pairs that are accepted, as the least probability falls."""
    order = np.argsort(-probability, kind="stable")
    accepted = np.concatenate([[0], np.cumsum(right[order])]), np.concatenate([[0], np.cumsum(~right[order])])
    return accepted[1] / max(int((~right).sum()), 1), accepted[0] / max(int(right.sum()), 1)
