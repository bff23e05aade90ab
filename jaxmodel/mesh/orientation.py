"""Normals fit for pivoting: finite, unit, on one side of the surface; and which of those given were not."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.mesh.blocks import in_blocks
from jaxmodel.scan.estimate import estimate_normals

NEIGHBOURS = 12
STRAY = 0.7  # cosine below which two normals disagree about the surface's direction
COMMON = 0.4  # least share of closest neighbours whose normals agree so far; 0.3 for random directions
CLOSEST = 4
BLOCK = 1 << 12  # points compared at once: few enough that their neighbours stay in the processor's cache
ENOUGH = 50  # points from which such shares mean something
HAIR = 1e-6  # of the cloud's size: what points are moved by before they are propagated along, see _propagated
TURNED_SHARE = 0.02  # of neighbouring pairs: above it the signs as a whole are not to be trusted


class Oriented(NamedTuple):
    """Checked normals of ``n`` points.

    ``normals`` unit, zero where bad; ``bad`` rows that were zero, not finite, or unlike all their neighbours;
    ``turned`` rows whose sign was changed; ``estimated`` whether there were none and all were made here.
    """

    normals: Float[np.ndarray, "n 3"]
    bad: Int[np.ndarray, " b"]
    turned: Int[np.ndarray, " t"]
    estimated: bool


def orient(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "m 3"] | None = None,
    toward: Float[np.ndarray, "n 3"] | None = None,
    tree: KDTree | None = None,
) -> Oriented:
    """``normals`` checked against their neighbours and turned to one side; estimated when there are none.

    The side is that of the sensor where its directions ``toward`` are known; else the given signs where they agree
    among neighbours, single points turned to the majority; else, and where normals are estimated, one propagated
    through the cloud (Open3D, tangent planes; Hoppe et al., 1992), the sign that turns fewest. Raises ``InputError``
    when most normals are zero or not finite, or when they have no direction in common with their neighbours'.
    """
    estimated = normals is None
    given = estimate_normals(points, NEIGHBOURS) if normals is None else np.asarray(normals, np.float64)
    if given.shape != points.shape:
        raise InputError(f"Expected normals of shape {points.shape} like the points, found {given.shape}.")
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(given, axis=1)
    good = np.isfinite(length) & (length > 0)
    if 2 * good.sum() < len(points):
        raise InputError(
            f"{int((~good).sum())} of {len(points)} normals are zero or not finite: expected a unit normal a point, or "
            "none at all, and they are estimated."
        )
    unit = np.where(good[:, None], given, 0.0) / np.where(good, length, 1.0)[:, None]
    before = unit.copy()
    tree = tree or KDTree(points)
    if toward is None:
        near, cosine = _agreement(points, unit, tree, NEIGHBOURS)
    else:  # the signs are known: more neighbours matter only to points that disagree with the closest
        near, cosine = _agreement(points, unit, tree, CLOSEST)
    good &= ~_stray(points, unit, tree, near, cosine)
    unit[~good] = 0.0
    if toward is not None:
        away = np.einsum("na,na->n", unit, toward) < 0
        unit[away] *= -1
    else:
        unit = _propagated(points, unit, good) if estimated else _one_side(points, unit, good, near, cosine)
    return Oriented(
        normals=unit,
        bad=np.flatnonzero(~good),
        turned=np.zeros(0, np.int64) if estimated else np.flatnonzero(np.einsum("na,na->n", unit, before) < 0),
        estimated=estimated,
    )


def _agreement(
    points: np.ndarray, unit: np.ndarray, tree: KDTree, neighbours: int, rows: np.ndarray | None = None
) -> tuple[Bool[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
    """Which of the nearest others of each point (of ``rows`` alone, if given) have a normal, and the cosine with it."""
    own, normal = (points, unit) if rows is None else (points[rows], unit[rows])
    _, index = tree.query(own, k=min(neighbours + 1, len(points)), workers=-1)
    index = np.asarray(index)[:, 1:]
    there = np.any(unit != 0, axis=1)
    cosine = np.empty(index.shape)

    def compare(some: slice) -> None:
        cosine[some] = np.einsum("nka,na->nk", unit[index[some]], normal[some])

    in_blocks(len(index), BLOCK, compare)
    return there[index] & np.any(normal != 0, axis=1)[:, None], cosine


def _stray(
    points: np.ndarray, unit: np.ndarray, tree: KDTree, near: np.ndarray, cosine: np.ndarray
) -> Bool[np.ndarray, " n"]:
    """Points none of whose neighbours has a normal along theirs; refuses a cloud of random directions."""
    stray = np.zeros(len(near), bool)
    along = near & (np.abs(cosine) > STRAY)
    if len(near) < ENOUGH:
        return stray
    share = along[:, :CLOSEST].sum() / max(near[:, :CLOSEST].sum(), 1)
    if share < COMMON:
        raise InputError(
            f"Only {share:.0%} of neighbouring normals are within 45° of each other, {1 - STRAY:.0%} for random "
            "directions. Expected normals of one surface, or none at all, and they are estimated."
        )
    lonely = np.flatnonzero(~along.any(axis=1))
    near, cosine = _agreement(points, unit, tree, NEIGHBOURS, lonely)
    stray[lonely] = near.any(axis=1) & ~(near & (np.abs(cosine) > STRAY)).any(axis=1)
    return stray


def _one_side(
    points: np.ndarray, unit: np.ndarray, good: np.ndarray, near: np.ndarray, cosine: np.ndarray
) -> Float[np.ndarray, "n 3"]:
    """The normals with consistent signs: the majority's, or propagated where there is none."""
    against = near & (cosine < -STRAY)
    along = near & (cosine > STRAY)
    pairs = along.sum() + against.sum()
    if pairs and against.sum() > TURNED_SHARE * pairs:
        return _propagated(points, unit, good)
    odd = good & (against.sum(axis=1) > along.sum(axis=1)) & (against.sum(axis=1) >= near.sum(axis=1) // 2)
    unit = unit.copy()
    unit[odd] *= -1
    return unit


def _propagated(points: np.ndarray, unit: np.ndarray, good: np.ndarray) -> Float[np.ndarray, "n 3"]:
    """The way goes along a Delaunay triangulation, which points all on one sphere or one plane do not have: each is
    taken a hair beside its place.
    """
    import open3d as o3d

    centred = points[good] - points[good].mean(axis=0)
    centred = centred / np.ptp(centred, axis=0).max()
    centred += HAIR * np.random.default_rng(0).uniform(-1.0, 1.0, centred.shape)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(centred))
    cloud.normals = o3d.utility.Vector3dVector(unit[good])
    cloud.orient_normals_consistent_tangent_plane(min(NEIGHBOURS, int(good.sum()) - 1))
    signed = np.asarray(cloud.normals).copy()
    out = np.zeros_like(unit)
    same = np.sign(np.einsum("na,na->n", signed, unit[good])).sum() >= 0
    out[good] = signed if same else -signed
    return out
