"""Planes that wave: where views lie a little off each other, a mesh of their mean has waves much longer than its edges,
which no scatter between neighbouring vertices tells of.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.mesh.creases import smooth_parts
from jaxmodel.mesh.flatness import BEND, TRIANGLES, bend_and_rms
from jaxmodel.mesh.primitives import Surface, fit_plane

WAVE = 0.05
"""Largest rms height of the waves, in edge lengths: less than a shape sampled by such edges can be told by."""


def wavy_planes(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    areas: Float[np.ndarray, " m"],
    pairs: Int[np.ndarray, "p 2"],
    crease: Bool[np.ndarray, " p"],
    free: Bool[np.ndarray, " m"],
    edge: float,
    smallest: float,
) -> list[tuple[Surface, Int[np.ndarray, " k"]]]:
    """The smooth parts of the triangles that are ``free`` which are planes as a whole, each with its triangles.

    Such a part is nowhere far from its plane for the length of its edges, and that distance comes and goes: hardly
    any of it is one bend of the whole part, as nearly all of it is on a shallow dome.
    """
    found = []
    for part in smooth_parts(free, pairs, crease, areas, smallest):
        if len(part) < TRIANGLES:
            continue
        plane = fit_plane(vertices[faces[part]].reshape(-1, 3), np.repeat(areas[part], 3))
        bend, rms = bend_and_rms(vertices[np.unique(faces[part])], plane)
        if rms <= WAVE * edge and bend <= BEND * rms:
            found.append((plane, part))
    return found
