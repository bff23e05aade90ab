"""What speaks for and against one relative pose of two scans, without the truth.

Surfaces that should be the same lie close and face alike; no point of one scan stands in the free space in front of
the other's readings, nor where the other looked and read nothing. Everything is asked both ways: what of the source
lies near the target, and what of the target lies near the source.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.nearest import VoxelTable, gather, nearest_one
from jaxmodel.lanes import Kernel
from jaxmodel.register.icp import Pose
from jaxmodel.scan.depth_map import DepthMap

ALIKE = 0.7
"""Least cosine between the normals of surfaces that are the same."""
FACING = 0.5
"""Least cosine between a normal and the way to the other sensor for a point that sensor should have read."""


class Side(eqx.Module):
    """One scan as the other is held against it, about its own centre, structure of arrays.

    ``points (3, m)`` with ``normals``, ``table`` to find the nearest of them; ``sample (3, n)`` with
    ``sample_normals``, evenly spread, that are held against the other scan; ``sight`` of its sensor.
    """

    points: Float[AnyArray, "3 m"]
    normals: Float[AnyArray, "3 m"]
    table: VoxelTable
    sample: Float[AnyArray, "3 n"]
    sample_normals: Float[AnyArray, "3 n"]
    mask: Bool[AnyArray, " n"]
    sight: DepthMap


class Half(eqx.Module):
    """One scan's sample against the other scan, shares of the sample's points.

    ``near``: within reach of the other's surface and facing alike; ``opposed``: within reach, facing otherwise;
    ``front``: in front of the other's readings; ``empty``: facing the other's sensor where it read nothing;
    ``scatter``: root mean square distance of the near ones to the other's tangent planes, unit of the data.
    """

    near: Float[jax.Array, "*b"]
    opposed: Float[jax.Array, "*b"]
    front: Float[jax.Array, "*b"]
    empty: Float[jax.Array, "*b"]
    scatter: Float[jax.Array, "*b"]


class Evidence(eqx.Module):
    """The source's sample against the target, and the target's against the source."""

    source: Half
    target: Half


class Examine(Kernel):
    """Evidence of many poses of one pair of scans; an item is a ``Pose`` between the centred frames.

    ``reach``: how far apart surfaces may be that are the same; ``margin``: how far in front of a reading a point
    must be to contradict it; both in the unit of the data.
    """

    target: Side
    source: Side
    reach: Float[AnyArray, ""]
    margin: Float[AnyArray, ""]

    def init(self, item: Pose) -> Pose:
        return item

    def done(self, state: Pose) -> Bool[jax.Array, ""]:
        return jnp.array(True)

    def step(self, state: Pose) -> Pose:
        return state

    def finish(self, state: Pose) -> Evidence:
        back = Pose(state.rotation.T, -(state.rotation.T @ state.translation))
        return Evidence(self._half(self.source, self.target, state), self._half(self.target, self.source, back))

    def _half(self, asked: Side, other: Side, pose: Pose) -> Half:
        moved = pose.move(asked.sample)
        turned = Pose(pose.rotation, jnp.zeros(3, jnp.float32)).move(asked.sample_normals)
        index = nearest_one(other.table, moved)
        away = [gather(axis, index) - at for axis, at in zip(other.points, moved, strict=True)]
        normal = [gather(axis, index) for axis in other.normals]
        alike = sum(a * b for a, b in zip(normal, turned, strict=True))
        plane = sum(a * b for a, b in zip(normal, away, strict=True))
        squared = sum(a * a for a in away)
        close = asked.mask & (squared < self.reach**2)
        near = close & (alike > ALIKE)
        seen = other.sight.see(moved)
        to_sensor = other.sight.eye[:, None] - moved
        length = jnp.sqrt(sum(a * a for a in to_sensor))
        infinite = other.sight.at_infinity > 0
        facing = sum(
            jnp.where(infinite, -axis, a / length) * b
            for axis, a, b in zip(other.sight.axes[2], to_sensor, turned, strict=True)
        )
        in_front = asked.mask & seen.known & (seen.depth > self.margin) & ~near
        missing = asked.mask & seen.empty & (facing > FACING) & ~near
        count = jnp.maximum(jnp.sum(asked.mask), 1).astype(jnp.float32)
        share = lambda of: jnp.sum(of).astype(jnp.float32) / count  # noqa: E731
        found = jnp.maximum(jnp.sum(near), 1).astype(jnp.float32)
        scatter = jnp.sqrt(jnp.sum(jnp.where(near, plane**2, 0.0)) / found)
        return Half(share(near), share(close & ~near), share(in_front), share(missing), scatter)


def as_sample(array: Float[np.ndarray, "n 3"], length: int) -> Float[np.ndarray, "3 m"]:
    """Float32 columns, padded with the first row."""
    padded = np.concatenate([array, np.repeat(array[:1], length - len(array), axis=0)])
    return np.ascontiguousarray(padded.T.astype(np.float32))
