"""What a range image adds to a label map: its rays marched to their readings and on behind them (thesis §4.3.1)."""

from functools import lru_cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_dilation

from jaxmodel.errors import InputError
from jaxmodel.lanes import jit_kernel
from jaxmodel.plan.label_map import MOST, UNIT, LabelMap
from jaxmodel.plan.traversal import advance, enter, flat_index, inside, mirrored_ray
from jaxmodel.scan.range_image import RangeImage, normals
from jaxmodel.scan.sensor import Sensor, pixel_rays

RIM = 2
"""Pixels around a reading whose missing neighbours say nothing: a surface seen too steeply may be there."""
NONE = -1


class Rays(NamedTuple):
    """One ray a pixel, in cells from the grid's corner: ``length`` to the reading, infinite where nothing was met.

    ``voxel`` key of the reading, -1 beyond the map or without one; ``told`` whether the pixel says anything.
    """

    origin: Float[np.ndarray, "3 n"]
    direction: Float[np.ndarray, "3 n"]
    length: Float[np.ndarray, " n"]
    reading: Bool[np.ndarray, " n"]
    voxel: Int[np.ndarray, " n"]
    told: Bool[np.ndarray, " n"]


def update(
    map: LabelMap, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"], sensor: Sensor | None = None
) -> LabelMap:
    """The map after a range image (sensor frame) taken from ``T_world_sensor``.

    With ``sensor``, pixels without a reading and away from any reading (``RIM``) say that their ray met nothing up to
    the sensor's farthest distance; without it they say nothing. Readings beyond the map are counted in ``outside``,
    and still clear the way to them. Raises :class:`InputError` for a pose that is none or an image of another shape.
    """
    T = np.asarray(T_world_sensor, np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InputError(f"The pose of a range image must be a finite (4, 4) matrix, not {T.shape}.")
    if sensor is not None and image.valid.shape != (sensor.height, sensor.width):
        raise InputError(
            f"The range image has {image.valid.shape[1]} x {image.valid.shape[0]} pixels, the sensor "
            f"{sensor.width} x {sensor.height}."
        )
    rays = image_rays(map, image, T, sensor)
    size = int(np.prod(map.grid.shape))
    flags = np.asarray(_evidence(map.grid.shape)(rays))
    crossed = flags[:size].reshape(map.grid.shape) > 0
    behind = flags[size : 2 * size].reshape(map.grid.shape) > 0
    return _with_readings(_with_shadow(map, crossed, behind, T, image.eye), rays, image, T)


def image_rays(
    map: LabelMap, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"], sensor: Sensor | None
) -> Rays:
    """The rays of a range image through the grid of ``map``."""
    R, t = T_world_sensor[:3, :3], T_world_sensor[:3, 3]
    valid = image.valid.reshape(-1)
    points = np.where(valid[:, None], image.points.reshape(-1, 3), 0.0)
    pinhole = image.eye[3] != 0
    if sensor is not None:
        model = pixel_rays(sensor)
        origin, direction = model.origins.reshape(-1, 3), model.directions.reshape(-1, 3)
        told = valid | ~np.asarray(binary_dilation(image.valid, iterations=RIM), bool).reshape(-1)
        reach = np.inf if sensor.maximum_range is None else sensor.maximum_range
    else:
        origin = np.zeros_like(points) if pinhole else points + image.eye[:3] * np.abs(points).max(initial=1.0) * 4
        direction, told, reach = np.zeros_like(points), valid, np.inf
    way = points - origin
    length = np.linalg.norm(way, axis=1)
    told = told & (~valid | (length > 0))
    # the measured direction, not the model's: a reading may have been moved since
    direction = np.where((valid & (length > 0))[:, None], way / np.maximum(length, 1e-300)[:, None], direction)
    index = map.grid.indices(points @ R.T + t)
    held = valid & map.grid.inside(index)
    shape = np.asarray(map.grid.shape)
    key = map.grid.keys(np.clip(index, 0, shape - 1))
    return Rays(
        origin=((origin @ R.T + t - map.grid.origin) / map.grid.cell).T.astype(np.float32),
        direction=(direction @ R.T).T.astype(np.float32),
        length=(np.where(valid, length, reach) / map.grid.cell).astype(np.float32),
        reading=valid & told,
        voxel=np.where(held, key, NONE).astype(np.int32),
        told=told,
    )


@lru_cache
def _evidence(shape: tuple[int, int, int]) -> Any:
    """Kernel: rays to flags by key, those of voxels crossed, then those of voxels behind a reading, then one spare."""
    size = int(np.prod(shape))

    def evidence(rays: Rays) -> jax.Array:
        (ox, oy, oz), (dx, dy, dz) = rays.origin, rays.direction
        ray = mirrored_ray((ox, oy, oz), (dx, dy, dz), shape)
        place, meets = enter(ray, shape)

        def body(state):
            place, walking, flags = state
            following = advance(ray, place, jnp.ones_like(place.index[0]))
            key = flat_index(ray, place.index, shape)
            other = walking & (key != rays.voxel)
            crossed = other & (following.entered <= rays.length)
            behind = other & rays.reading & (place.entered >= rays.length)
            row = jnp.where(crossed, key, jnp.where(behind, size + key, 2 * size))
            flags = flags.at[row].set(jnp.uint8(1))
            on = inside(following.index, shape) & (rays.reading | (following.entered < rays.length))
            return following, walking & on, flags

        flags = jnp.zeros(2 * size + 1, jnp.uint8)
        return jax.lax.while_loop(lambda state: jnp.any(state[1]), body, (place, meets & rays.told, flags))[2]

    return jit_kernel(evidence, False)


def _with_shadow(map: LabelMap, crossed, behind, T_world_sensor, eye) -> LabelMap:
    """Voxels crossed and behind; the direction to a voxel is that to its centre, once a view."""
    keys = np.flatnonzero(behind & (map.behind < MOST))
    centres = map.grid.centres(keys)
    eye_world = T_world_sensor @ eye
    away = eye_world[3] * centres - eye_world[:3]
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-300)
    x, y, z = np.rint(away * 2**20).T / 2**20
    products = np.rint(np.stack([x * x, x * y, x * z, y * y, y * z, z * z], axis=1) * UNIT).astype(np.int32)
    shadow, count = map.shadow_sum.copy().reshape(-1, 6), map.behind.copy().reshape(-1)
    shadow[keys] += products
    count[keys] += 1
    return eqx.tree_at(
        lambda m: (m.crossed, m.behind, m.shadow_sum, m.views),
        map,
        (map.crossed | crossed, count.reshape(behind.shape), shadow.reshape(map.shadow_sum.shape), map.views + 1),
    )


def _with_readings(map: LabelMap, rays: Rays, image: RangeImage, T_world_sensor) -> LabelMap:
    """Readings counted in their voxels, with their normals and distances."""
    valid = image.valid.reshape(-1)
    rows = np.flatnonzero(rays.voxel >= 0)
    key = rays.voxel[rows]
    size = map.points.size
    count = np.bincount(key, minlength=size)
    room = MOST - map.points.reshape(-1)
    kept = rows
    if (count > room).any():
        order = np.argsort(key, kind="stable")
        rank = np.arange(len(key)) - np.searchsorted(key[order], key[order])
        kept = rows[order[rank < room[key[order]]]]
    key = rays.voxel[kept]
    normal = normals(image).reshape(-1, 3)[kept] @ T_world_sensor[:3, :3].T
    whole = np.rint(normal * UNIT).astype(np.int64)
    total = np.stack([np.bincount(key, whole[:, axis], size) for axis in range(3)], axis=1)
    nearest = map.nearest.copy().reshape(-1)
    np.minimum.at(nearest, key, rays.length[kept] * np.float32(map.grid.cell))
    shape = map.points.shape
    return eqx.tree_at(
        lambda m: (m.points, m.nearest, m.normal_sum, m.outside, m.full),
        map,
        (
            map.points + np.bincount(key, minlength=size).reshape(shape).astype(np.int32),
            nearest.reshape(shape),
            map.normal_sum + np.rint(total).reshape(*shape, 3).astype(np.int32),
            map.outside + int(np.sum(valid & (rays.voxel < 0))),
            map.full + len(rows) - len(kept),
        ),
    )
