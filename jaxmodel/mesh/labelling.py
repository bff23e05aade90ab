"""From triangles to primitives, stage by stage: sure planes, round regions, small planes, borders, free-form rest."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.mesh.adjacency import Adjacency
from jaxmodel.mesh.boundaries import REACH, settle, split_islands, take_in_scraps, widths
from jaxmodel.mesh.bridges import bridging, take_in_bridges
from jaxmodel.mesh.creases import CREASE_DEG, angles_deg, links_within, smooth_normals, smooth_parts
from jaxmodel.mesh.flatness import LARGE, TRIANGLES, flatness
from jaxmodel.mesh.primitives import FREE_FORM, Surface, fit_plane, refine
from jaxmodel.mesh.region_growing import Moments, face_moments, grow_flat, plane_of
from jaxmodel.mesh.round_regions import Sheet, least_cosine, round_regions
from jaxmodel.mesh.smooth_joins import smooth_joins
from jaxmodel.mesh.surface_noise import quadric_noise
from jaxmodel.mesh.wavy_planes import WAVE, wavy_planes

SMALLEST = 2e-3
"""Area of the smallest round primitive, and of the smallest plane that is not sure, in the mesh's area."""
BOUNDED = 0.6
"""Part of a small flat region's border that must be creases, borders or other primitives for it to be a plane."""
RINGS = 12
FEW = 24
"""Triangles of a scrap that may lie farther from the surface that takes it in than bridges over a crease do."""
ALONE = 0.9
"""Part of a smooth part that is one flat region from which no round surface is looked for."""
FREE_CREASE_DEG = 10.0
SHARPER = 4.0
"""A crease within free-form parts: at least ``FREE_CREASE_DEG`` and so many times the usual angle there."""
BEVEL = 0.8
"""Mean side of a bevel's triangles, at least, in its width; a round end cut into a fan has 0.7."""
SHEET_SAMPLES = 400
"""Places at which the scatter of a smooth part is looked at."""
MOST_TRIANGLES = 10_000
"""Triangles a fit is made from, evenly taken."""


class Labelled(NamedTuple):
    """The segment of each triangle, the surface and the smooth face of each segment, and which triangles only bridge a
    crease between two segments: they belong to one of them, but do not lie on it.
    """

    label: Int[np.ndarray, " m"]
    surfaces: list[Surface]
    part: Int[np.ndarray, " s"]
    bridge: Bool[np.ndarray, " m"]


def label_faces(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    shared: Adjacency,
    vectors: Float[np.ndarray, "m 3"],
    noise: float,
    edge: float,
    exact: bool,
) -> Labelled:
    """The segment of each triangle, and the surface and the smooth face of each segment.

    ``vectors`` are normals times 2 area, alike on both sides of an edge; ``noise`` the scatter that counts as flat,
    ``edge`` the usual length of a side, ``exact`` whether the mesh has no noise.
    """
    areas = np.sqrt(np.einsum("ij,ij->i", vectors, vectors)) / 2
    flat, moments = grow_flat(face_moments(vertices, faces, vectors), shared.pairs, noise)
    straight, sure = flatness(vertices, faces, shared.pairs, flat, moments, noise, exact)
    label, surfaces = _take_planes(np.full(len(faces), -1), [], flat, moments, np.flatnonzero(sure))

    normals = _smoothed(vectors, shared.pairs, label < 0, noise / edge)
    angle = angles_deg(normals, shared.pairs)
    turn, searched = least_cosine(noise / edge), set()
    smooth = angle < CREASE_DEG
    for crease in (lambda _: ~smooth, lambda rest: _fine_creases(angle, shared.pairs, rest)):
        rest = label < 0
        sheets = _sheets(vertices, faces, shared.pairs, normals, areas, flat, rest, crease(rest), smooth, turn)
        for sheet, part in sheets:
            if (part[0], len(part)) in searched:
                continue
            # flat parts may be exact where the vertices of round ones lie on chords
            chords = min(quadric_noise(vertices[np.unique(sheet.faces)], SHEET_SAMPLES), WAVE * edge)
            found = round_regions(sheet, max(noise, chords), SMALLEST * areas.sum())
            for surface, region in found:
                label[part[region]] = len(surfaces)
                surfaces.append(surface)
            left = part[label[part] < 0]
            searched.add((left[0], len(left)) if len(left) else None)
    small = straight & _closed_in(shared, vertices, flat, moments, label) & ~sure
    small &= moments.table[0] >= SMALLEST * areas.sum()
    label, surfaces = _take_planes(label, surfaces, flat, moments, np.flatnonzero(small))

    crease = _fine_creases(angle, shared.pairs, label < 0)
    smallest = LARGE * areas.sum()
    for surface, part in wavy_planes(vertices, faces, areas, shared.pairs, crease, label < 0, edge, smallest):
        label[part] = len(surfaces)
        surfaces.append(surface)

    near = REACH * noise
    label = take_in_scraps(vertices, faces, shared.pairs, surfaces, label, near, RINGS)
    label = take_in_scraps(vertices, faces, shared.pairs, surfaces, label, near + edge / 2, 1)
    for _ in range(2):
        surfaces = _fitted(vertices, faces, areas, label, surfaces)
        label = settle(vertices, faces, shared.pairs, surfaces, label, noise)
    label, origin = split_islands(shared.pairs, areas, label)
    surfaces = [surfaces[k] for k in origin]
    wide = widths(vertices, shared, areas, label, len(surfaces))
    narrow = wide < edge
    if exact:
        # a long bevel of triangles as small as it is wide bridges a crease; a few large ones are a chamfer
        narrow &= _bevels(vertices, faces, label, wide)
    label = np.where(np.append(narrow, True)[label], -1, label)
    label = take_in_scraps(vertices, faces, shared.pairs, surfaces, label, 1.5 * near + edge, RINGS, FEW)
    surfaces = _fitted(vertices, faces, areas, label, surfaces)
    bridge = np.zeros(len(faces), bool)
    while True:
        more = bridging(vertices, faces, shared.pairs, surfaces, label, areas, near if exact else near + edge / 2)
        taken = take_in_bridges(vertices, faces, shared.pairs, surfaces, label, more, 1.5 * near + edge)
        if (taken == label).all():
            break
        label, bridge = taken, bridge | (taken != label)
    label = take_in_scraps(vertices, faces, shared.pairs, surfaces, label, 1.5 * near + edge, RINGS, FEW)
    label, surfaces = _with_free_form(label, surfaces, shared.pairs, angle, areas)
    part = smooth_joins(vertices, faces, shared, vectors, label, surfaces, noise / edge)
    return Labelled(label, surfaces, part, bridge)


def _take_planes(label, surfaces, flat, moments: Moments, regions):
    """The flat ``regions`` as planes, as far as their triangles have no name yet."""
    centre, normal = plane_of(moments.table[:, regions])
    number = np.full(moments.table.shape[1], -1)
    number[regions] = len(surfaces) + np.arange(len(regions))
    label = np.where(label < 0, number[flat], label)
    return label, surfaces + [Surface("plane", c, n, float("nan")) for c, n in zip(centre.T, normal.T, strict=True)]


def _smoothed(vectors, pairs, rest: Bool[np.ndarray, " m"], scatter):
    """Unit normals, smoothed among the triangles that have no name yet."""
    normals = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    normals[rest] = smooth_normals(vectors[rest], links_within(rest, pairs), scatter)
    return normals


def _sheets(vertices, faces, pairs, normals, areas, flat, rest, crease, smooth, turn):
    """The smooth parts of ``rest`` to look for round surfaces in, and their triangles."""
    parts = smooth_parts(rest, pairs, crease, areas, SMALLEST * areas.sum())
    parts = [part for part in parts if np.bincount(flat[part], areas[part]).max() <= ALONE * areas[part].sum()]
    part_of, number = np.full(len(faces), -1), np.zeros(len(faces), np.int64)
    for k, part in enumerate(parts):
        part_of[part] = k
        number[part] = np.arange(len(part))
    first, second = part_of[pairs[:, 0]], part_of[pairs[:, 1]]
    inside, out = (first == second) & (first >= 0) & ~crease, (first != second) & smooth
    out &= rest[pairs[:, 0]] & rest[pairs[:, 1]]
    links, of_link = number[pairs[inside]], first[inside]
    ends = np.concatenate([pairs[out, 0], pairs[out, 1]])
    for k, part in enumerate(parts):
        beyond = np.bincount(number[ends[part_of[ends] == k]], minlength=len(part))
        yield (
            Sheet(vertices, faces[part], normals[part], areas[part], flat[part], links[of_link == k], beyond, turn),
            part,
        )


def _fine_creases(angle, pairs, free):
    """Creases among the triangles of ``free``: many times sharper than the usual edge there."""
    inside = free[pairs[:, 0]] & free[pairs[:, 1]]
    usual = float(np.median(angle[inside])) if inside.any() else 0.0
    return angle >= np.clip(SHARPER * usual, FREE_CREASE_DEG, CREASE_DEG)


def _closed_in(shared: Adjacency, vertices, flat, moments: Moments, label):
    """Which flat regions end, for most of their border, at a crease, at another primitive or at the mesh's border."""
    count = moments.table.shape[1]
    ends = vertices[shared.edges]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    normal = moments.table[12:].T
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    i, j = flat[shared.pairs].T
    named = label[shared.pairs] >= 0
    between = i != j
    i, j, named, along = i[between], j[between], named[between], length[shared.pair_edge][between]
    crease = np.einsum("ij,ij->i", normal[i], normal[j]) < np.cos(np.deg2rad(CREASE_DEG))
    open_side = shared.faces[shared.edge_of] != 2
    bare = np.bincount(np.repeat(flat, 3), (length[shared.edge_of] * open_side).reshape(-1), count)
    whole = bare + np.bincount(i, along, count) + np.bincount(j, along, count)
    shut = bare + np.bincount(i, along * (crease | named[:, 1]), count)
    shut = shut + np.bincount(j, along * (crease | named[:, 0]), count)
    return shut >= BOUNDED * whole


def _fitted(vertices, faces, areas, label, surfaces):
    """Each surface fitted to the corners of its triangles by least squares."""
    order = np.argsort(label, kind="stable")
    ends = np.searchsorted(label[order], np.arange(len(surfaces) + 1))
    result = []
    for k, surface in enumerate(surfaces):
        some = order[ends[k] : ends[k + 1]]
        some = some[:: max(1, len(some) // MOST_TRIANGLES)]
        if len(some) == 0 or areas[some].sum() == 0:
            result.append(surface)
            continue
        points, weights = vertices[faces[some]].reshape(-1, 3), np.repeat(areas[some], 3)
        result.append(fit_plane(points, weights) if surface.kind == "plane" else refine(surface, points, weights))
    return result


def _bevels(vertices, faces, label, wide):
    """Which labels have many triangles, with sides about as long in the mean as the label is ``wide``."""
    named = label >= 0
    corners = vertices[faces[named]]
    side = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean(axis=1)
    count = np.bincount(label[named], minlength=len(wide))
    return (count >= TRIANGLES) & (np.bincount(label[named], side, len(wide)) > BEVEL * wide * count)


def _with_free_form(label, surfaces, pairs, angle, areas):
    """What has no name yet as smooth parts between creases; surfaces that lost all their triangles go.

    Parts too small to be named join the part beside them, whatever the crease.
    """
    free = label < 0
    crease = _fine_creases(angle, pairs, free)
    label, surfaces = label.copy(), list(surfaces)
    for part in smooth_parts(free, pairs, crease, areas, SMALLEST * areas.sum()):
        label[part] = len(surfaces)
        surfaces.append(FREE_FORM)
    links = pairs[free[pairs[:, 0]] & free[pairs[:, 1]]]
    while True:
        first, second = label[links].T
        forth, back = (first >= 0) & (second < 0), (second >= 0) & (first < 0)
        if not (forth | back).any():
            break
        label[links[forth, 1]] = first[forth]
        label[links[back, 0]] = second[back]
        links = links[(label[links[:, 0]] < 0) | (label[links[:, 1]] < 0)]
    for part in smooth_parts(label < 0, pairs, np.zeros(len(pairs), bool), areas):
        label[part] = len(surfaces)
        surfaces.append(FREE_FORM)
    used = np.flatnonzero(np.bincount(label, minlength=len(surfaces)))
    number = np.zeros(len(surfaces), np.int64)
    number[used] = np.arange(len(used))
    return number[label], [surfaces[k] for k in used]
