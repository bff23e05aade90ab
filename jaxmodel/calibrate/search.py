"""Solutions on the group where the closed forms have none: parallel axes, planar motion, translations, half turns.

From 24 rotations spread over SO(3), or from given ones, the least-squares problem of all pairs is descended and the
best end kept. It answers wherever an answer exists, and gives one of them where there are many.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import linear_translation
from jaxmodel.calibrate.nonlinear import descend
from jaxmodel.calibrate.pairs import Pairs, make_pairs, pair_sums
from jaxmodel.calibrate.refine import Weighting, refine, residuals
from jaxmodel.geometry import se3
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.masked import pad_rows, size_class


def _cube_rotations() -> np.ndarray:
    found = []
    for first in range(3):
        for second in range(3):
            if first != second:
                for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                    x, y = np.zeros(3), np.zeros(3)
                    x[first], y[second] = signs
                    found.append(np.stack([x, y, np.cross(x, y)]))
    return np.stack(found)


STARTS = _cube_rotations()  # no rotation is further than 63 degrees from one of these


class Found(eqx.Module):
    """Ends of descents, with the sums of squares of their residuals (rad^2, length^2) and their cost."""

    estimate: Estimate
    rotation_squares: Float[AnyArray, "*k"]
    translation_squares: Float[AnyArray, "*k"]
    cost: Float[AnyArray, "*k"]

    def X(self) -> Float[np.ndarray, "k 4 4"]:
        return se3.compose(np.asarray(self.estimate.R), np.asarray(self.estimate.t))


def descend_from(pairs: Pairs, starts: Float[jax.Array, "k 3 3"], weighting: Weighting, unknown_scale: bool) -> Found:
    """The ends of descents from given rotations, each with the translation that suits it best."""
    sums = pair_sums(pairs)

    def one(R: jax.Array) -> Found:
        end = descend(sums, linear_translation(sums, R, unknown_scale), weighting, unknown_scale)
        end = refine(pairs, end, weighting, unknown_scale, steps=3)
        angle, distance = residuals(pairs, end)
        rotation, translation = jnp.sum(pairs.weight * angle**2), jnp.sum(pairs.weight * distance**2)
        cost = weighting.rotation * rotation + weighting.translation * translation
        # a mirror-like answer with a negative scale is none
        cost = jnp.where(jnp.isfinite(cost) & (end.scale > 0), cost, jnp.inf)
        return Found(end, rotation, translation, cost)

    return jax.vmap(one)(starts)


class Search:
    """Descents on one set of motions (host): NumPy in, NumPy out, one compiled kernel for all of them."""

    def __init__(
        self,
        A: Float[np.ndarray, "n 4 4"],
        B: Float[np.ndarray, "n 4 4"],
        weights: Float[np.ndarray, " n"],
        unknown_scale: bool,
    ) -> None:
        length = size_class(len(A), smallest=16)
        self._motions = pad_rows(A, length), pad_rows(B, length), pad_rows(weights, length)
        self._unknown_scale = unknown_scale
        # either stream's translations may be noise alone; A's are of another unit where the scale is unknown
        squares = np.sum(B[:, :3, 3] ** 2, axis=1) + (0.0 if unknown_scale else np.sum(A[:, :3, 3] ** 2, axis=1))
        lengths = float(np.sum(weights * squares) / np.sum(weights))
        self._weighting = 1.0, 1.0 / (lengths if lengths > 0 else 1.0)

    def from_starts(self, starts: Float[np.ndarray, "k 3 3"], weighting: tuple[float, float] | None = None) -> Found:
        """The ends from at most 24 starts; by default rotation and translation weigh by the size of the motions."""
        padded = np.concatenate([starts, np.broadcast_to(np.eye(3), (len(STARTS) - len(starts), 3, 3))])
        with jax.enable_x64(True):
            found = _kernel(self._unknown_scale)(*self._motions, padded, *(weighting or self._weighting))
            found = jax.tree.map(np.asarray, found)
        return jax.tree.map(lambda leaf: leaf[: len(starts)], found)

    def best(self) -> tuple[Float[np.ndarray, "4 4"], float]:
        """X and scale of the best end, once more with rotation and translation weighted by their own residuals."""
        found = self.from_starts(STARTS)
        first = int(np.argmin(found.cost))
        freedom = max(3 * len(self._motions[2].nonzero()[0]) - 3, 1)
        unit = 1.0 / self._weighting[1]
        variances = found.rotation_squares[first] / freedom, found.translation_squares[first] / freedom
        weighting = 1.0 / (variances[0] + 1e-18), 1.0 / (variances[1] + 1e-18 * unit)
        settled = self.from_starts(np.asarray(found.estimate.R)[first : first + 1], weighting)
        if np.isfinite(settled.cost[0]):
            return settled.X()[0], float(settled.estimate.scale[0])
        return found.X()[first], float(found.estimate.scale[first])


@lru_cache
def _kernel(unknown_scale: bool) -> Callable[..., Found]:
    def one(A: jax.Array, B: jax.Array, weight: jax.Array, starts: jax.Array, rotation: Any, translation: Any) -> Found:
        pairs, _ = make_pairs(A, B, weight)
        return descend_from(pairs, starts, Weighting(jnp.asarray(rotation), jnp.asarray(translation)), unknown_scale)

    return jax.jit(one)
