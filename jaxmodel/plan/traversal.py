"""Voxels along a ray in order, six-connected (Amanatides & Woo, 1987), with empty space skipped exactly.

Lengths are in cells and measured from the grid's corner. Each axis along which a ray falls is mirrored first, so that
indices only grow: then the boundary after index i is crossed at ``(i + 1 - origin) / direction``, a difference and a
product whose rounding no compiler can change. Crossings are ordered by time and, where times are equal, by axis: a
ray through an edge or a corner has one well-defined row of voxels, the same with skipping and without.

The three axes are three arrays, never one: each formula is then one loop over rays that a compiler turns to vectors.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

Rows = tuple[Float[jax.Array, "*r"], Float[jax.Array, "*r"], Float[jax.Array, "*r"]]
"""A number of each ray along each axis."""

STILL = 1e30
"""Inverse speed along an axis to which a ray is perpendicular."""
NO_AXIS = 3


class Ray(NamedTuple):
    """Rays in mirrored coordinates, by axis: ``origin``, ``speed`` and its ``inverse``; ``octant`` they go to.

    Bit 2 of the octant says that rays fall along x, bit 1 along y, bit 0 along z.
    """

    origin: Rows
    speed: Rows
    inverse: Rows
    octant: Int[jax.Array, "*r"]


class Place(NamedTuple):
    """Where each ray is: voxel ``index`` (mirrored; whole numbers) and the time it was ``entered`` (in cells)."""

    index: Rows
    entered: Float[jax.Array, "*r"]


def mirrored_ray(origin: Rows, direction: Rows, shape: tuple[int, int, int]) -> Ray:
    """Rays from ``origin`` along unit ``direction``, turned so that no axis falls."""
    falls = [d < 0 for d in direction]
    speed = [jnp.abs(d) for d in direction]
    inverse = [jnp.where(s > 1 / STILL, 1 / jnp.maximum(s, 1 / STILL), STILL) for s in speed]
    start = [jnp.where(f, size - o, o) for f, o, size in zip(falls, origin, shape, strict=True)]
    x, y, z = (f.astype(jnp.int32) for f in falls)
    return Ray(_rows(start), _rows(speed), _rows(inverse), 4 * x + 2 * y + z)


def enter(ray: Ray, shape: tuple[int, int, int]) -> tuple[Place, Bool[jax.Array, "*r"]]:
    """The first voxel of each ray in the grid, and whether there is one."""
    before = [o < 0 for o in ray.origin]
    x, y, z = (jnp.where(b, t, -1.0) for b, t in zip(before, _crossings(ray, (0.0, 0.0, 0.0)), strict=True))
    entry = jnp.maximum(jnp.maximum(x, y), z)
    # the grid is entered with the last of these crossings; from within it none is needed
    axis = jnp.where(z == entry, 2, jnp.where(y == entry, 1, 0))
    outside = entry >= 0
    entry, axis = jnp.where(outside, entry, 0.0), jnp.where(outside, axis, NO_AXIS)
    side, leaves = _first(_crossings(ray, shape))
    beside = [(i >= STILL) & b for i, b in zip(ray.inverse, before, strict=True)]
    meets = ((entry < leaves) | ((entry == leaves) & (axis < side))) & ~(beside[0] | beside[1] | beside[2])
    index = [_reached(ray, a, entry, axis, 0.0, float(size)) for a, size in enumerate(shape)]
    return Place(_rows(index), entry), meets


def advance(ray: Ray, place: Place, clear: Float[jax.Array, "*r"]) -> Place:
    """Each ray's voxel after it left the cube of voxels that begins at its own and is ``clear`` (at least 1) wide.

    With ``clear`` 1 this is one step of the traversal; a larger one lands where that many steps would.
    """
    far = [index + clear for index in place.index]
    axis, time = _first(_crossings(ray, far))
    index = [
        jnp.where(axis == a, far[a], _reached(ray, a, time, axis, place.index[a], far[a])) for a in range(len(far))
    ]
    return Place(_rows(index), time)


def last_crossing(ray: Ray, index: Rows) -> Float[jax.Array, "*r"]:
    """When each ray entered a voxel it has walked to; 0 for the voxel it began in."""
    x, y, z = _crossings(ray, index)
    return jnp.maximum(jnp.maximum(jnp.maximum(x, y), z), 0)


def flat_index(ray: Ray, index: Rows, shape: tuple[int, int, int]) -> Int[jax.Array, "*r"]:
    """Row-major key of a voxel given by its mirrored index; keys of voxels outside the grid mean nothing."""
    i, j, k = (
        jnp.where((ray.octant >> (2 - axis)) & 1 == 1, size - 1 - along.astype(jnp.int32), along.astype(jnp.int32))
        for axis, (along, size) in enumerate(zip(index, shape, strict=True))
    )
    return (i * shape[1] + j) * shape[2] + k


def inside(index: Rows, shape: tuple[int, int, int]) -> Bool[jax.Array, "*r"]:
    """Whether rays are still in the grid: indices never fall."""
    return (index[0] < shape[0]) & (index[1] < shape[1]) & (index[2] < shape[2])


def _rows(rows: list[jax.Array]) -> Rows:
    x, y, z = rows
    return x, y, z


def _crossings(ray: Ray, boundary) -> list[Float[jax.Array, "*r"]]:
    """When each axis crosses a plane between voxels."""
    return [(b - o) * i for b, o, i in zip(boundary, ray.origin, ray.inverse, strict=True)]


def _first(time) -> tuple[Int[jax.Array, "*r"], Float[jax.Array, "*r"]]:
    """Axis that crosses first, the lower of equals, and when."""
    x, y, z = time
    first = jnp.minimum(jnp.minimum(x, y), z)
    return jnp.where(x == first, 0, jnp.where(y == first, 1, 2)), first


def _reached(ray: Ray, a: int, time, axis, low, end) -> Float[jax.Array, "*r"]:
    """Along axis ``a`` the index reached when all crossings before ``(time, axis)`` are made, from low to below end.

    Half a voxel back along the ray the guess is the index or the one before, whatever the rounding; comparing crossings
    tells which.
    """
    origin, inverse = ray.origin[a], ray.inverse[a]
    guess = jnp.clip(jnp.floor(origin + time * ray.speed[a] - 0.5), low, end - 1)
    following = guess + 1
    when = (following - origin) * inverse
    crossed = (when < time) | ((a < axis) & (when == time))
    return jnp.where(crossed & (following < end), following, guess)
