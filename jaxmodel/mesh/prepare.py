"""A cloud made fit for pivoting: checked points, oriented normals, directions to the sensor, and a search tree."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.mesh.orientation import Oriented, orient
from jaxmodel.scan.cloud import check_points

Eyes = Float[np.ndarray, "n 4"] | Float[np.ndarray, "4"]


class Prepared(NamedTuple):
    """The ``g`` points with good normals: ``rows`` of the input they were; ``toward`` unit, to the sensor if known."""

    points: Float[np.ndarray, "g 3"]
    normals: Float[np.ndarray, "g 3"]
    toward: Float[np.ndarray, "g 3"] | None
    rows: Int[np.ndarray, " g"]
    tree: KDTree
    oriented: Oriented


def prepare(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "m 3"] | None = None, eyes: Eyes | None = None
) -> Prepared:
    """The points of a cloud that can be pivoted (see :func:`jaxmodel.mesh.orientation.orient`).

    Raises ``InputError`` for bad points (see :func:`check_points`), points on one line, or normals beyond repair.
    """
    points = check_points(points).astype(np.float64)
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False, full_matrices=False)
    if spread[1] < 1e-6 * spread[0]:
        raise InputError(f"All {len(points)} points lie on one line: there is no surface through them.")
    toward = None if eyes is None else _toward(points, eyes)
    tree = KDTree(points)
    oriented = orient(points, normals, toward, tree)
    good = np.ones(len(points), bool)
    good[oriented.bad] = False
    if len(oriented.bad):
        tree = KDTree(points[good])
    return Prepared(
        points[good],
        oriented.normals[good],
        None if toward is None else toward[good],
        np.flatnonzero(good),
        tree,
        oriented,
    )


def _toward(points: Float[np.ndarray, "n 3"], eyes: Eyes) -> Float[np.ndarray, "n 3"]:
    direction = eyes[..., :3] - eyes[..., 3:] * points
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return direction / np.where(length > 0, length, 1.0)
