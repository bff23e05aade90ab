"""Which flat regions are planes of the object, and which only strips of something round."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.mesh.creases import CREASE_DEG
from jaxmodel.mesh.primitives import Surface
from jaxmodel.mesh.region_growing import Moments, plane_of

TRIANGLES = 30
OPEN = 0.4
"""Sides of a region towards smooth neighbours, for each of its triangles: a strip has one, three rows a third."""
BEND = 0.4
"""Largest bend of a plane (rms height of the quadratic part), in standard deviations of the noise."""
SCATTER = 1.25
"""Largest rms distance of a sure plane's vertices: a region that grew on a round surface has up to two."""
LARGE = 0.01
"""Least area, in the mesh's area, of a plane that is sure in spite of noise."""
SAMPLES = 300


class Flatness(NamedTuple):
    """Of each flat region: ``straight`` no bend beyond the noise, ``sure`` a plane whatever is around it."""

    straight: Bool[np.ndarray, " r"]
    sure: Bool[np.ndarray, " r"]


def flatness(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    pairs: Int[np.ndarray, "p 2"],
    label: Int[np.ndarray, " m"],
    moments: Moments,
    noise: float,
    exact: bool,
) -> Flatness:
    """Regions of fewer than ``TRIANGLES`` triangles are too small for a bend to show: straight, but never sure.

    ``exact``: the mesh has no noise, so that small planes are as sure as large ones.
    """
    table = moments.table
    straight = np.ones(table.shape[1], bool)
    sure = np.zeros(table.shape[1], bool)
    large = np.flatnonzero(table[1] >= TRIANGLES)
    if len(large) == 0:
        return Flatness(straight, sure)
    number = np.full(table.shape[1], -1)
    number[large] = np.arange(len(large))
    region, corner = _sampled(vertices, faces, number[label], len(large))
    centre, normal = (part.T for part in plane_of(table[:, large]))
    u, v, z = _in_plane(vertices[corner], region, centre, normal)
    straight[large] = _bend(u, v, z, region, len(large)) <= BEND * noise
    close = table[2, large] <= (SCATTER * noise) ** 2 * table[0, large]
    wide = _open_sides(pairs, label, table)[large] <= OPEN * table[1, large]
    sure[large] = straight[large] & close & wide & (exact | (table[0, large] >= LARGE * table[0].sum()))
    return Flatness(straight, sure)


def bend_and_rms(points: Float[np.ndarray, "n 3"], plane: Surface) -> tuple[float, float]:
    """Rms height of the quadratic part of ``points`` over a plane fitted to them, and of all of them."""
    region = np.zeros(len(points), np.int64)
    u, v, z = _in_plane(points, region, plane.point[None], plane.direction[None])
    return float(_bend(u, v, z, region, 1)[0]), float(np.sqrt(np.mean(z * z)))


def _open_sides(pairs, label, table):
    """How many sides of each region's triangles lead to another region without a crease."""
    i, j = label[pairs].T
    i, j = i[i != j], j[i != j]
    normal = table[12:] / np.maximum(np.sqrt((table[12:] ** 2).sum(axis=0)), 1e-300)
    smooth = np.einsum("ir,ir->r", normal[:, i], normal[:, j]) >= np.cos(np.deg2rad(CREASE_DEG))
    return np.bincount(i[smooth], minlength=table.shape[1]) + np.bincount(j[smooth], minlength=table.shape[1])


def _sampled(vertices, faces, region, count):
    """Corners of evenly taken triangles of each region, every vertex once."""
    inside = np.flatnonzero(region >= 0)
    order = inside[np.argsort(region[inside], kind="stable")]
    size = np.bincount(region[order], minlength=count)
    first = np.cumsum(size) - size
    rank = np.arange(len(order)) - first[region[order]]
    taken = order[rank % np.maximum(size // SAMPLES, 1)[region[order]] == 0]
    keys = np.unique(np.repeat(region[taken], 3) * np.int64(len(vertices)) + faces[taken].reshape(-1))
    return keys // len(vertices), keys % len(vertices)


def _in_plane(points, region, centre, normal):
    """Coordinates across the region's plane in units of its spread, and height over it."""
    count = len(centre)
    local = points - centre[region]
    z = np.einsum("ij,ij->i", local, normal[region])
    flat = local - z[:, None] * normal[region]
    number = np.bincount(region, minlength=count)
    spread = np.stack([np.bincount(region, flat[:, a] * flat[:, b], count) for a in range(3) for b in range(3)])
    values, frame = np.linalg.eigh((spread / number).T.reshape(-1, 3, 3))
    scale = np.sqrt(np.maximum(values, 1e-300))
    u, v = (np.einsum("ij,ij->i", flat, frame[region, :, k]) / scale[region, k] for k in (2, 1))
    return u, v, z


def _bend(u, v, z, region, count):
    """Rms height of the quadratic part of each region."""
    number = np.bincount(region, minlength=count)

    def left(*terms):
        inner = [[np.bincount(region, a * b, count) for b in terms] for a in terms]
        matrix = np.moveaxis(np.array(inner), 2, 0) + 1e-9 * number[:, None, None] * np.eye(len(terms))
        side = np.stack([np.bincount(region, a * z, count) for a in terms], axis=1)
        explained = np.einsum("ri,ri->r", side, np.linalg.solve(matrix, side[:, :, None])[:, :, 0])
        return np.bincount(region, z * z, count) - explained

    one = np.ones_like(u)
    return np.sqrt(np.maximum(left(one, u, v) - left(one, u, v, u * u, u * v, v * v), 0) / number)
