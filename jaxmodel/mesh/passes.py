"""Passes of the ball with growing radii, each on what the one before left open (thesis §3.3.7, the pass tables)."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import adjacency, border_length
from jaxmodel.mesh.growth import grow, open_vertices, pivot
from jaxmodel.mesh.radii import ball_radii, check_radii

Radii = Sequence[float] | Literal["auto"]

STALLED = 0.97  # a pass that leaves more than this share of the border is not worth its triangles


class Pass(NamedTuple):
    """One pass of the ball: its radius, the triangles it found, and the border it left (edges, length)."""

    radius: float
    triangles: int
    border_edges: int
    border_length: float


def run_passes(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    radii: Radii,
    spacing: float,
    faces: Int[np.ndarray, "s 3"] | None = None,
    first: float | None = None,
    seen: Callable[[Int[np.ndarray, "k 3"]], Bool[np.ndarray, " k"]] | None = None,
    sheet: Int[np.ndarray, " n"] | None = None,
) -> tuple[Int[np.ndarray, "m 3"], tuple[Pass, ...]]:
    """Triangles of all passes, after the ``faces`` there already are, and the passes.

    With "auto" the radii grow from ``first``, else from ``spacing``, until the border stops shrinking,
    and a ball larger than the first keeps only the triangles that are ``seen``: it could bridge what no scan saw.
    No triangle joins points of different ``sheet``.
    Raises ``InputError`` when no pass finds a triangle; it names a radius that would.
    """
    faces = np.zeros((0, 3), np.int64) if faces is None else faces
    passes: list[Pass] = []
    wanted = ball_radii(spacing if first is None else first) if isinstance(radii, str) else check_radii(radii, spacing)
    for radius in wanted:
        grown = grow(points, normals, faces, radius, sheet=sheet)
        if isinstance(radii, str) and seen is not None and passes:
            found = grown[len(faces) :]
            grown = np.concatenate([faces, found[seen(found)]])
        shared = adjacency(grown)
        border = int((shared.faces == 1).sum())
        made = Pass(radius, len(grown) - len(faces), border, border_length(points, shared))
        if isinstance(radii, str) and passes and 0 < STALLED * passes[-1].border_length < made.border_length:
            break
        faces = grown
        passes.append(made)
        if not open_vertices(faces, len(points)).any():
            break
    if len(faces) == 0:
        raise InputError(_no_seed(points, normals, wanted, spacing))
    return faces, tuple(passes)


def _no_seed(points: np.ndarray, normals: np.ndarray, tried: Sequence[float], spacing: float) -> str:
    what = f"No ball of radius {', '.join(f'{radius:.4g}' for radius in tried)} rests on three points"
    for radius in ball_radii(spacing):
        if len(pivot(points, normals, radius)):
            return f"{what}: they are about {spacing:.4g} apart, and a radius of {radius:.4g} would do."
    return f"{what}, nor does any larger one: {len(points)} points about {spacing:.4g} apart are too few for a surface."
