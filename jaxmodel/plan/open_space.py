"""A label map made ready for rays: how far open space reaches ahead of each voxel, for every way a ray can go.

A ray never turns back along an axis, so that only what lies ahead of it can stop it. Its signs put it in one of eight
octants; for each octant and voxel the table holds the edge of the largest cube of empty voxels that begins at the voxel
and lies ahead. A ray leaves this cube in one step (``traversal.advance``). A distance that looks all around would be
bound by the wall just left.
"""

from itertools import product

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.plan.labels import Label

FARTHEST = 127
"""Longest edge of a cube that is kept."""


class Space(eqx.Module):
    """A label map as rays see it.

    ``code``: minus the label of a voxel that stops a ray, else the edge (in voxels) of the empty cube ahead. One table
    an octant, that of ``4 fx + 2 fy + fz`` where f says that rays fall along the axis, in mirrored coordinates (indices
    counted along the ray). ``normal`` of each voxel or zero, one row an axis, and ``near``, from 0 to 1 how near it is
    to known surface, by the voxel's key.
    """

    code: Int[jax.Array, " eight_k"]
    normal: Float[jax.Array, "3 k"]
    near: Float[jax.Array, " k"]
    shape: tuple[int, int, int] = eqx.field(static=True)


def space_of(
    labels: Int[np.ndarray, "x y z"],
    normals: Float[np.ndarray, "x y z 3"],
    near: Float[np.ndarray, "x y z"] | None = None,
) -> Space:
    """``labels`` (int8) with the cubes that let rays skip; voxels beyond the map stop nothing. ``near``: default 1."""
    ahead = cubes_ahead(labels == Label.EMPTY)
    code = np.stack(
        [np.where(edge > 0, edge, -_mirrored(labels, falls)) for edge, falls in zip(ahead, octants(), strict=True)]
    )
    rows = np.ascontiguousarray(normals.reshape(-1, 3).T, np.float32)
    likely = np.ones(labels.size, np.float32) if near is None else near.reshape(-1).astype(np.float32)
    return Space(jnp.asarray(code.reshape(-1).astype(np.int8)), jnp.asarray(rows), jnp.asarray(likely), labels.shape)


def octants() -> list[tuple[int, ...]]:
    """Which axes fall (1), by the number of the octant."""
    return list(product((0, 1), repeat=3))


def cubes_ahead(empty: Bool[np.ndarray, "x y z"]) -> Int[np.ndarray, "8 x y z"]:
    """Edge of the largest empty cube that begins at each voxel and lies ahead, by octant, in mirrored coordinates.

    It is the largest difference of an index to the nearest voxel ahead that is not empty, found axis by axis.
    """
    most = min(FARTHEST, max(empty.shape))
    start = np.where(empty, most, 0).astype(np.int8)
    tables = []
    for fx in (start, start[::-1]):
        along_x = _nearest_ahead(fx, 0, most)
        for fy in (along_x, along_x[:, ::-1]):
            along_y = _nearest_ahead(fy, 1, most)
            tables += [_nearest_ahead(fz, 2, most) for fz in (along_y, along_y[:, :, ::-1])]
    return np.stack(tables)


def _nearest_ahead(distance: Int[np.ndarray, "x y z"], axis: int, most: int) -> Int[np.ndarray, "x y z"]:
    """Least over the shifts s of the larger of s and the distance there: Chebyshev's distance, an axis more."""
    rows = np.ascontiguousarray(np.moveaxis(distance, axis, 0))
    nearest = rows.copy()
    for shift in range(1, min(most, len(rows))):
        if shift >= nearest.max():
            break
        np.minimum(nearest[:-shift], np.maximum(rows[shift:], np.int8(shift)), out=nearest[:-shift])
    return np.moveaxis(nearest, 0, axis)


def _mirrored(array: np.ndarray, falls: tuple[int, ...]) -> np.ndarray:
    return array[tuple(slice(None, None, -1 if f else 1) for f in falls)]
