"""Points spread evenly over the surface of a mesh: what coverage is counted on."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.scan.triangle_mesh import ObjectMesh

MARGIN = 1e-3
"""How far, as a share of a triangle's height, a sample keeps from each side of its triangle."""


class SurfaceSamples(eqx.Module):
    """Sample points of a surface, in the frame and unit of the mesh.

    ``points (n, 3)`` strictly inside their triangles, unit ``normals (n, 3)`` of those triangles (outer side, faces
    being counter-clockwise), ``weights (n,)`` the area each stands for (their sum is the area of the mesh),
    ``faces (n,)`` the triangle each lies on.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, " n"]
    faces: Int[np.ndarray, " n"]


def sample_surface(mesh: ObjectMesh, key: jax.Array, count: int = 20_000) -> SurfaceSamples:
    """``count`` points spread over the area of ``mesh``: one in each of ``count`` equal shares of it.

    The shares follow the order of the faces, so the number of samples on any run of faces is its area share times
    ``count`` to within one; inside a triangle the place is uniform. The same ``key`` gives the same points.
    Raises :class:`InputError` for a mesh without area, a vertex that is not finite, or ``count`` below 1.
    """
    if count < 1:
        raise InputError(f"count: expected at least 1 sample of the surface, got {count}.")
    corners = np.asarray(mesh.vertices, dtype=np.float64)[mesh.faces]
    if not np.isfinite(corners).all():
        raise InputError("The mesh to sample has a vertex that is not finite.")
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    if not doubled.sum() > 0:
        raise InputError("The mesh to sample has no area.")
    proper = np.flatnonzero(doubled > 0)
    ends = np.cumsum(doubled[proper])
    draws = np.asarray(jax.random.uniform(key, (count, 3)), dtype=np.float64)
    place = (np.arange(count) + draws[:, 0]) / count * ends[-1]
    face = proper[np.minimum(np.searchsorted(ends, place, side="right"), len(proper) - 1)]
    root = np.sqrt(draws[:, 1])  # uniform on a triangle: Turk, Generating random points in triangles, 1990
    shares = np.stack([1 - root, root * (1 - draws[:, 2]), root * draws[:, 2]], axis=1)
    shares = MARGIN + (1 - 3 * MARGIN) * shares
    return SurfaceSamples(
        points=np.einsum("nc,nca->na", shares, corners[face]),
        normals=normals[face] / doubled[face][:, None],
        weights=np.full(count, ends[-1] / 2 / count),
        faces=face,
    )
