"""How right a map of edges is, against edges that are known: precision, recall and labels."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import minimum_filter
from scipy.spatial import KDTree

from jaxmodel.control_points.edge_map import EdgeKind, EdgeMap
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.visible_edges import VisibleEdges, jump_pixels

NEAR_PX = 2.0  # how far a pixel may lie from a true edge
_READ_PX = 1.0  # an edge counts where the sensor has a reading so near


class EdgeTruth(NamedTuple):
    """The true edges of one view, pixels as (column, row).

    ``sharp (s, 2)`` samples of the visible edges of the mesh; ``crease (s,)`` those whose two faces both are turned to
    the sensor; ``inner (s,)`` those of them with readings all around; ``jumps (j, 2)`` pixels on both sides of jumps.
    """

    sharp: Float[np.ndarray, "s 2"]
    crease: Bool[np.ndarray, " s"]
    inner: Bool[np.ndarray, " s"]
    jumps: Float[np.ndarray, "j 2"]


class EdgeScore(NamedTuple):
    """Shares from 0 to 1, NaN where there is nothing to count.

    ``precision``: pixels marked CREASE or DEPTH within two pixels of a true edge; borders are right by their making
    and not counted. ``recall``: true edges within two pixels of a mark of any label. ``crease_recall``: the same of
    creases inside the surface, borders not counted. ``labels``: among marks near a true edge, those near one of their
    own sort, CREASE near an edge whose faces are both seen, DEPTH near an outline or a jump. ``creases``: how many
    pixels are marked so.
    """

    precision: float
    recall: float
    crease_recall: float
    labels: float
    creases: int


def edge_truth(clean: RangeImage, edges: VisibleEdges, pitch: float) -> EdgeTruth:
    """The true edges of a view: those of the mesh where the sensor reads, and the jumps of the image without noise.

    ``clean`` has the readings the sensor gives, without their noise; ``pitch`` the step between its rays (radian, or
    the unit of the data for parallel rays).
    """
    read = clean.valid
    seen = _near(edges.pixels, np.argwhere(read)[:, ::-1], _READ_PX)
    pixels, crease = edges.pixels[seen], edges.crease[seen]
    around = minimum_filter(read, 5, mode="constant", cval=False)
    at = np.round(pixels).astype(np.int64)
    at = np.clip(at, 0, np.array(read.shape[::-1]) - 1)
    inner = crease & around[at[:, 1], at[:, 0]]
    return EdgeTruth(pixels, crease, inner, np.argwhere(jump_pixels(clean, pitch))[:, ::-1].astype(np.float64))


def edge_score(found: EdgeMap, truth: EdgeTruth) -> EdgeScore:
    """``found`` against the truth of the same view."""
    creases, depth, marks = (
        np.argwhere(mask)[:, ::-1]
        for mask in (found.kind == EdgeKind.CREASE, found.kind == EdgeKind.DEPTH, found.kind != EdgeKind.NONE)
    )
    true = np.concatenate([truth.sharp, truth.jumps])
    counted = np.concatenate([creases, depth])
    near = _near(counted, true)
    sorts = truth.sharp[truth.crease], np.concatenate([truth.sharp[~truth.crease], truth.jumps])
    own = np.concatenate([_near(creases, sorts[0]), _near(depth, sorts[1])])
    return EdgeScore(
        precision=_share(near),
        recall=_share(_near(truth.sharp, marks)),
        crease_recall=_share(_near(truth.sharp[truth.inner], counted)),
        labels=_share(own[near]),
        creases=len(creases),
    )


def _near(
    points: Float[np.ndarray, "n 2"] | Int[np.ndarray, "n 2"],
    others: Float[np.ndarray, "m 2"] | Int[np.ndarray, "m 2"],
    reach: float = NEAR_PX,
) -> Bool[np.ndarray, " n"]:
    """Which points have another within reach."""
    if len(points) == 0 or len(others) == 0:
        return np.zeros(len(points), dtype=bool)
    return KDTree(others).query(points)[0] <= reach


def _share(flags: Bool[np.ndarray, " n"]) -> float:
    return float(flags.mean()) if len(flags) else float("nan")
