"""Measures of a mesh: shape of its triangles, smoothness, topology, distance to a reference (thesis §3.5.1)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import (
    Adjacency,
    adjacency,
    border_length,
    boundary_loops,
    face_components,
    face_normals,
    face_vectors,
)
from jaxmodel.scan.triangle_mesh import ObjectMesh

BINS = 20


class Histogram(NamedTuple):
    """``counts`` of triangles between neighbouring ``edges``."""

    edges: Float[np.ndarray, " b1"]
    counts: Int[np.ndarray, " b"]


class Quality(NamedTuple):
    """One mesh in numbers; lengths and areas in its unit.

    ``Q_equ`` (eq. 3.1: 1 for equilateral triangles, 0 for collapsed ones) and ``Q_nor`` (eq. 3.3: 1 if neighbours are
    coplanar) are means over triangles. ``border_edges`` have one triangle, ``crowded_edges`` more than two;
    ``turned_pairs`` are neighbours of opposite orientation. ``largest_share`` is the largest component's share of area.
    ``euler`` counts the vertices that triangles use.
    """

    vertices: int
    triangles: int
    unused_vertices: int
    area: float
    Q_equ: float
    Q_nor: float
    Q_equ_histogram: Histogram
    Q_nor_histogram: Histogram
    components: int
    largest_share: float
    border_edges: int
    border_length: float
    border_loops: int
    crowded_edges: int
    turned_pairs: int
    euler: int

    @property
    def closed(self) -> bool:
        """Whether every edge has exactly two triangles of the same orientation."""
        return self.border_edges == 0 and self.crowded_edges == 0 and self.turned_pairs == 0


def triangle_shape(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """``Q_equ`` of each triangle: ``6 / sqrt 3`` times inscribed radius over longest side (eqs 3.1, 3.2)."""
    corners = vertices[faces]
    sides = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    area = np.linalg.norm(face_vectors(vertices, faces), axis=1) / 2
    product = sides.sum(axis=1) / 2 * sides.max(axis=1)
    return 6 / np.sqrt(3) * area / np.where(product > 0, product, 1.0)


def smoothness(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], shared: Adjacency | None = None
) -> Float[np.ndarray, " m"]:
    """``Q_nor`` of each triangle: the mean cosine between its normal and its neighbours' (eq. 3.3).

    Border triangles have fewer than three neighbours: the mean is over those that exist; NaN without any.
    """
    shared = adjacency(faces) if shared is None else shared
    normals = face_normals(vertices, faces)
    first, second = shared.pairs.T
    cosine = np.einsum("ij,ij->i", normals[first], normals[second])
    total = np.bincount(first, cosine, len(faces)) + np.bincount(second, cosine, len(faces))
    neighbours = np.bincount(shared.pairs.reshape(-1), minlength=len(faces))
    return np.where(neighbours > 0, total / np.maximum(neighbours, 1), np.nan)


def quality(mesh: ObjectMesh) -> Quality:
    """All measures that need no reference. Raises ``InputError`` for a mesh without triangles."""
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    if len(faces) == 0:
        raise InputError("The mesh has no triangles: there is nothing to measure.")
    shared = adjacency(faces)
    shape, smooth = triangle_shape(vertices, faces), smoothness(vertices, faces, shared)
    area = np.linalg.norm(face_vectors(vertices, faces), axis=1) / 2
    components, part = face_components(len(faces), shared.pairs)
    border, _, loops = boundary_loops(shared)
    used = len(np.unique(faces))
    return Quality(
        vertices=len(vertices),
        triangles=len(faces),
        unused_vertices=len(vertices) - used,
        area=float(area.sum()),
        Q_equ=float(shape.mean()),
        Q_nor=float(np.nanmean(smooth)) if np.isfinite(smooth).any() else float("nan"),
        Q_equ_histogram=_histogram(shape, 0.0),
        Q_nor_histogram=_histogram(smooth[np.isfinite(smooth)], -1.0),
        components=components,
        largest_share=float(np.bincount(part, area).max() / area.sum()) if area.sum() > 0 else 1.0,
        border_edges=len(border),
        border_length=border_length(vertices, shared),
        border_loops=loops,
        crowded_edges=int((shared.faces > 2).sum()),
        turned_pairs=int(shared.turned.sum()),
        euler=used - len(shared.edges) + len(faces),
    )


def _histogram(values: Float[np.ndarray, " m"], low: float) -> Histogram:
    counts, edges = np.histogram(np.clip(values, low, 1.0), BINS, (low, 1.0))
    return Histogram(edges, counts)
