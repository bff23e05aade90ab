"""The last step of a registration of two scans: all that each knows of the other, both ways, by exact neighbours.

Distances to tangent planes (Chen and Medioni 1992) of the source's points to the target and of the target's to the
source, weighed down where they do not fit (Geman and McClure), partners found again in every step within a reach that
shrinks to a few scatters. In float64, a 6 x 6 system a step.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxmodel.control_points.subsample import voxel_subsample
from jaxmodel.scan.cloud import Cloud

FIRST_REACH, LAST_REACH, SHRINK = 0.04, 0.006, 0.75
"""How far partners may be, in the length of the search: at first, at last, and from step to step."""
STEPS = 30
ASKED = 3000
"""Points of each scan that look for partners."""
ALIKE = 0.7
"""Least cosine between the normals of partners."""
SOFT = 2.0
"""Scatters at which a pair's weight has fallen to a quarter."""
FEWEST = 12
STILL = 1e-6
"""A step that moves no point by more than this, in the length of the search, ends the fit."""
LEAST_SCATTER = 1e-5


class Surface(NamedTuple):
    """Points with normals, the tree to find them in, and which of them are held against another surface."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    tree: KDTree
    asked: Int[np.ndarray, " k"]


class Refined(NamedTuple):
    """``T_target_source``; ``information (6, 6)`` of a turn (radians) about the source's centre and a shift of it, in
    the target's frame, every pair counted by its weight over the square of the ``scatter``, the standard deviation of
    the distances to tangent planes; ``pairs`` used; ``settled`` whether the last step stood still.
    """

    T_target_source: Float[np.ndarray, "4 4"]
    information: Float[np.ndarray, "6 6"]
    scatter: float
    pairs: int
    settled: bool


def surface_of(cloud: Cloud) -> Surface:
    """A cloud with normals as a surface to fit to."""
    assert cloud.normals is not None
    points = np.asarray(cloud.points, np.float64)
    return Surface(points, np.asarray(cloud.normals, np.float64), KDTree(points), voxel_subsample(points, ASKED))


def refine(
    target: Surface,
    source: Surface,
    T_target_source: Float[np.ndarray, "4 4"],
    length: float,
) -> Refined:
    """The pose that fits best near a rough one; ``length``: what reaches are measured in, unit of the data."""
    T = np.asarray(T_target_source, np.float64).copy()
    centre = source.points.mean(axis=0)
    reach, settled, scatter, count = FIRST_REACH * length, False, np.inf, 0
    information = np.zeros((6, 6))
    for _ in range(STEPS):
        about = T[:3, :3] @ centre + T[:3, 3]
        found = _pairs(target, source, T, reach)
        count = len(found)
        if count < FEWEST:
            break
        point, normal, distance = found[:, :3] - about, found[:, 3:6], found[:, 6]
        scatter = max(1.4826 * float(np.median(np.abs(distance))), LEAST_SCATTER * length)
        weight = 1 / (1 + (distance / (SOFT * scatter)) ** 2) ** 2
        rows = np.concatenate([np.cross(point, normal), normal], axis=1)
        information = (rows * weight[:, None]).T @ rows / scatter**2
        right = (rows * weight[:, None]).T @ distance / scatter**2
        # what nothing speaks of stays: known as well as the reach
        prior = np.diag(reach**-2.0 * np.repeat([length**2 / 4, 1.0], 3))
        step = np.linalg.solve(information + prior, right)
        T = _moved(step, about) @ T
        last = reach <= LAST_REACH * length
        reach = max(SHRINK * reach, LAST_REACH * length)
        if last and np.linalg.norm(step[3:]) + np.linalg.norm(step[:3]) * length < STILL * length:
            settled = True
            break
    return Refined(T, information, scatter, count, settled)


def _pairs(target: Surface, source: Surface, T: Float[np.ndarray, "4 4"], reach: float) -> Float[np.ndarray, "k 7"]:
    """Where the two meet, in the target's frame: the source's point, the unit normal, and the way to go along it."""
    R, t = T[:3, :3], T[:3, 3]
    moved, turned = source.points[source.asked] @ R.T + t, source.normals[source.asked] @ R.T
    away, near = target.tree.query(moved, distance_upper_bound=reach)
    held = np.flatnonzero(np.isfinite(away))
    held = held[np.einsum("na,na->n", turned[held], target.normals[near[held]]) > ALIKE]
    normal = target.normals[near[held]]
    ahead = np.einsum("na,na->n", normal, target.points[near[held]] - moved[held])
    theirs = (target.points[target.asked] - t) @ R, target.normals[target.asked] @ R
    away, near_source = source.tree.query(theirs[0], distance_upper_bound=reach)
    kept = np.flatnonzero(np.isfinite(away))
    kept = kept[np.einsum("na,na->n", theirs[1][kept], source.normals[near_source[kept]]) > ALIKE]
    along = source.normals[near_source[kept]] @ R.T
    place = source.points[near_source[kept]] @ R.T + t
    back = np.einsum("na,na->n", along, target.points[target.asked][kept] - place)
    return np.concatenate([np.column_stack([moved[held], normal, ahead]), np.column_stack([place, along, back])])


def _moved(step: Float[np.ndarray, "6"], about: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix()
    T[:3, 3] = about - T[:3, :3] @ about + step[3:]
    return T
