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
CHANCE = 0.05
STEPS = 20  # x converges by a factor of ten each
PASSES = 4
STEEP = 0.4
SCATTERED = 0.65  # 0.47 for points scattered by chance, 0.78 after thinning, 1 for a square grid
STACKED_SHARE = 0.1
LARGEST = 10.0  # in spacings: such a ball has about 300 points under it, and pivoting it costs their square
PER_SPACING = 2.0
PER_VIEW = 1.1
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
    tree = tree or KDTree(points)
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


def thinning_distance(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    tree: KDTree | None = None,
    view_spacing: float | None = None,
) -> float:
    """The distance to leave between points where layers overlap, 0 where the cloud is one sheet already.

    Layers overlap when a tenth of the points have their nearest neighbour above or below rather than beside: at a
    slope over 0.4 against the mean of both normals. Noise of a single scan, and curvature, stay well under that.
    ``view_spacing`` that of a single view's points, where it is known; else there are taken to be about four layers.
    """
    tree = tree or KDTree(points)
    probes = np.arange(0, len(points), max(1, len(points) // PROBES))
    _, index = tree.query(points[probes], k=2, workers=-1)
    index = np.asarray(index)
    other = np.where(index[:, 1] == probes, index[:, 0], index[:, 1])
    chord, both = points[other] - points[probes], normals[other] + normals[probes]
    size = np.linalg.norm(chord, axis=1) * np.linalg.norm(both, axis=1)
    slope = np.abs(np.einsum("na,na->n", chord, both)) / np.where(size > 0, size, 1.0)
    if np.quantile(slope, 1 - STACKED_SHARE) <= STEEP:
        return 0.0
    spacing, _, thickness = cloud_scale(points, tree)
    along = PER_SPACING * spacing if view_spacing is None else PER_VIEW * view_spacing
    return max(along, PER_THICKNESS * thickness)


def widest_gap(spacing: float, count: int) -> float:
    """The radius that none of the empty circles between ``count`` scattered points exceeds, with odds of 19 to 1.

    Of the ``2 count`` circles through three neighbours, with ``x = pi radius² / spacing²``, a share of
    ``(1 + x) exp(-x)`` is larger (Poisson points; Miles, 1970). A wider gap in a cloud is not one of chance.
    """
    x = 1.0
    for _ in range(STEPS):
        x = float(np.log(2 * max(count, 3) * (1 + x) / CHANCE))
    return spacing * float(np.sqrt(x / np.pi))


def first_radius(scale: CloudScale) -> float:
    """The smallest ball worth rolling: the spacing, or the next one up where points are scattered by chance.

    The circles through three neighbours of scattered points (``nearest`` is half the spacing) are as large as the
    spacing or larger for a fifth of the triangles: a first pass would leave its border everywhere.
    """
    return scale.spacing if scale.nearest > SCATTERED * scale.spacing else GROWTH * scale.spacing


def ball_radii(spacing: float) -> tuple[float, ...]:
    """Growing radii for points ``spacing`` apart: the smallest ball just cannot fall between evenly spread points."""
    return tuple(spacing * GROWTH**k for k in range(PASSES))


def check_radii(radii: Sequence[float], spacing: float) -> tuple[float, ...]:
    """``radii`` ascending, or ``InputError``: none, not positive, or far larger than the spacing."""
    given = np.sort(np.asarray(radii, np.float64).reshape(-1))
    if len(given) == 0 or not (np.isfinite(given) & (given > 0)).all():
        raise InputError(f"Expected positive radii, found {list(radii)}.")
    if given[-1] > LARGEST * spacing:
        raise InputError(
            f"A ball of radius {given[-1]:.4g} is too large: points are about {spacing:.4g} apart, so it would touch "
            f"hundreds at once and roll over their shape; a radius of {ball_radii(spacing)[1]:.4g} would do."
        )
    return tuple(given.tolist())
