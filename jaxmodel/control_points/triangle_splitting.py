"""Splitting the triangles of a range image in rounds until they meet a bound, or are as many as wanted (thesis §2.4.2).

Each round splits many triangles at once, then restores the Delaunay triangulation; readings are handed out anew.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.control_points.conforming_delaunay import Conforming, Pieces, conform
from jaxmodel.control_points.image_surfaces import Surfaces
from jaxmodel.control_points.mesh_filters import Filtered, filter_triangles
from jaxmodel.control_points.pixel_triangulation import HORIZON, Pixels, doubled_areas, doubled_places, pixels_of
from jaxmodel.control_points.triangle_fit import TriangleFit, fit_triangles
from jaxmodel.errors import InputError

_TOLERANCE = 0.01  # share of the count within which splitting stops
_SHARE = 0.5  # of the points still wanted one round may add, until few are left
_FEW = 0.05  # share of the count
_WAIT = 0.25  # triangles with less than this share of a round's high scores wait for the next round


@dataclass(frozen=True)
class SplitOptions:
    """Thresholds, none of them a length.

    ``bound``: the largest plane-fit error, in pixel spacings, of a triangle one square pixel large; one ``s`` pixels
    large (root of its area in the image) may reach ``bound · s^size_exponent`` spacings, and the noise of the image
    on top. A negative exponent holds large triangles, which stand for more of the surface, to a smaller error.
    ``outline``: pixels by which an outline may be off. ``outline_weight``: how many pixel spacings of plane-fit error
    a pixel beyond that counts for. ``density`` and ``shape``: least share of the readings expected on a triangle, and
    least area / perimeter², see ``mesh_filters.py``.
    """

    bound: float = 1.0
    size_exponent: float = -0.5
    outline: float = 1.0
    outline_weight: float = 0.25
    density: float = 0.5
    shape: float = 0.01

    def __post_init__(self) -> None:
        for name in ("bound", "outline", "outline_weight"):
            if not getattr(self, name) >= 0:
                raise InputError(f"split mesh: {name} is {getattr(self, name)}, expected a number of at least 0")
        if not 0 <= self.density < 1:
            raise InputError(f"split mesh: density is {self.density}, expected a share of at least 0 and below 1")
        if not 0 <= self.shape < 0.048:
            raise InputError(f"split mesh: shape is {self.shape}, expected at least 0 and below an equilateral's 0.048")
        if not -2 <= self.size_exponent <= 2:
            raise InputError(f"split mesh: size_exponent is {self.size_exponent}, expected between -2 and 2")


class Splitting(NamedTuple):
    """One state of the mesh, before its filters.

    ``places (v, 2)`` doubled places of the vertices, those at the horizon first; ``within`` the pixels of each
    triangle; ``filtered`` what the filters keep; ``size (f,)`` root of the area in pixels, at the horizon of the
    number of pixels; ``fit`` and ``score (f,)`` how well the triangles stand for their readings, the score being the
    least bound they meet, 0 where no reading is left to split at; ``free (n,)`` the pixels, in the order of
    ``within``, that a triangle can be split at; ``off_outline (f,)`` where the outline gives the score.
    """

    mesh: Conforming
    places: Int[np.ndarray, "v 2"]
    within: Pixels
    filtered: Filtered
    fit: TriangleFit
    size: Float[np.ndarray, " f"]
    free: Bool[np.ndarray, " n"]
    score: Float[np.ndarray, " f"]
    off_outline: Bool[np.ndarray, " f"]

    def kept_vertices(self) -> Int[np.ndarray, "k 2"]:
        """Pixels of the vertices that the kept triangles use."""
        return self.mesh.pixels[np.unique(self.mesh.triangles[self.filtered.kept]) - HORIZON]


def start(surfaces: Surfaces, pieces: Pieces, options: SplitOptions) -> Splitting:
    """The two triangles at the horizon, with the segments and the reading nearest to each image corner inserted."""
    h, w = surfaces.valid.shape
    readings = np.stack(np.nonzero(surfaces.valid), axis=1)
    corners = [
        np.argmin(np.sum((readings - np.array(corner)) ** 2, axis=1)) for corner in ((0, 0), (0, w), (h, 0), (h, w))
    ]
    pixels = np.unique(np.concatenate([readings[corners], pieces.ends.reshape(-1, 2)]), axis=0)
    return _assessed(surfaces, conform(surfaces, pixels, pieces), options)


def reach_bound(surfaces: Surfaces, state: Splitting, options: SplitOptions) -> Splitting:
    """Split every triangle whose score passes the bound, until none is left."""
    while True:
        chosen = np.flatnonzero(state.score > options.bound)
        if len(chosen) == 0:
            return state
        state = split(surfaces, state, chosen, options)


def reach_count(
    surfaces: Surfaces, state: Splitting, options: SplitOptions, count: int, at: Literal["vertices", "centres"]
) -> Splitting:
    """Split the triangles with the highest scores, of equal ones the largest kept, until ``count`` points are kept."""

    def kept(state: Splitting) -> int:
        return len(state.kept_vertices() if at == "vertices" else centres_of(surfaces, state))

    while True:
        lack = count - kept(state)
        can = np.unique(state.within.triangle[state.free])
        if lack <= _TOLERANCE * count or len(can) == 0:
            return state
        order = can[np.lexsort((-state.size[can], ~state.filtered.kept[can], -state.score[can]))]
        wanted = lack if at == "vertices" else lack / 2  # a triangulation has about two triangles a vertex
        step = int(np.ceil(wanted if lack <= _FEW * count else _SHARE * wanted))
        chosen = order[:step]
        high = state.score[chosen[len(chosen) // 10]]
        chosen = chosen[state.score[chosen] >= _WAIT * high]
        after = split(surfaces, state, chosen, options)
        while kept(after) > (1 + _TOLERANCE) * count and len(chosen) > 1:  # segments were cut along with it
            chosen = chosen[: len(chosen) // 2]
            after = split(surfaces, state, chosen, options)
        state = after


def split(surfaces: Surfaces, state: Splitting, chosen: Int[np.ndarray, " c"], options: SplitOptions) -> Splitting:
    """One round: a new vertex in each chosen triangle, which must have a free reading."""
    new = split_points(surfaces, state, chosen)
    mesh = conform(surfaces, np.concatenate([state.mesh.pixels, new]), state.mesh.pieces)
    return _assessed(surfaces, mesh._replace(lost=mesh.lost + state.mesh.lost), options)


def split_points(surfaces: Surfaces, state: Splitting, chosen: Int[np.ndarray, " c"]) -> Int[np.ndarray, "c 2"]:
    """Where to split: the free reading nearest to the triangle's centre of gravity.

    Where the outline is off, the nearest one on an outline, if any. A triangle with corners at the horizon takes the
    one nearest to them, measured from its other corners: outlines are approached as a polygon is by its corners.
    """
    w = surfaces.valid.shape[1]
    wanted = np.zeros(len(state.score), dtype=bool)
    wanted[chosen] = True
    here = np.flatnonzero(state.free & wanted[state.within.triangle])
    pixel, triangle = state.within.pixel[here], state.within.triangle[here]
    place = 2 * np.stack(np.divmod(pixel, w), axis=1)
    corner = state.places[state.mesh.triangles]
    cost = np.sum((3 * place - corner.sum(axis=1)[triangle]) ** 2, axis=1)
    at_horizon = state.mesh.triangles < HORIZON
    outer = np.flatnonzero(at_horizon[triangle].any(axis=1))
    cost[outer] = 0
    for k in range(3):  # areas opposite the measured corners: their barycentric weights
        a, b = corner[triangle[outer], k - 1], corner[triangle[outer], k - 2]
        area = np.abs(_cross(b - a, place[outer] - a))
        cost[outer] += np.where(at_horizon[triangle[outer], k], 0, area)
    aside = state.off_outline[triangle] & ~surfaces.outline.ravel()[pixel]
    order = np.lexsort((pixel, cost, aside, triangle))
    first = order[np.append(True, np.diff(triangle[order]) != 0)]
    return np.stack(np.divmod(pixel[first], w), axis=1)


def centres_of(surfaces: Surfaces, state: Splitting) -> Int[np.ndarray, "k 2"]:
    """For each kept triangle the pixel of the reading nearest, in the image, to its centre; each pixel once."""
    h, w = surfaces.valid.shape
    sixfold = state.places[state.mesh.triangles[state.filtered.kept]].sum(axis=1)
    row, column = np.clip((sixfold + 3) // 6, 0, [h - 1, w - 1]).T
    return np.stack(np.divmod(np.unique(surfaces.nearest[row, column]), w), axis=1)


def _assessed(surfaces: Surfaces, mesh: Conforming, options: SplitOptions) -> Splitting:
    h, w = surfaces.valid.shape
    places = doubled_places((h, w), mesh.pixels)
    within = pixels_of((h, w), places, mesh.triangles)
    filtered = filter_triangles(surfaces, places, mesh.triangles, within, options.density, options.shape)
    fit = fit_triangles(surfaces, places, mesh.triangles, within, filtered.kept)
    at_horizon = mesh.triangles.min(axis=1) < HORIZON
    size = np.sqrt(np.where(at_horizon, np.diff(within.start), doubled_areas(places, mesh.triangles) / 8))
    # the mean of n squared errors strays by sqrt(2 / n) of itself: three times that is no sign of a bend
    noise = surfaces.noise**2 * (1 + 3 * np.sqrt(2 / np.maximum(fit.readings, 1)))
    plane = np.sqrt(np.maximum(fit.error**2 - noise, 0.0)) / fit.spacing
    outline = options.outline_weight * np.maximum(fit.misplaced - options.outline, 0.0)
    score = np.maximum(plane, outline) / np.maximum(size, 1.0) ** options.size_exponent
    free = surfaces.valid.ravel()[within.pixel]
    is_vertex = np.zeros(h * w, dtype=bool)
    is_vertex[mesh.pixels @ [w, 1]] = True
    free &= ~is_vertex[within.pixel]
    score[np.bincount(within.triangle[free], minlength=len(score)) == 0] = 0.0
    return Splitting(mesh, places, within, filtered, fit, size, free, score, outline > plane)


def _cross(a: Int[np.ndarray, "n 2"], b: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
