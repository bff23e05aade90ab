"""The contours of a range image as segments to insert into its split mesh (thesis §2.4.2, after §2.4.1)."""

import numpy as np
from jaxtyping import Int

from jaxmodel.control_points.conforming_delaunay import Pieces, conform
from jaxmodel.control_points.contours import find_contours
from jaxmodel.control_points.edges import find_edges
from jaxmodel.control_points.image_surfaces import Surfaces
from jaxmodel.control_points.polylines import importance
from jaxmodel.scan.range_image import RangeImage

_ATTEMPTS = 12
_COARSER = 0.7  # at most this share of the last attempt's points go into the next one


def contour_segments(image: RangeImage, surfaces: Surfaces, most: int) -> Int[np.ndarray, "s 2 2"]:
    """Segments along the contours, as fine as they can be with about ``most`` vertices, and no more, as mesh edges.

    The points that matter most to the contours' shape are taken, so short contours drop out whole. ``(s, 2, 2)``
    pixels (row, column) of the segments' ends; none where the image has no contour.
    """
    contours = find_contours(image, find_edges(image))
    values = importance(contours)
    ranked = np.sort(np.concatenate([np.zeros(0), *values]))[::-1]
    wanted = min(most, len(ranked))
    for _ in range(_ATTEMPTS):
        if wanted < 2:
            break
        error = ranked[wanted] if wanted < len(ranked) else -1.0
        segments = [np.zeros((0, 2, 2), dtype=np.int64)]
        for chain, value in zip(contours.chains, values, strict=True):
            pixels = chain.pixels[value > error]
            ends = np.stack([pixels, np.roll(pixels, -1, axis=0)], axis=1)
            segments.append(ends if chain.closed and len(pixels) > 2 else ends[:-1])
        found = np.concatenate(segments)
        taken = len(conform(surfaces, np.unique(found.reshape(-1, 2), axis=0), Pieces.of(found)).pixels)
        if taken <= most:
            return found
        wanted = int(wanted * min(most / taken, _COARSER))
    return np.zeros((0, 2, 2), dtype=np.int64)
