"""Cylinders and spheres among smooth triangles: fitted to neighbourhoods, grown to all that agrees, fitted again.

The search is that of Schnabel et al. (Efficient RANSAC for point-cloud shape detection, 2007) without chance: every
neighbourhood of an even sample proposes a sphere and a cylinder at several scales.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import face_components
from jaxmodel.mesh.creases import links_within
from jaxmodel.mesh.primitives import Surface, fit_plane, offset, refine, round_guesses

SAMPLES, SEEDS, TRIED = 600, 30, 12
STEPS = 2
"""Gauss-Newton steps of a guess each time its region narrows."""
MOST_TRIANGLES = 4000
"""Triangles a grown region is fitted to, evenly taken."""
SCALES = (9, 25, 70, 200)
"""Triangles of a neighbourhood, out of the sample."""
WITHIN = 3.0
"""Root mean square distance of a triangle's corners from its surface, at most, in standard deviations."""
NARROWING = ((3.0, 0.1), (2.0, 0.05), (1.5, 0.02), (1.0, 0.0))
"""How much farther triangles may lie at first: in the noise, and in shortest sides, as chords cut corners off."""
TURN_DEG, TURN_BY_NOISE_DEG, MOST_TURN_DEG = 20.0, 90.0, 60.0
"""Largest angle between a triangle's normal and its surface's: without noise, more for each edge length of it, at most.
"""
SCATTER = 1.25
"""Largest rms distance of a whole region in standard deviations: a surface that only touches has more."""
LIKELY = 1.2
"""How much more a sample may scatter than a whole region."""
FEWEST, STRIPS = 24, 4
"""Triangles and flat strips of the smallest round region."""
LARGEST_STRIP = 0.45
OPEN = 0.4
"""Sides towards smooth neighbours for each triangle, at most: any two circles of a torus lie on one sphere."""
FLATTER = 3.0
"""How much worse a plane must fit than the round surface."""


class Sheet(NamedTuple):
    """One smooth part: its triangles, their smoothed normals, areas, flat region, and which are neighbours.

    ``beyond`` counts the sides of each that lead out of the part without a crease of the object, ``turn`` is the least
    cosine between such a normal and that of the surface the triangle lies on.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]
    areas: Float[np.ndarray, " m"]
    flat: Int[np.ndarray, " m"]
    pairs: Int[np.ndarray, "p 2"]
    beyond: Int[np.ndarray, " m"]
    turn: float


def least_cosine(scatter: float) -> float:
    """``Sheet.turn`` for a noise of so many edge lengths."""
    return float(np.cos(np.deg2rad(min(TURN_DEG + TURN_BY_NOISE_DEG * scatter, MOST_TURN_DEG))))


def round_regions(sheet: Sheet, noise: float, smallest: float) -> list[tuple[Surface, Int[np.ndarray, " k"]]]:
    """Cylinders and spheres in one smooth part, the largest first, each with its triangles (rows of the sheet).

    ``smallest`` is the least area of a region. A region hangs together, does not look flat, consists of several flat
    strips of which none is nearly all, and scatters about its surface by no more than the noise.
    """
    found = []
    part = np.arange(len(sheet.faces))
    while len(part) >= FEWEST and sheet.areas[part].sum() >= smallest:
        best = _largest(sheet, part, noise, smallest)
        if best is None:
            break
        found.append(best)
        part = np.setdiff1d(part, best[1], assume_unique=True)
    return found


def _largest(sheet: Sheet, part, noise, smallest):
    running = np.cumsum(sheet.areas[part])
    count = min(SAMPLES, len(part))
    place = (np.arange(count) + 0.5) * (running[-1] / count)
    sample = part[np.unique(np.searchsorted(running, place))]
    corners = sheet.vertices[sheet.faces[sample]]
    middle, normals, areas = corners.mean(axis=1), sheet.normals[sample], sheet.areas[sample]
    least = smallest * areas.sum() / running[-1]
    seeds = np.arange(0, len(sample), max(1, len(sample) // SEEDS))
    near = np.asarray(KDTree(middle).query(middle[seeds], k=min(SCALES[-1], len(sample)))[1])
    near = near.reshape(len(seeds), -1)
    guesses: list[Surface] = []
    for scale in SCALES:
        if scale <= near.shape[1]:
            spheres, cylinders = round_guesses(middle[near[:, :scale]], normals[near[:, :scale]])
            guesses += spheres + cylinders
    chord = float(np.median(np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).min(axis=1)))
    widths = [times * noise + part_of_chord * chord for times, part_of_chord in NARROWING]
    size = float(np.ptp(middle, axis=0).max())
    guesses = [guess for guess in guesses if np.isfinite(guess.radius) and guess.radius < 20 * size]
    share = _shares(guesses, corners[:, 0], normals, areas, widths[0], sheet.turn)
    tried = [guesses[k] for k in np.argsort(share, kind="stable")[::-1][:TRIED]]
    for width, following in zip(widths, [*widths[1:], noise], strict=True):
        steps = STEPS if width > noise else 3 * STEPS
        fitted = []
        for guess in tried:
            inside = _agree(guess, corners, normals, width, sheet.turn)
            if inside.sum() < 6:
                continue
            guess = refine(guess, corners[inside].reshape(-1, 3), np.repeat(areas[inside], 3), steps)
            inside = _agree(guess, corners, normals, following, sheet.turn)
            if areas[inside].sum() >= least:
                fitted.append((float(areas[inside].sum()), _rms(guess, corners[inside].reshape(-1, 3)), guess))
        # the worse half is not worth another fit
        fitted.sort(key=lambda entry: -entry[0])
        tried = [guess for _, _, guess in fitted[: max(2, (len(tried) + 1) // 2)]]
    likely = [guess for _, rms, guess in fitted if rms <= LIKELY * SCATTER * noise]
    for guess in likely[:2]:
        region = _grown(sheet, part, guess, noise, smallest)
        if region is not None:
            return region
    return None


def _shares(guesses: list[Surface], points, normals, areas, noise, turn):
    """The area that agrees with each guess, judged by one corner of each triangle."""
    if not guesses:
        return np.zeros(0)
    direction = np.nan_to_num(np.array([guess.direction for guess in guesses]))
    centre = np.array([guess.point for guess in guesses])
    along = direction @ points.T - np.einsum("gi,gi->g", direction, centre)[:, None]
    square = np.einsum("gi,gi->g", centre, centre)[:, None] - 2 * centre @ points.T
    reach = np.sqrt(np.maximum(square + np.einsum("ni,ni->n", points, points) - along**2, 1e-300))
    outward = np.einsum("ni,ni->n", points, normals) - centre @ normals.T
    facing = np.abs(outward - along * (direction @ normals.T)) >= turn * reach
    close = np.abs(reach - np.array([guess.radius for guess in guesses])[:, None]) <= WITHIN * noise
    return (facing & close) @ areas


def _agree(surface: Surface, corners, normals, noise, turn):
    """Which triangles lie on a surface and face as it does."""
    if not np.isfinite(surface.radius):
        return np.zeros(len(corners), bool)
    distance, _ = offset(surface, corners.reshape(-1, 3))
    close = (distance.reshape(len(corners), -1) ** 2).mean(axis=1) <= (WITHIN * noise) ** 2
    _, facing = offset(surface, corners.mean(axis=1))
    return close & (np.abs(np.einsum("ij,ij->i", facing, normals)) >= turn)


def _grown(sheet: Sheet, part, surface, noise, smallest):
    """The surface fitted to its largest connected region of the whole part, or None where that is no region of it."""
    for _ in range(2):
        inside = part[_agree(surface, sheet.vertices[sheet.faces[part]], sheet.normals[part], noise, sheet.turn)]
        region = _largest_connected(sheet, inside)
        area = sheet.areas[region]
        if len(region) < FEWEST or area.sum() < smallest:
            return None
        taken = region[:: max(1, len(region) // MOST_TRIANGLES)]
        points = sheet.vertices[sheet.faces[taken]].reshape(-1, 3)
        weights = np.repeat(sheet.areas[taken], 3)
        surface = refine(surface, points, weights)
    mine = np.zeros(len(sheet.faces), bool)
    mine[region] = True
    open_sides = (mine[sheet.pairs[:, 0]] != mine[sheet.pairs[:, 1]]).sum() + sheet.beyond[region].sum()
    strips = np.bincount(sheet.flat[region], area)
    strips = strips[strips > 0]
    rms, flat_rms = _rms(surface, points), _rms(fit_plane(points, weights), points)
    few = len(strips) < STRIPS or strips.max() > LARGEST_STRIP * area.sum() or open_sides > OPEN * len(region)
    if few or rms > SCATTER * noise or flat_rms < FLATTER * max(rms, noise):
        return None
    return surface, region


def _rms(surface: Surface, points):
    return float(np.sqrt(np.mean(offset(surface, points)[0] ** 2)))


def _largest_connected(sheet: Sheet, inside):
    if len(inside) == 0:
        return inside
    within = np.zeros(len(sheet.faces), bool)
    within[inside] = True
    _, label = face_components(len(inside), links_within(within, sheet.pairs))
    return inside[label == np.argmax(np.bincount(label, sheet.areas[inside]))]
