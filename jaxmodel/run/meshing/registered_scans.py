"""Scans brought into one frame by this project's own registration, with its errors against the true poses."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.control_points import Subsample, select
from jaxmodel.register import register
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.range_image import RangeImage

METHOD = "thesis_2005"
CONTROL_POINTS = 2000


class Placed(NamedTuple):
    """``T_world_scan`` as registered; errors of the start and of the result: degrees, and the scan's centroid's way."""

    T_world_scan: Float[np.ndarray, "4 4"]
    start_deg: float
    start_shift: float
    error_deg: float
    error_shift: float


def register_in_turn(
    scans: Sequence[RangeImage],
    T_world_scan: Sequence[Float[np.ndarray, "4 4"]],
    rotation_deg: float,
    translation: float,
    rng: np.random.Generator,
) -> list[Placed]:
    """Each scan registered onto all before it, as placed, from its true pose turned and shifted; the first stays.

    ``rotation_deg`` and ``translation``: standard deviations about and along each axis, about the scan's centroid.
    """
    placed = [Placed(np.asarray(T_world_scan[0], np.float64), 0.0, 0.0, 0.0, 0.0)]
    fused = [as_cloud(scans[0]).moved(placed[0].T_world_scan).points]
    for scan, truth in zip(scans[1:], T_world_scan[1:], strict=True):
        cloud = as_cloud(scan)
        centre = np.asarray(cloud.points, np.float64).mean(axis=0)
        start = pose_error(truth[:3, :3] @ centre + truth[:3, 3], rotation_deg, translation, rng) @ truth
        target = select(np.concatenate(fused), Subsample(count=CONTROL_POINTS))
        found = register(target, select(scan, Subsample(count=CONTROL_POINTS)), start, METHOD)
        T = np.asarray(found.T_target_source, np.float64)
        placed.append(Placed(T, *_apart(start, truth, centre), *_apart(T, truth, centre)))
        fused.append(cloud.moved(T).points)
    return placed


def pose_error(
    centre: Float[np.ndarray, "3"], rotation_deg: float, translation: float, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """A small motion about ``centre``, normal in each axis."""
    R = Rotation.from_rotvec(np.deg2rad(rotation_deg) * rng.normal(size=3)).as_matrix()
    error = np.eye(4)
    error[:3, :3], error[:3, 3] = R, centre - R @ centre + translation * rng.normal(size=3)
    return error


def _apart(T: np.ndarray, truth: np.ndarray, centre: np.ndarray) -> tuple[float, float]:
    turn = Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).magnitude()
    shift = np.linalg.norm((T - truth)[:3, :3] @ centre + (T - truth)[:3, 3])
    return float(np.rad2deg(turn)), float(shift)
