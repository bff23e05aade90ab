"""Voxels along a ray in order, six-connected (Amanatides & Woo, 1987), with empty space skipped exactly.

Lengths are in cells and measured from the grid's corner. Each axis along which a ray falls is mirrored first, so that
indices only grow: then the boundary after index i is crossed at ``(i + 1 - origin) / direction``, a difference and a
product whose rounding no compiler can change. Crossings are ordered by time and, where times are equal, by axis: a
ray through an edge or a corner has one well-defined row of voxels, the same with skipping and without.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

STILL = 1e30
"""Inverse speed along an axis to which a ray is perpendicular."""


class Ray(NamedTuple):
    """Rays in mirrored coordinates, one row an axis: ``origin``, ``speed``, its ``inverse``, and ``mirrored`` or not."""

    origin: Float[jax.Array, "3 *r"]
    speed: Float[jax.Array, "3 *r"]
    inverse: Float[jax.Array, "3 *r"]
    mirrored: Bool[jax.Array, "3 *r"]


class Place(NamedTuple):
    """Where each ray is: voxel ``index`` (mirrored) and the time it was ``entered`` (in cells along the ray)."""

    index: Int[jax.Array, "3 *r"]
    entered: Float[jax.Array, "*r"]


def mirrored_ray(
    origin: Float[jax.Array, "3 *r"], direction: Float[jax.Array, "3 *r"], shape: tuple[int, int, int]
) -> Ray:
    """Rays from ``origin`` along unit ``direction``, turned so that no axis falls."""
    size = jnp.asarray(shape, origin.dtype).reshape(3, *[1] * (origin.ndim - 1))
    falls = direction < 0
    speed = jnp.abs(direction)
    inverse = jnp.where(speed > 1 / STILL, 1 / jnp.maximum(speed, 1 / STILL), STILL)
    return Ray(jnp.where(falls, size - origin, origin), speed, inverse, falls)


def crossing(ray: Ray, boundary: Float[jax.Array, "3 *r"]) -> Float[jax.Array, "3 *r"]:
    """When each axis crosses a plane between voxels."""
    return (boundary - ray.origin) * ray.inverse


def enter(ray: Ray, shape: tuple[int, int, int]) -> tuple[Place, Bool[jax.Array, "*r"]]:
    """The first voxel of each ray in the grid, and whether there is one."""
    size = jnp.asarray(shape, ray.origin.dtype).reshape(3, *[1] * (ray.origin.ndim - 1))
    before = ray.origin < 0
    when = jnp.where(before, crossing(ray, jnp.zeros_like(ray.origin)), -1.0)
    entry = jnp.max(when, axis=0)
    # the grid is entered with the last of these crossings; from within it none is needed
    axis = jnp.where(when[2] == entry, 2, jnp.where(when[1] == entry, 1, 0))
    outside = entry >= 0
    entry, axis = jnp.where(outside, entry, 0.0), jnp.where(outside, axis, 3)
    side, leaves = _first(crossing(ray, jnp.broadcast_to(size, ray.origin.shape)))
    meets = ((entry < leaves) | ((entry == leaves) & (axis < side))) & ~jnp.any((ray.inverse >= STILL) & before, axis=0)
    start = jnp.clip(jnp.floor(ray.origin), 0, size - 1).astype(jnp.int32)
    index = _reached(ray, entry, axis, jnp.zeros_like(start), size.astype(jnp.int32) - 1, start)
    return Place(index, entry), meets


def advance(ray: Ray, place: Place, clear: Int[jax.Array, "*r"]) -> Place:
    """Each ray's voxel after it left the cube of voxels nearer than ``clear`` (at least 1) to its own.

    With ``clear`` 1 this is one step of the traversal; a larger one lands where that many steps would.
    """
    far = place.index + clear
    axis, time = _first(crossing(ray, far.astype(ray.origin.dtype)))
    index = _reached(ray, time, axis, place.index, far - 1, place.index)
    chosen = axis == _axes(index)
    return Place(jnp.where(chosen, far, index), time)


def flat_index(ray: Ray, index: Int[jax.Array, "3 *r"], shape: tuple[int, int, int]) -> Int[jax.Array, "*r"]:
    """Row-major key of a voxel given by its mirrored index; keys of voxels outside the grid mean nothing."""
    nx, ny, nz = shape
    i = jnp.where(ray.mirrored[0], nx - 1 - index[0], index[0])
    j = jnp.where(ray.mirrored[1], ny - 1 - index[1], index[1])
    k = jnp.where(ray.mirrored[2], nz - 1 - index[2], index[2])
    return (i * ny + j) * nz + k


def inside(index: Int[jax.Array, "3 *r"], shape: tuple[int, int, int]) -> Bool[jax.Array, "*r"]:
    """Whether rays are still in the grid: indices never fall."""
    return (index[0] < shape[0]) & (index[1] < shape[1]) & (index[2] < shape[2])


def _axes(like: jax.Array) -> jax.Array:
    return jnp.arange(3).reshape(3, *[1] * (like.ndim - 1))


def _first(time: Float[jax.Array, "3 *r"]) -> tuple[Int[jax.Array, "*r"], Float[jax.Array, "*r"]]:
    """Axis that crosses first, the lower of equals, and when."""
    x, y, z = time
    first = jnp.minimum(jnp.minimum(x, y), z)
    return jnp.where(x == first, 0, jnp.where(y == first, 1, 2)), first


def _reached(ray: Ray, time, axis, low, high, fallback):
    """Along each axis, the index reached when all crossings before ``(time, axis)`` are made, within bounds.

    The guess may be off by one through rounding; comparing crossings puts it right.
    """
    along = ray.origin + time * ray.speed
    guess = jnp.clip(jnp.where(ray.inverse < STILL, jnp.floor(along).astype(jnp.int32), fallback), low, high)
    earlier = _axes(guess) < axis

    def crossed(boundary: jax.Array) -> jax.Array:
        when = crossing(ray, boundary.astype(ray.origin.dtype))
        return (when < time) | (earlier & (when == time))

    guess = jnp.where((guess < high) & crossed(guess + 1), guess + 1, guess)
    return jnp.where((guess > low) & ~crossed(guess), guess - 1, guess)
