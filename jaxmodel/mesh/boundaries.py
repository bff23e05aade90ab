"""Where one primitive ends and the next begins: scraps taken in, triangles on a border given to the better side."""

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.mesh.adjacency import Adjacency, face_components
from jaxmodel.mesh.creases import links_within
from jaxmodel.mesh.primitives import Surface, offset

REACH = 4.0
"""How far a scrap may lie from the surface that takes it in, in standard deviations."""
ROUNDS = 6
STRAIGHTEN = 1.0
"""What each neighbour of another label counts against a label, beside squared distances over twice the variance."""
ISLAND = 0.25
"""Part of a primitive's area from which a piece cut off from it is a primitive of its own."""


def misfit(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    surfaces: list[Surface],
    label: Int[np.ndarray, " f"],
) -> Float[np.ndarray, " f"]:
    """Summed squared distances of each triangle's corners from the surface named for it; infinite where none is."""
    result = np.full(len(faces), np.inf)
    order = np.argsort(label, kind="stable")
    ends = np.searchsorted(label[order], np.arange(len(surfaces) + 1))
    for k, surface in enumerate(surfaces):
        some = order[ends[k] : ends[k + 1]]
        if len(some) and surface.kind != "free-form":
            distance, _ = offset(surface, vertices[faces[some]].reshape(-1, 3))
            result[some] = (distance.reshape(-1, 3) ** 2).sum(axis=1)
    return result


def take_in_scraps(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    pairs: Int[np.ndarray, "p 2"],
    surfaces: list[Surface],
    label: Int[np.ndarray, " m"],
    reach: float,
    rings: int,
    most: int | None = None,
) -> Int[np.ndarray, " m"]:
    """``label`` with whole groups of unnamed triangles (-1) given to neighbouring surfaces within ``reach``.

    A group is taken in only if all of it is, within so many ``rings`` of triangles and, where given, if it has no more
    triangles than ``most``.
    """
    grown = label.copy()
    scraps = np.flatnonzero(label < 0)
    count, group = face_components(len(scraps), links_within(label < 0, pairs))
    open_group = np.zeros(count, bool) if most is None else np.bincount(group, minlength=count) > most
    tried = label < 0
    tried[scraps[open_group[group]]] = False
    pairs = pairs[tried[pairs[:, 0]] | tried[pairs[:, 1]]]
    for _ in range(rings):
        face, name, cost = offers(vertices, faces, pairs, surfaces, grown, tried & (grown < 0))
        cost = np.where(cost <= 3 * reach * reach, cost, np.inf)
        order = np.lexsort((cost, face))
        first = order[np.flatnonzero(np.diff(face[order], prepend=-1))]
        first = first[np.isfinite(cost[first])]
        if len(first) == 0:
            break
        grown[face[first]] = name[first]
    open_group[group[grown[scraps] < 0]] = True
    grown[scraps[open_group[group]]] = -1
    return grown


def settle(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    pairs: Int[np.ndarray, "p 2"],
    surfaces: list[Surface],
    label: Int[np.ndarray, " m"],
    noise: float,
) -> Int[np.ndarray, " m"]:
    """``label`` after triangles on borders between primitives went to the likelier side, a few rounds.

    The likelier side is nearer in standard deviations and has more of the triangle's neighbours.
    """
    label = label.copy()
    named = np.array([surface.kind != "free-form" for surface in surfaces] + [False])
    before = label
    for _ in range(ROUNDS):
        i, j = pairs.T
        on_border = (label[i] != label[j]) & named[label[i]] & named[label[j]]
        active = np.zeros(len(faces), bool)
        active[i[on_border]] = active[j[on_border]] = True
        beside = pairs[active[i] | active[j]]
        face, name, cost = offers(vertices, faces, beside, surfaces, label, active)
        if len(face) == 0:
            break
        cost = cost / (2 * noise * noise) - STRAIGHTEN * _sides(beside, label, face, name, active)
        order = np.lexsort((name != label[face], cost, face))
        first = order[np.flatnonzero(np.diff(face[order], prepend=-1))]
        first = first[np.isfinite(cost[first])]
        changed = label.copy()
        changed[face[first]] = name[first]
        if (changed == label).all() or (changed == before).all():
            break
        before, label = label, changed
    return label


def offers(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    pairs: Int[np.ndarray, "p 2"],
    surfaces: list[Surface],
    label: Int[np.ndarray, " m"],
    active: Bool[np.ndarray, " m"],
) -> tuple[Int[np.ndarray, " o"], Int[np.ndarray, " o"], Float[np.ndarray, " o"]]:
    """Of every active triangle each label among its neighbours and its own, once, and its misfit to that surface."""
    i, j = pairs.T
    forth, back = active[i] & (label[j] >= 0), active[j] & (label[i] >= 0)
    own = np.flatnonzero(active & (label >= 0))
    face = np.concatenate([i[forth], j[back], own])
    name = np.concatenate([label[j[forth]], label[i[back]], label[own]])
    if len(face) == 0:
        return face, name, np.zeros(0)
    count = np.int64(len(surfaces))
    keys = np.unique(face * count + name)
    face, name = keys // count, keys % count
    return face, name, misfit(vertices, faces[face], surfaces, name)


def _sides(pairs, label, face, name, active):
    """How many neighbours of each ``face`` have the label ``name``."""
    i, j = pairs.T
    forth, back = active[i], active[j]
    count = np.int64(label.max() + 2)
    seen = np.concatenate([i[forth] * count + label[j[forth]], j[back] * count + label[i[back]]])
    keys, number = np.unique(seen, return_counts=True)
    wanted = face * count + name
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[place] == wanted, number[place], 0)


def split_islands(
    pairs: Int[np.ndarray, "p 2"], areas: Float[np.ndarray, " m"], label: Int[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " s"]]:
    """Labels that each hang together, and the old label of each: small pieces cut off lose their name (-1)."""
    same = pairs[label[pairs[:, 0]] == label[pairs[:, 1]]]
    count, piece = face_components(len(label), same)
    area = np.bincount(piece, areas, count)
    of_piece = np.full(count, -1)
    of_piece[piece] = label
    largest = np.zeros(of_piece.max() + 2)
    np.maximum.at(largest, of_piece, area)
    kept = np.flatnonzero((of_piece >= 0) & (area >= ISLAND * largest[of_piece]))
    number = np.full(count, -1)
    number[kept] = np.arange(len(kept))
    return number[piece], of_piece[kept]


def widths(
    vertices: Float[np.ndarray, "n 3"],
    shared: Adjacency,
    areas: Float[np.ndarray, " m"],
    label: Int[np.ndarray, " m"],
    count: int,
) -> Float[np.ndarray, " s"]:
    """Twice the area of each of ``count`` labels over the length of its border: of a long strip, how wide it is."""
    ends = vertices[shared.edges]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    inner = shared.pair_edge[label[shared.pairs[:, 0]] == label[shared.pairs[:, 1]]]
    length[inner] = 0
    named = label >= 0
    border = np.bincount(label[named], length[shared.edge_of[named]].sum(axis=1), count)
    return 2 * np.bincount(label[named], areas[named], count) / np.maximum(border, 1e-300)
