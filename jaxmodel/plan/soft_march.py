"""A differentiable view of a label map: what each ray meets, in shares that vary smoothly with the pose (DESIGN §4).

Counted percentages (:mod:`ray_march`) are piecewise constant in the pose. Here labels are interpolated between voxel
centres, the share that is not empty becomes the opacity of a sample, and samples are composited from front to back.
Samples lie at fixed distances from the sensor, so they move with the ray alone; those that have no opacity are left
out by a search that needs no derivative, and leaving them out changes nothing.
"""

from functools import partial
from itertools import product
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_cdt

from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import LABELS, Label, beside
from jaxmodel.plan.open_space import FARTHEST
from jaxmodel.scan.sensor import Sensor, pixel_rays

CORNERS = tuple(product((0, 1), repeat=3))
BITS = 3
BURIED = 7
"""Code of a voxel that stops light but has no empty neighbour: no ray meets it first."""
EXHAUSTED = 1e-7
"""Light that is left when a ray counts as stopped."""
LEAST = 1e-6
GOLDEN = 0.6180339887
UNIT = 511.0
"""Steps of 1 in which a normal's component is kept: three of ten bits."""


class SoftLaw(eqx.Module):
    """How a share becomes opacity. Lengths in cells.

    ``low`` the share that is not empty up to which a sample is clear, ``high`` that from which it is opaque;
    ``spacing`` of the samples along a ray.
    """

    low: float | Float[jax.Array, ""] = 0.15
    high: float | Float[jax.Array, ""] = 0.5
    spacing: float | Float[jax.Array, ""] = 0.5


class SoftSpace(eqx.Module):
    """A label map made ready for soft rays, one entry a cell between eight voxel centres.

    ``cells``: the labels of its eight corners, three bits each, EMPTY as 0; where all are empty, minus how far (in
    cells, largest difference of an index) the nearest cell is that has another. ``normals`` of the voxels, ten bits a
    component, by the key of a grid with a rim of one voxel.
    """

    cells: Int[jax.Array, " c"]
    normals: Int[jax.Array, " k"]
    shape: tuple[int, int, int] = eqx.field(static=True)


class SoftRays(eqx.Module):
    """Rays of a sensor, its frame, lengths in cells: origins and unit directions, one row an axis, and its limits."""

    origins: Float[jax.Array, "3 r"]
    directions: Float[jax.Array, "3 r"]
    nearest: Float[jax.Array, ""]
    farthest: Float[jax.Array, ""]


class SoftSeen(NamedTuple):
    """``shares`` of all rays that meet each label; ``cosines`` mean over all rays, each in its label (see ``Seen``)."""

    shares: Float[jax.Array, "6"]
    cosines: Float[jax.Array, "6"]
    lost: Float[jax.Array, ""]


def soft_space_of(labels: Int[np.ndarray, "x y z"], normals: Float[np.ndarray, "x y z 3"]) -> SoftSpace:
    """``labels`` (int8) and unit ``normals`` (zero where none is known); beyond the map all is empty."""
    empty = labels == Label.EMPTY
    codes = labels.astype(np.int32) ^ int(Label.EMPTY)
    codes[~empty & ~beside(empty, True)] = BURIED
    padded = np.pad(codes, 1)
    x, y, z = (size + 1 for size in labels.shape)
    cells = np.zeros((x, y, z), np.int32)
    for corner, (i, j, k) in enumerate(CORNERS):
        cells |= padded[i : i + x, j : j + y, k : k + z] << (BITS * corner)
    clear = cells == 0
    if clear.all():
        distance = np.full(cells.shape, FARTHEST)
    else:
        distance = np.minimum(np.asarray(distance_transform_cdt(clear, metric="chessboard")), FARTHEST)
    cells = np.where(clear, -distance, cells).astype(np.int32)
    whole = np.pad(np.rint(normals * UNIT).astype(np.int32) + 512, ((1, 1),) * 3 + ((0, 0),), constant_values=512)
    packed = whole[..., 0] | whole[..., 1] << 10 | whole[..., 2] << 20
    return SoftSpace(jnp.asarray(cells.reshape(-1)), jnp.asarray(packed.reshape(-1)), labels.shape)


def soft_ready(map: LabelMap) -> SoftSpace:
    """The map as soft rays see it now."""
    labels = map.labels
    return soft_space_of(labels, map.normals(labels))


def soft_rays(map: LabelMap, sensor: Sensor) -> SoftRays:
    """The rays of one sensor in one map, lengths in cells."""
    rays = pixel_rays(sensor)
    row = lambda array: jnp.asarray(array.reshape(-1, 3).T, jnp.float32)  # noqa: E731
    low, high = sensor.minimum_range or 0.0, np.inf if sensor.maximum_range is None else sensor.maximum_range
    cell = map.grid.cell
    return SoftRays(row(rays.origins / cell), row(rays.directions), jnp.float32(low / cell), jnp.float32(high / cell))


def soft_shares(
    space: SoftSpace, pose: Float[jax.Array, "4 4"], rays: SoftRays, law: SoftLaw | None = None, samples: int = 16
) -> SoftSeen:
    """What ``rays`` meet from ``pose`` (sensor to cells), differentiable in the pose.

    ``samples``: how many samples with opacity a ray may pass, from the front; what light is left then is ``lost``.
    """
    law = SoftLaw() if law is None else law
    turned = lambda rows: jnp.sum(pose[:3, :3, None] * rows[None], axis=1)  # noqa: E731
    direction = turned(rays.directions)
    origin = turned(rays.origins) + pose[:3, 3, None]
    phase = jnp.asarray(np.arange(direction.shape[1]) * GOLDEN % 1, direction.dtype)
    detached = jax.lax.stop_gradient
    steps, left = _opaque_samples(space, detached(origin), detached(direction), phase, rays, detached(law), samples)

    time = (jnp.maximum(steps, 0) + phase) * law.spacing
    used = steps >= 0
    place = origin[:, None] + direction[:, None] * time
    cell, fraction, _ = _cell(place, space.shape)
    corners = space.cells[cell[1]]
    label = _labels(corners)
    weight = _weights(fraction)
    share = jnp.sum(jnp.where(label != 0, weight, 0.0), axis=0)
    opacity = jnp.where(used, _opacity(share, law), 0.0)
    clear = jnp.cumprod(1 - opacity, axis=0)
    arriving = jnp.concatenate([jnp.ones_like(clear[:1]), clear[:-1]])
    near = time >= rays.nearest
    weight = jnp.where((label != 0) & (label != BURIED), weight, 0.0)
    met = jnp.sum(weight, axis=0)
    stopped = arriving * opacity / jnp.where(used & (met > LEAST), met, 1.0)
    stopped = jnp.where(near & used & (met > LEAST), stopped, 0.0) * weight
    cosine = _cosines(space, cell[0], direction)
    chosen = (label ^ int(Label.EMPTY)) == jnp.arange(LABELS).reshape(LABELS, 1, 1, 1)
    total = direction.shape[1]
    shares = jnp.sum(jnp.where(chosen, stopped, 0.0), axis=(1, 2, 3)) / total
    cosines = jnp.sum(jnp.where(chosen, stopped * cosine, 0.0), axis=(1, 2, 3)) / total
    return SoftSeen(shares, cosines, jnp.sum(left) / total)


def quality(seen: SoftSeen, total: int) -> Float[jax.Array, "6"]:
    """Mean cosine of each label, the thesis's K; it fades to 0 where less than a hundredth of a ray meets the label."""
    return seen.cosines / (seen.shares + 0.01 / total)


def _opacity(share, law: SoftLaw):
    ramp = jnp.clip((share - law.low) / (law.high - law.low), 0.0, 1.0)
    return ramp * ramp * (3 - 2 * ramp)


def _weights(fraction):
    """Weights (8, ...) of a cell's corners, in the order of CORNERS."""
    x, y, z = jnp.stack([1 - fraction, fraction], axis=1)
    return (x[:, None, None] * y[None, :, None] * z[None, None, :]).reshape(8, *fraction.shape[1:])


def _labels(cells):
    """Codes (8, ...) of the corners of packed cells."""
    return (cells >> (BITS * jnp.arange(8)).reshape(8, *[1] * cells.ndim)) & 7


def _cell(place, shape):
    """Cell between voxel centres of each place: its index, its key, where in it, and whether the map has it."""
    moved = place + 0.5
    size = jnp.asarray(shape, place.dtype).reshape(3, *[1] * (place.ndim - 1))
    whole = jnp.clip(jnp.floor(jax.lax.stop_gradient(moved)), 0, size)
    inside = jnp.all((moved >= 0) & (moved < size + 1), axis=0)
    index = whole.astype(jnp.int32)
    key = (index[0] * (shape[1] + 1) + index[1]) * (shape[2] + 1) + index[2]
    return (index, key), jnp.clip(moved - whole, 0.0, 1.0), inside


def _cosines(space: SoftSpace, index, direction):
    """Of the angle between each ray and the inverse normal of each corner, at least 0."""
    _, y, z = (size + 2 for size in space.shape)
    offset = jnp.asarray([(i * y + j) * z + k for i, j, k in CORNERS])
    first = (index[0] * y + index[1]) * z + index[2]
    packed = space.normals[first + offset.reshape(8, *[1] * first.ndim)]
    return jnp.maximum(sum((512 - ((packed >> (10 * axis)) & 1023)) / UNIT * direction[axis] for axis in range(3)), 0.0)


@partial(jax.named_call, name="opaque_samples")
def _opaque_samples(space: SoftSpace, origin, direction, phase, rays: SoftRays, law: SoftLaw, samples: int):
    """Numbers (samples, r) of each ray's first samples with opacity, -1 where there are no more; light left over."""
    size = jnp.asarray(space.shape, origin.dtype)[:, None]
    moving = jnp.abs(direction) > 1e-9
    inverse = 1 / jnp.where(moving, direction, 1.0)
    low, high = (-0.5 - origin) * inverse, (size + 0.5 - origin) * inverse
    within = (origin >= -0.5) & (origin <= size + 0.5)
    enters = jnp.max(jnp.where(moving, jnp.minimum(low, high), jnp.where(within, -jnp.inf, jnp.inf)), axis=0)
    leaves = jnp.min(jnp.where(moving, jnp.maximum(low, high), jnp.inf), axis=0)
    leaves = jnp.minimum(leaves, rays.farthest)
    walks = (enters < leaves) & (leaves > 0)
    first = jnp.where(walks, jnp.maximum(jnp.ceil(enters / law.spacing - phase), 0), 0)
    pace = 0.9999 / (law.spacing * jnp.max(jnp.abs(direction), axis=0))

    def body(state):
        step, walking, light, count, found = state
        place = origin + direction * ((step + phase) * law.spacing)
        (_, key), fraction, _ = _cell(place, space.shape)
        corners = space.cells[key]
        share = jnp.sum(jnp.where(_labels(corners) != 0, _weights(fraction), 0.0), axis=0)
        clear = corners < 0
        opacity = jnp.where(clear, 0.0, _opacity(share, law))
        counts = walking & (opacity > 0)
        found = jnp.where((jnp.arange(samples)[:, None] == count) & counts, step, found)
        light = jnp.where(counts, light * (1 - opacity), light)
        count = count + counts
        step = step + jnp.where(clear, jnp.floor((-corners - 1) * pace) + 1, 1.0)
        walking = walking & (light > EXHAUSTED) & (count < samples) & ((step + phase) * law.spacing <= leaves)
        return step, walking, light, count, found

    count = jnp.zeros(walks.shape, jnp.int32)
    found = jnp.full((samples, *walks.shape), -1.0, origin.dtype)
    start = (first, walks, jnp.ones_like(first), count, found)
    _, _, light, count, found = jax.lax.while_loop(lambda state: jnp.any(state[1]), body, start)
    return found, jnp.where(count >= samples, light, 0.0)
