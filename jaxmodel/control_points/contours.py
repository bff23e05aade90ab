"""3D contours of a range image: chains of its edge pixels (thesis §2.4.1).

Edge pixels are linked by a Delaunay triangulation without its long edges; each component's minimum spanning tree,
freed of barbs, is cut at its junctions into chains. The two sides of a depth edge are two chains.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxmodel.control_points.chains import chains_of, one_sided
from jaxmodel.control_points.contour_graph import edge_pixels, surface_links
from jaxmodel.control_points.contour_set import Contour, ContourOutcome, ContourSet
from jaxmodel.control_points.edges import EdgeKind, EdgeMap
from jaxmodel.control_points.spanning_tree import prune, spanning_forest
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage

ALL_KINDS = (EdgeKind.CREASE, EdgeKind.DEPTH, EdgeKind.BORDER)


@dataclass(frozen=True)
class ContourOptions:
    """Thresholds, none of them a length.

    ``gap_px``: longest link, in pixels: gaps of ``gap_px - 1`` missing pixels are crossed. ``jump``: longest step
    from pixel to pixel along a link, in spacings of the pixels at that range. ``barb``: branches of at most so many
    pixels are taken off. ``least``: a contour's tree has at least so many pixels, a loop at least so many steps.
    """

    gap_px: float = 5.0
    jump: float = 6.0
    barb: int = 4
    least: int = 12

    def __post_init__(self) -> None:
        if not self.gap_px >= 1:
            raise InputError(f"contours: gap_px is {self.gap_px}, expected at least 1 pixel")
        if not self.jump > 0:
            raise InputError(f"contours: jump is {self.jump}, expected a number above 0")
        if self.barb < 0:
            raise InputError(f"contours: barb is {self.barb}, expected 0 or more pixels")
        if self.least < 2:
            raise InputError(f"contours: least is {self.least}, expected at least 2 pixels")


def find_contours(
    image: RangeImage,
    edges: EdgeMap,
    kinds: Sequence[EdgeKind] = ALL_KINDS,
    options: ContourOptions = ContourOptions(),
) -> ContourSet:
    """Chains along the edges of a range image, one for each side of a depth edge.

    Args:
        image: the range image, sensor frame.
        edges: its edge map, of the same size.
        kinds: which edges are followed. A chain may pass from one kind to another.
        options: thresholds.

    Returns:
        The chains, those with most pixels first. Without any, ``outcome`` says why: a smooth surface has none.

    Raises:
        InputError: the map is of another size, or no kind of edge is asked for.
    """
    if edges.kind.shape != image.valid.shape:
        raise InputError(f"the edge map is of shape {edges.kind.shape}, expected the image's {image.valid.shape}")
    wanted = tuple(kind for kind in ALL_KINDS if kind in kinds)
    if not wanted:
        raise InputError("no kind of edge is asked for, expected at least one of crease, depth, border")
    if not edges.valid.any():
        return ContourSet((), ContourOutcome.NO_READING)
    pixels = edge_pixels(edges, wanted)
    if len(pixels) == 0:
        return ContourSet((), ContourOutcome.NO_EDGE)
    links = surface_links(image, edges, pixels, options.gap_px, options.jump)
    forest = spanning_forest(len(pixels), links, options.least)
    forest = prune(len(pixels), forest, options.barb, options.least)
    if len(forest.ends) == 0:
        return ContourSet((), ContourOutcome.TOO_SMALL)
    rows, columns = pixels.T
    kind = edges.kind[rows, columns]
    side = np.where(kind == EdgeKind.DEPTH, np.where(edges.far[rows, columns], 1, -1), 0)
    chains = one_sided(chains_of(len(pixels), forest.ends), side)
    places, kind = pixels[chains.nodes], kind[chains.nodes]
    points = image.points[places[:, 0], places[:, 1]].astype(np.float64)
    contours = [
        Contour(places[i:j], points[i:j], kind[i:j], bool(closed))
        for i, j, closed in zip(chains.starts[:-1], chains.starts[1:], chains.closed, strict=True)
    ]
    return ContourSet(tuple(sorted(contours, key=len, reverse=True)), ContourOutcome.FOUND)
