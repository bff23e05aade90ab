"""What rays met, counted by label."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.plan.labels import LABELS

NOTHING = LABELS
"""The label of a ray that meets nothing between the sensor's nearest and farthest distance."""
REACH = 0.25
"""Distance, in the map's longest edge, from which on a ray promises as much as any."""


class Seen(NamedTuple):
    """``counts (v, 6)`` rays, or voxels, of each label met from each pose; ``cosines``, ``promise`` summed.

    A cosine is that of the angle between the ray and the inverse of the voxel's mean normal, at least 0, and 0 where
    no normal is known (unknown voxels). A promise is how close to known surface the voxel lies
    (:meth:`LabelMap.near`), times the square of its distance in ``REACH`` where that is less than 1: a ray that ends
    close by shows little area. ``total`` rays were cast from each pose.
    """

    counts: Int[np.ndarray, "v 6"]
    cosines: Float[np.ndarray, "v 6"]
    promise: Float[np.ndarray, "v 6"]
    total: int

    @property
    def shares(self) -> Float[np.ndarray, "v 6"]:
        """Part of all rays that meets each label."""
        return self.counts / self.total

    @property
    def quality(self) -> Float[np.ndarray, "v 6"]:
        """Mean cosine of each label, the thesis's K; 0 where none is seen."""
        return self.cosines / np.maximum(self.counts, 1)

    @property
    def promising(self) -> Float[np.ndarray, "v 6"]:
        """Mean promise of each label; 0 where none is seen."""
        return self.promise / np.maximum(self.counts, 1)

    def take(self, rows: np.ndarray) -> "Seen":
        """Some of the views."""
        return Seen(self.counts[rows], self.cosines[rows], self.promise[rows], self.total)

    def joined(self, other: "Seen") -> "Seen":
        """These views and those of another."""
        pairs = zip(self[:3], other[:3], strict=True)
        counts, cosines, promise = (np.concatenate(pair) for pair in pairs)
        return Seen(counts, cosines, promise, self.total)


class Met(NamedTuple):
    """What each ray of a group of views met: ``label``, the voxel's ``key``, ``cosine`` and ``promise``."""

    label: Int[jax.Array, "g r"]
    key: Int[jax.Array, "g r"]
    cosine: Float[jax.Array, "g r"]
    promise: Float[jax.Array, "g r"]


def once(met: Met, voxels: int) -> Met:
    """Each voxel of a view for one ray alone, nothing for the others; ``key`` is below ``voxels``."""
    key = jnp.where(met.label < NOTHING, met.key, voxels)
    order = jnp.argsort(key, axis=1)
    label, key, cosine, promise = (
        jnp.take_along_axis(row, order, axis=1) for row in (met.label, key, met.cosine, met.promise)
    )
    first = jnp.concatenate([jnp.ones_like(key[:, :1], bool), key[:, 1:] != key[:, :-1]], axis=1)
    return Met(jnp.where(first, label, NOTHING), key, cosine, promise)


def counted(met: Met) -> tuple[Int[jax.Array, "g 6"], Float[jax.Array, "g 6"], Float[jax.Array, "g 6"]]:
    """Rays, cosines and promise of each label, summed by view.

    Cosines and promise, from 0 to 1, are summed as whole numbers, fine enough that no sum overflows: a float sum
    depends on the order the compiler chooses, and that on how many views are grouped.
    """
    chosen = [met.label == label for label in range(LABELS)]
    fine = 2.0 ** (30 - (met.label.shape[1] - 1).bit_length())
    total = lambda row: jnp.stack([jnp.sum(jnp.where(of, row, 0), axis=1) for of in chosen], axis=1)  # noqa: E731
    exact = lambda row: (total(jnp.round(row * fine).astype(jnp.int32)) / fine).astype(row.dtype)  # noqa: E731
    return total(jnp.ones_like(met.label)), exact(met.cosine), exact(met.promise)
