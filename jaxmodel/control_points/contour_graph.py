"""The graph of edge pixels that contours are taken from: Delaunay links without the long ones (thesis §2.4.1).

Two sides of a depth jump never share a link, whatever their distance in the image.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import Delaunay

from jaxmodel.control_points.edges import EdgeKind, EdgeMap
from jaxmodel.scan.range_image import RangeImage, pixel_spacings


class Links(NamedTuple):
    """Links between edge pixels: their two ends (rows of the list of pixels), their lengths in space and in pixels."""

    ends: Int[np.ndarray, "e 2"]
    length: Float[np.ndarray, " e"]
    length_px: Float[np.ndarray, " e"]

    def take(self, kept: np.ndarray) -> "Links":
        return Links(self.ends[kept], self.length[kept], self.length_px[kept])


def edge_pixels(edges: EdgeMap, kinds: tuple[EdgeKind, ...]) -> Int[np.ndarray, "n 2"]:
    """Row and column of the map's pixels of these kinds, row-major, each line of them thinned to one pixel's width.

    The minimum spanning tree of a line two pixels wide can be two lines with one rung, so the width is taken off
    first (Zhang and Suen 1984), for each kind and each side of the depth jumps apart: a thinned line never changes
    the side.
    """
    from skimage.morphology import skeletonize

    thin = np.zeros(edges.kind.shape, dtype=bool)
    for kind in kinds:
        for far in (False, True) if kind == EdgeKind.DEPTH else (False,):
            layer = (edges.kind == kind) & edges.valid & (edges.far == far)
            if layer.any():
                thin |= skeletonize(layer)
    return np.argwhere(thin)


def surface_links(
    image: RangeImage, edges: EdgeMap, pixels: Int[np.ndarray, "n 2"], gap_px: float, jump: float
) -> Links:
    """Delaunay links between ``pixels`` that stay on one surface.

    Args:
        image: the range image, sensor frame.
        edges: its edge map.
        pixels: row and column of the pixels to link.
        gap_px: longest link, in pixels.
        jump: longest step from a pixel to the next along a link, in spacings of the pixels at that range. A link
            over missing readings counts as one step, and no link joins the near and the far side of a jump.
    """
    ends = _delaunay(pixels)
    length_px = np.linalg.norm(pixels[ends[:, 1]] - pixels[ends[:, 0]], axis=1)
    ends, length_px = ends[length_px <= gap_px], length_px[length_px <= gap_px]
    points = np.where(edges.valid[..., None], image.points, np.nan).astype(np.float64)
    at_pixels = points[pixels[:, 0], pixels[:, 1]]
    length = np.linalg.norm(at_pixels[ends[:, 1]] - at_pixels[ends[:, 0]], axis=1)
    kind, far = edges.kind[pixels[:, 0], pixels[:, 1]], edges.far[pixels[:, 0], pixels[:, 1]]
    depth = kind == EdgeKind.DEPTH
    sides = depth[ends].all(axis=1) & (far[ends[:, 0]] != far[ends[:, 1]])
    limit = (jump * pixel_spacings(image)[pixels[:, 0], pixels[:, 1]])[ends].min(axis=1)
    kept = ~sides & _without_jump(points, pixels[ends], length, limit)
    return Links(ends[kept], length[kept], length_px[kept])


def _delaunay(pixels: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "e 2"]:
    """Each edge of the pixels' Delaunay triangulation once, the lower row first.

    Four points around the image make a triangulation exist for one pixel and for pixels in one line too. They are
    farther away than any link that is kept, so they hide none of the shortest ones.
    """
    n = len(pixels)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    margin = int((high - low).max()) + 100
    low, high = low - margin, high + margin
    frame = np.array([low, [low[0], high[1]], high, [high[0], low[1]]])
    triangulation = Delaunay(np.concatenate([pixels, frame]))
    sides = triangulation.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    left_out = triangulation.coplanar[:, [0, 2]]  # a point lost to rounding is linked to its nearest
    ends = np.concatenate([sides, left_out]).astype(np.int64)
    ends = np.sort(ends[(ends < n).all(axis=1)], axis=1)
    return np.stack(np.divmod(np.unique(ends[:, 0] * n + ends[:, 1]), n), axis=1)


def _without_jump(
    points: Float[np.ndarray, "h w 3"],
    ends: Int[np.ndarray, "e 2 2"],
    length: Float[np.ndarray, " e"],
    limit: Float[np.ndarray, " e"],
) -> Bool[np.ndarray, " e"]:
    """Whether no step along the straight line of pixels between two ends is longer than ``limit``."""
    first, offset = ends[:, 0], ends[:, 1] - ends[:, 0]
    steps = np.abs(offset).max(axis=1)
    kept = length <= limit * np.maximum(steps, 1)
    missing = np.zeros(len(ends), dtype=bool)
    here = points[first[:, 0], first[:, 1]]
    for step in range(1, int(steps.max(initial=0)) + 1):
        share = np.minimum(step / np.maximum(steps, 1), 1.0)[:, None]
        row, column = np.rint(first + share * offset).astype(np.int64).T
        there = points[row, column]
        distance = np.linalg.norm(there - here, axis=1)
        missing |= np.isnan(distance)
        kept &= ~(distance > limit)
        here = there
    return kept & (~missing | (length <= limit))
