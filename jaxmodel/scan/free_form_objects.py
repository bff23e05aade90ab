"""Free-form test objects: smooth, bumpy closed surfaces (thesis §2.9, free-form set).

Each is one closed surface: a sphere whose radius is a smooth function of direction, then stretched or bent by a
smooth one-to-one map. Centred, longest side 1, and without any rotation that maps it to itself. ``subdivisions``
sets the mesh density, ``20 · 4^subdivisions`` triangles.
"""

import numpy as np
from jaxtyping import Float

from jaxmodel.scan.triangle_mesh import ObjectMesh, icosphere, unit_sized


def boulder(subdivisions: int = 5) -> ObjectMesh:
    """A stone: a flattened lump with about twenty shallow bumps and dents of fixed places."""
    sphere = icosphere(subdivisions)
    rng = np.random.default_rng(20050)  # fixed: the object is always the same
    places = rng.normal(size=(22, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    heights = rng.uniform(-0.14, 0.18, size=22)
    sharpness = rng.uniform(6.0, 22.0, size=22)
    radius = np.ones(len(sphere.vertices))
    for place, height, sharp in zip(places, heights, sharpness, strict=True):
        radius += _bump(sphere.vertices, place, height, sharp)
    return unit_sized(ObjectMesh(radius[:, None] * sphere.vertices * np.array([1.0, 0.82, 0.64]), sphere.faces))


def gourd(subdivisions: int = 5) -> ObjectMesh:
    """A gourd: a fat ribbed belly, a thinner head, a bent neck and one wart."""
    sphere = icosphere(subdivisions)
    x, y, z = sphere.vertices.T
    swell = 1.0 - 0.42 * np.exp(-(((z - 0.42) / 0.28) ** 2)) - 0.25 * (z + 1) / 2
    ribs = 1.0 + 0.05 * (1 - z**2) ** 2 * np.cos(5 * np.arctan2(y, x)) * (1 - 0.4 * y)
    wart = 1.0 + _bump(sphere.vertices, np.array([0.75, 0.55, -0.35]), 0.16, 16.0)
    width = swell * ribs * wart
    points = np.stack([x * width, 0.9 * y * width, 1.35 * z], axis=1)
    points[:, 0] += 0.30 * np.maximum(points[:, 2], 0.0) ** 2  # the bend, a shear along x
    points[:, 1] += 0.12 * points[:, 2] ** 2
    return unit_sized(ObjectMesh(points, sphere.faces))


def torso(subdivisions: int = 5) -> ObjectMesh:
    """A trunk with shoulders of unequal height, chest, belly, spine furrow and a turned neck."""
    sphere = icosphere(subdivisions)
    u = sphere.vertices
    bumps = (
        ((0.80, 0.05, 0.60), 0.42, 9.0),  # right shoulder
        ((-0.85, -0.05, 0.50), 0.36, 9.0),  # left shoulder
        ((0.38, 0.85, 0.32), 0.17, 14.0),  # chest
        ((-0.36, 0.86, 0.28), 0.14, 14.0),
        ((0.05, 0.95, -0.45), 0.15, 7.0),  # belly
        ((0.45, -0.60, -0.80), 0.17, 8.0),  # seat
        ((-0.40, -0.65, -0.78), 0.20, 8.0),
        ((0.00, -1.00, 0.15), -0.12, 8.0),  # furrow of the back
        ((0.08, 0.10, 1.00), 0.50, 26.0),  # neck
    )
    radius = np.ones(len(u))
    for place, height, sharpness in bumps:
        radius += _bump(u, np.array(place), height, sharpness)
    points = radius[:, None] * u * np.array([0.72, 0.50, 1.0])
    angle = 0.25 * points[:, 2]  # a slight twist about the long axis
    x, y = points[:, 0].copy(), points[:, 1].copy()
    points[:, 0] = np.cos(angle) * x - np.sin(angle) * y
    points[:, 1] = np.sin(angle) * x + np.cos(angle) * y
    return unit_sized(ObjectMesh(points, sphere.faces))


def _bump(
    directions: Float[np.ndarray, "n 3"], place: Float[np.ndarray, "3"], height: float, sharpness: float
) -> Float[np.ndarray, " n"]:
    """A smooth bump (dent where ``height`` is negative) on the unit sphere around the direction ``place``."""
    return height * np.exp(sharpness * (directions @ (place / np.linalg.norm(place)) - 1.0))
