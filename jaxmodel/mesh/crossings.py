"""Sheets of points that pass through one another: no ball can roll from one to the other and leave a surface."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import face_components

NEIGHBOURS = 24
CLOSEST = 8
REACH = 3.0
"""How far a point looks for others, in spacings."""
ALIKE = 0.7
"""Cosine of normals above which neighbours are of one sheet."""
FEWEST = 12
"""Points of the smallest sheet."""
BESIDE = 0.7
"""Height over a point's plane, in spacings, from which another counts as being on that side."""
SHARE = 0.5
"""Part of the points along a contact that must see the other sheet on both of their sides."""


def crossing_sheets(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], spacing: float
) -> Int[np.ndarray, " n"]:
    """A number for each point, different for points of two sheets that cross; all 0 where nothing does.

    Sheets are joined by neighbours of like normals. Two cross when each, along their contact, is on both sides of the
    other: sides that meet in an edge, and a wall that ends on a floor, do not.
    """
    whole = np.zeros(len(points), np.int64)
    tree, reach = KDTree(points), REACH * spacing
    first, second = _neighbours(tree, points, np.arange(len(points)), CLOSEST, reach)
    alike = np.einsum("pa,pa->p", normals[first], normals[second]) > ALIKE
    count, sheet = face_components(len(points), np.stack([first[alike], second[alike]], axis=1))
    minor = sheet != np.argmax(np.bincount(sheet))
    if not minor.any():
        return whole
    # the rest of the neighbours can only matter where a point outside the largest sheet is among them
    gap, _ = KDTree(points[minor]).query(points, distance_upper_bound=reach, workers=-1)
    first, second = _neighbours(tree, points, np.flatnonzero(np.isfinite(gap)), NEIGHBOURS, reach)
    between = sheet[first] != sheet[second]
    first, second = first[between], second[between]
    alike = np.einsum("pa,pa->p", normals[first], normals[second]) > ALIKE
    count, joined = face_components(count, np.stack([sheet[first[alike]], sheet[second[alike]]], axis=1))
    sheet = joined[sheet]
    size = np.bincount(sheet, minlength=count)
    apart = (sheet[first] != sheet[second]) & (size[sheet[first]] >= FEWEST) & (size[sheet[second]] >= FEWEST)
    if not apart.any():
        return whole
    first, second = first[apart], second[apart]
    height = np.einsum("pa,pa->p", points[second] - points[first], normals[first]) / spacing
    key, contact = np.unique(first * np.int64(count) + sheet[second], return_inverse=True)
    contact = contact.reshape(-1)
    through = np.bincount(contact, height > BESIDE, len(key)) > 0
    through &= np.bincount(contact, height < -BESIDE, len(key)) > 0
    pair, at = np.unique(sheet[key // count] * np.int64(count) + key % count, return_inverse=True)
    share = np.bincount(at.reshape(-1), through, len(pair)) / np.bincount(at.reshape(-1), minlength=len(pair))
    one, other = pair // count, pair % count
    mirrored = share[np.searchsorted(pair, other * count + one)]
    cross = np.minimum(share, mirrored) >= SHARE
    if not cross.any():
        return whole
    _, group = face_components(count, np.stack([one[~cross], other[~cross]], axis=1))
    crossing = np.unique(group[one[cross]])
    return np.searchsorted(crossing, group[sheet]) * np.isin(group[sheet], crossing)


def _neighbours(
    tree: KDTree, points: Float[np.ndarray, "n 3"], rows: Int[np.ndarray, " r"], most: int, reach: float
) -> tuple[Int[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Pairs of each of ``rows`` with its nearest points, itself among them."""
    gap, index = tree.query(points[rows], k=min(most, len(points)), distance_upper_bound=reach, workers=-1)
    row, place = np.nonzero(np.isfinite(gap.reshape(len(rows), -1)))
    return rows[row], np.asarray(index).reshape(len(rows), -1)[row, place]
