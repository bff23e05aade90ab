"""What a sensor would meet from many poses: every ray to the first voxel that is not empty (thesis §4.3.2).

The thesis walks its rays by Bresenham's line, which can slip through an edge between two voxels; this is the
six-connected traversal. Cubes of empty voxels ahead, kept in place of the label "empty", let a ray cross open space in
one step. Poses are items of the lane engine; the rays of one pose step together until few of them still walk, and
these go on in smaller and smaller company. The state of a ray is one whole number, so that a step is one fused loop.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.errors import InputError
from jaxmodel.lanes import Engine, Kernel, run
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import LABELS
from jaxmodel.plan.open_space import Space, space_of
from jaxmodel.plan.seen import NOTHING, REACH, Met, Seen, counted, once
from jaxmodel.plan.traversal import (
    Place,
    Ray,
    Rows,
    advance,
    enter,
    flat_index,
    inside,
    last_crossing,
    mirrored_ray,
)
from jaxmodel.scan.sensor import Sensor, pixel_rays

BITS = 10
"""Of each of the three indices in the state of a ray."""
STOPPED, GONE = 1 << 30, -(1 << 31)
"""State of a ray: its indices, with these bits when it met something or can meet nothing any more."""
COMPANY = 4
"""Once fewer than one ray in so many still walks, those are gathered; again among these."""
FEWEST = 64
"""Rays that are not worth gathering once more."""
TOGETHER = 8192
"""Rays of the views that one item holds: enough that a step costs more than the loop around it."""
AT_ONCE = 2
"""Steps between two counts of those that walk: with few rays, counting and looping cost as much as walking."""


class March(Kernel):
    """The rays of a sensor through a label map; an item is a group of poses ``(g, 4, 4)`` from sensor to cells."""

    space: Space
    origins: Float[jax.Array, "3 r"]
    directions: Float[jax.Array, "3 r"]
    nearest: Float[jax.Array, ""]
    farthest: Float[jax.Array, ""]
    distinct: bool = eqx.field(static=True, default=False)
    keep_rays: bool = eqx.field(static=True, default=False)

    @property
    def reorders_sums(self) -> bool:
        """No: which voxel comes first is decided by comparing times."""
        return False

    def init(self, item):
        direction = self._turned(item, self.directions)
        origin = [along + item[:, axis, 3, None] for axis, along in enumerate(self._turned(item, self.origins))]
        ray = mirrored_ray((origin[0], origin[1], origin[2]), direction, self.space.shape)
        place, meets = enter(ray, self.space.shape)
        return ray, direction, _packed(place.index, meets & (place.entered <= self.farthest))

    def step(self, state):
        ray, direction, packed = state
        return ray, direction, self._next(ray, packed)

    def done(self, state):
        return _walking(state[2]) <= state[2].size // COMPANY

    def finish(self, state):
        ray, direction, packed = state
        packed = self._all_to_the_end(ray, packed)
        index = _index(packed)
        label = jnp.where(packed >= 0, -self._code(ray, index), NOTHING)
        entered = last_crossing(ray, index)
        label = jnp.where(entered >= self.nearest, label, NOTHING)
        key = jnp.where(label < NOTHING, flat_index(ray, index, self.space.shape), 0)
        if self.keep_rays:
            return label.astype(jnp.int8), jnp.where(label < NOTHING, key, -1), entered
        x, y, z = (self.space.normal[axis][key] * along for axis, along in enumerate(direction))
        cosine = jnp.maximum(-(x + y + z), 0)
        far = jnp.minimum(entered / (REACH * max(self.space.shape)), 1.0)
        met = Met(label, key, cosine, self.space.near[key] * far * far)
        return counted(once(met, self.space.normal.shape[1]) if self.distinct else met)

    def _all_to_the_end(self, ray: Ray, packed: Int[jax.Array, "g r"]) -> Int[jax.Array, "g r"]:
        """The states of all rays when the last has ended."""
        flat = jax.tree.map(lambda row: row.reshape(-1), ray)
        return self._to_the_end(flat, packed.reshape(-1), packed.size // COMPANY).reshape(packed.shape)

    def _to_the_end(self, ray: Ray, packed: Int[jax.Array, " r"], few: int) -> Int[jax.Array, " r"]:
        """The states when the ``few`` rays that still walk have ended, by gathering them."""
        if few == 0:
            return packed
        rays = packed.shape[0]
        on = _is_walking(packed)
        place = jnp.where(on, jnp.cumsum(on) - 1, few)
        chosen = jnp.full(few, rays, jnp.int32).at[place].set(jnp.arange(rays, dtype=jnp.int32), mode="drop")
        some = jax.tree.map(lambda row: row[jnp.minimum(chosen, rays - 1)], ray)
        left = jnp.where(chosen < rays, packed[jnp.minimum(chosen, rays - 1)], GONE)
        fewer = few // COMPANY if few >= FEWEST * COMPANY else 0

        def steps(left: Int[jax.Array, " r"]) -> Int[jax.Array, " r"]:
            for _ in range(AT_ONCE):
                left = self._next(some, left)
            return left

        left = jax.lax.while_loop(lambda left: _walking(left) > fewer, steps, left)
        return packed.at[chosen].set(self._to_the_end(some, left, fewer), mode="drop")

    def _next(self, ray: Ray, packed: Int[jax.Array, "*r"]) -> Int[jax.Array, "*r"]:
        """One step of the rays that walk."""
        index = _index(packed)
        code = self._code(ray, index)
        following = advance(ray, Place(index, index[0]), jnp.maximum(code, 1).astype(jnp.float32))
        on = inside(following.index, self.space.shape) & (following.entered <= self.farthest)
        on = jnp.where(code > 0, _packed(following.index, on), packed | STOPPED)
        return jnp.where(_is_walking(packed), on, packed)

    def _code(self, ray: Ray, index: Rows) -> Int[jax.Array, "*r"]:
        """``space.code`` of mirrored voxels of the map."""
        nx, ny, nz = self.space.shape
        x, y, z = (along.astype(jnp.int32) for along in index)
        row = ((ray.octant * nx + x) * ny + y) * nz + z
        return self.space.code.at[row].get(mode="promise_in_bounds").astype(jnp.int32)

    def _turned(self, item, rows: Float[jax.Array, "3 r"]) -> Rows:
        """Directions of the sensor in the map."""
        u, v, w = rows
        x, y, z = (item[:, a, 0, None] * u + item[:, a, 1, None] * v + item[:, a, 2, None] * w for a in range(3))
        return x, y, z


def _packed(index: Rows, on: Bool[jax.Array, "*r"]) -> Int[jax.Array, "*r"]:
    x, y, z = (along.astype(jnp.int32) for along in index)
    return jnp.where(on, x | (y << BITS) | (z << 2 * BITS), jnp.int32(GONE))


def _index(packed: Int[jax.Array, "*r"]) -> Rows:
    x, y, z = (((packed >> shift) & ((1 << BITS) - 1)).astype(jnp.float32) for shift in (0, BITS, 2 * BITS))
    return x, y, z


def _is_walking(packed: Int[jax.Array, "*r"]) -> Bool[jax.Array, "*r"]:
    return (packed >= 0) & (packed < STOPPED)


def _walking(packed: Int[jax.Array, "*r"]) -> Int[jax.Array, ""]:
    return jnp.sum(_is_walking(packed))


def march(
    map: LabelMap, poses: Float[np.ndarray, "v 4 4"], sensor: Sensor, distinct: bool = False
) -> Int[np.ndarray, "v 6"]:
    """How many rays of ``sensor`` meet each :class:`Label` first, from each pose ``T_world_sensor``.

    Rays that meet nothing between the sensor's nearest and farthest distance are in no column. ``distinct``: voxels,
    each counted once a view, in place of rays. Raises :class:`InputError` for poses that are none.
    """
    return look(map, poses, sensor, distinct).counts


def look(
    map: LabelMap,
    poses: Float[np.ndarray, "v 4 4"],
    sensor: Sensor,
    distinct: bool = False,
    space: Space | None = None,
    engine: Engine | None = None,
) -> Seen:
    """Counts and cosines of what is met from each pose; see :func:`march`.

    ``space``: the map made ready by :func:`ready`, where many calls look at one map.
    """
    items = in_cells(map, poses)
    if len(items) == 0:
        none = np.zeros((0, LABELS), np.float32)
        return Seen(np.zeros((0, LABELS), np.int32), none, none, sensor.width * sensor.height)
    kernel = march_kernel(map, sensor, ready(map) if space is None else space, distinct)
    counts, cosines, promise = run_views(kernel, items, engine)
    return Seen(counts, cosines, promise, sensor.width * sensor.height)


def run_views(kernel: March, items: Float[np.ndarray, "v 4 4"], engine: Engine | None = None) -> Any:
    """The kernel's results, one row a view; views are marched in groups of about ``TOGETHER`` rays."""
    group = max(1, TOGETHER // kernel.origins.shape[1])
    # a few views are not worth a group of copies
    group = group if len(items) >= 2 * group else 1
    lacking = -len(items) % group
    groups = np.concatenate([items, np.repeat(items[:1], lacking, axis=0)]).reshape(-1, group, 4, 4)
    found = run(kernel, groups, Engine(chunk=max(1, 1024 // group), lanes=16) if engine is None else engine)
    return jax.tree.map(lambda array: array.reshape(-1, *array.shape[2:])[: len(items)], found)


def ready(map: LabelMap) -> Space:
    """The map as rays see it now."""
    labels = map.labels
    return space_of(labels, map.normals(labels), map.near())


def march_kernel(map: LabelMap, sensor: Sensor, space: Space, distinct: bool = False, keep_rays: bool = False) -> March:
    """The kernel of one sensor in one map, lengths in cells."""
    if max(space.shape) >= 1 << BITS:
        raise InputError(f"Rays march through maps of at most {(1 << BITS) - 1} voxels an edge, not {space.shape}.")
    rays = pixel_rays(sensor)
    row = lambda array: jnp.asarray(array.reshape(-1, 3).T, jnp.float32)  # noqa: E731
    low, high = sensor.minimum_range or 0.0, np.inf if sensor.maximum_range is None else sensor.maximum_range
    cell = map.grid.cell
    return March(
        space,
        row(rays.origins / cell),
        row(rays.directions),
        jnp.float32(low / cell),
        jnp.float32(high / cell),
        distinct,
        keep_rays,
    )


def in_cells(map: LabelMap, poses: Float[np.ndarray, "v 4 4"]) -> Float[np.ndarray, "v 4 4"]:
    """Poses ``T_world_sensor`` with their translation in cells from the grid's corner, float32."""
    poses = np.asarray(poses, np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise InputError(f"The poses to look from must be an array (views, 4, 4), not {poses.shape}.")
    if not np.isfinite(poses).all():
        bad = int(np.argmin(np.isfinite(poses).all(axis=(1, 2))))
        raise InputError(f"Pose {bad} (counted from 0) to look from is not finite.")
    items = poses.copy()
    items[:, :3, 3] = (items[:, :3, 3] - map.grid.origin) / map.grid.cell
    return items.astype(np.float32)
