"""Lengths a cloud gives by itself: how far apart its points lie, how thick its sheet is, and the balls that fit it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jaxmodel.errors import InputError

PROBES = 4096
NEIGHBOURS = 16
GROWTH = 1.5
PASSES = 4
THICK = 0.25  # thickness over nearest-neighbour distance above which layers overlap
PER_SPACING = 2.0
PER_THICKNESS = 6.0


class CloudScale(NamedTuple):
    """Lengths of a cloud, in its unit.

    ``spacing`` the edge of the square each point has to itself; ``nearest`` the distance to the nearest other point;
    ``thickness`` the standard deviation of the points about their own sheet: noise and the offsets between views.
    """

    spacing: float
    nearest: float
    thickness: float


def cloud_scale(points: Float[np.ndarray, "n 3"], tree: KDTree | None = None) -> CloudScale:
    """Median lengths over up to 4096 points, from planes through their 16 nearest (fewer in a small cloud)."""
    tree = KDTree(points) if tree is None else tree
    probes = points[:: max(1, len(points) // PROBES)]
    count = min(NEIGHBOURS, len(points))
    distance, index = tree.query(probes, k=count, workers=-1)
    near = points[index]
    near = near - near.mean(axis=1, keepdims=True)
    spread = np.linalg.eigvalsh(np.einsum("nka,nkb->nab", near, near) / max(count - 3, 1))
    return CloudScale(
        spacing=float(np.median(distance[:, -1])) * float(np.sqrt(np.pi / count)),
        nearest=float(np.median(distance[:, 1])),
        thickness=float(np.sqrt(max(np.median(spread[:, 0]), 0.0))),
    )


def thinning_distance(points: Float[np.ndarray, "n 3"], tree: KDTree | None = None) -> float:
    """The distance to leave between points where layers overlap, 0 where the cloud is one sheet already.

    Layers overlap when the cloud is thick against the distance between neighbours, which a single scan is not.
    """
    spacing, nearest, thickness = cloud_scale(points, tree)
    if thickness <= THICK * nearest:
        return 0.0
    return max(PER_SPACING * spacing, PER_THICKNESS * thickness)


def ball_radii(spacing: float) -> tuple[float, ...]:
    """Growing radii for points ``spacing`` apart: the smallest ball just cannot fall between evenly spread points."""
    return tuple(spacing * GROWTH**k for k in range(PASSES))


def check_radii(radii: Sequence[float], points: Float[np.ndarray, "n 3"], spacing: float) -> tuple[float, ...]:
    """``radii`` ascending, or ``InputError``: none, not positive, or a ball larger than the whole cloud."""
    given = np.sort(np.asarray(radii, np.float64).reshape(-1))
    if len(given) == 0 or not (np.isfinite(given) & (given > 0)).all():
        raise InputError(f"Expected positive radii, found {list(radii)}.")
    size = float(np.ptp(points, axis=0).max())
    if given[-1] > size:
        raise InputError(
            f"A ball of radius {given[-1]:.4g} is larger than the cloud, whose longest side is {size:.4g}: "
            f"points are about {spacing:.4g} apart, and a radius of {ball_radii(spacing)[1]:.4g} would do."
        )
    return tuple(given.tolist())
