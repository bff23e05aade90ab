"""Sheets of points that pass through one another: no ball can roll from one to the other and leave a surface."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import face_components

NEIGHBOURS = 24
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
    gap, index = KDTree(points).query(
        points, k=min(NEIGHBOURS, len(points)), distance_upper_bound=REACH * spacing, workers=-1
    )
    first, place = np.nonzero(np.isfinite(gap.reshape(len(points), -1)))
    second = np.asarray(index).reshape(len(points), -1)[first, place]
    alike = np.einsum("pa,pa->p", normals[first], normals[second]) > ALIKE
    count, sheet = face_components(len(points), np.stack([first[alike], second[alike]], axis=1))
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
