"""What a sensor would meet from many poses: every ray to the first voxel that is not empty (thesis §4.3.2).

The thesis walks its rays by Bresenham's line, which can slip through an edge between two voxels; this is the
six-connected traversal. A distance to the nearest voxel that stops a ray, kept in place of the label "empty", lets a
ray cross open space in one step. Poses are items of the lane engine; the rays of one pose step together.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_cdt

from jaxmodel.errors import InputError
from jaxmodel.lanes import Engine, Kernel, run
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import LABELS, Label
from jaxmodel.plan.traversal import Place, Ray, advance, enter, flat_index, inside, mirrored_ray
from jaxmodel.scan.sensor import Sensor, pixel_rays

FARTHEST = 127
NOTHING = LABELS
"""The label of a ray that meets nothing between the sensor's nearest and farthest distance."""


class Seen(NamedTuple):
    """``counts (v, 6)`` rays, or voxels, of each label met from each pose; ``cosines (v, 6)`` summed over them.

    A cosine is that of the angle between the ray and the inverse of the voxel's mean normal, at least 0, and 0 where
    no normal is known (unknown voxels). ``total`` rays were cast from each pose.
    """

    counts: Int[np.ndarray, "v 6"]
    cosines: Float[np.ndarray, "v 6"]
    total: int

    @property
    def shares(self) -> Float[np.ndarray, "v 6"]:
        """Part of all rays that meets each label."""
        return self.counts / self.total

    @property
    def quality(self) -> Float[np.ndarray, "v 6"]:
        """Mean cosine of each label, the thesis's K; 0 where none is seen."""
        return self.cosines / np.maximum(self.counts, 1)


class Space(eqx.Module):
    """A label map made ready for rays.

    ``code``: minus the label of a voxel that stops a ray, else how far (in voxels, largest difference of an index) the
    nearest such voxel is; ``normal`` of each voxel or zero, one row an axis; both by the voxel's key.
    """

    code: Int[jax.Array, " k"]
    normal: Float[jax.Array, "3 k"]
    shape: tuple[int, int, int] = eqx.field(static=True)


def space_of(labels: Int[np.ndarray, "x y z"], normals: Float[np.ndarray, "x y z 3"]) -> Space:
    """``labels`` (int8) with the distances that let rays skip; voxels beyond the map stop nothing."""
    empty = labels == Label.EMPTY
    if empty.all():
        distance = np.full(labels.shape, FARTHEST)
    else:
        distance = np.minimum(distance_transform_cdt(empty, metric="chessboard"), FARTHEST)
    code = np.where(empty, distance, -labels).astype(np.int8)
    rows = np.ascontiguousarray(normals.reshape(-1, 3).T, np.float32)
    return Space(jnp.asarray(code.reshape(-1)), jnp.asarray(rows), labels.shape)


class March(Kernel):
    """The rays of a sensor through a label map; an item is a pose ``(4, 4)`` from sensor to cells."""

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
        turned = lambda rows: sum(item[:3, k, None] * rows[k] for k in range(3))  # noqa: E731
        direction = turned(self.directions)
        ray = mirrored_ray(turned(self.origins) + item[:3, 3, None], direction, self.space.shape)
        place, meets = enter(ray, self.space.shape)
        return ray, direction, place, self._code(ray, place, meets)

    def step(self, state):
        ray, direction, place, code = state
        walking = code > 0
        following = advance(ray, place, jnp.maximum(code, 1).astype(jnp.int32))
        index = jnp.where(walking, following.index, place.index)
        place = Place(index, jnp.where(walking, following.entered, place.entered))
        on = inside(place.index, self.space.shape) & (place.entered <= self.farthest)
        return ray, direction, place, jnp.where(walking, self._code(ray, place, on), code)

    def done(self, state):
        return jnp.all(state[3] <= 0)

    def finish(self, state):
        ray, direction, place, code = state
        label = -code.astype(jnp.int32)
        label = jnp.where(place.entered >= self.nearest, label, NOTHING)
        key = jnp.where(label < NOTHING, flat_index(ray, place.index, self.space.shape), 0)
        normal = self.space.normal[:, key]
        cosine = jnp.maximum(-jnp.sum(normal * direction, axis=0), 0)
        if self.keep_rays:
            return label.astype(jnp.int8), jnp.where(label < NOTHING, key, -1), place.entered
        if self.distinct:
            order = jnp.argsort(key)
            label, key, cosine = label[order], key[order], cosine[order]
            label = jnp.where(jnp.concatenate([jnp.ones(1, bool), key[1:] != key[:-1]]), label, NOTHING)
        chosen = label == jnp.arange(LABELS)[:, None]
        return jnp.sum(chosen, axis=1), jnp.sum(jnp.where(chosen, cosine, 0), axis=1)

    def _code(self, ray: Ray, place: Place, on: Bool[jax.Array, " r"]) -> Int[jax.Array, " r"]:
        key = flat_index(ray, place.index, self.space.shape)
        return jnp.where(on, self.space.code[jnp.where(on, key, 0)], jnp.int8(-NOTHING))


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
        return Seen(np.zeros((0, LABELS), np.int32), np.zeros((0, LABELS), np.float32), sensor.width * sensor.height)
    kernel = march_kernel(map, sensor, ready(map) if space is None else space, distinct)
    counts, cosines = run(kernel, items, Engine(chunk=1024, lanes=64) if engine is None else engine)
    return Seen(counts, cosines, sensor.width * sensor.height)


def ready(map: LabelMap) -> Space:
    """The map as rays see it now."""
    labels = map.labels
    return space_of(labels, map.normals(labels))


def march_kernel(map: LabelMap, sensor: Sensor, space: Space, distinct: bool = False, keep_rays: bool = False) -> March:
    """The kernel of one sensor in one map, lengths in cells."""
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
