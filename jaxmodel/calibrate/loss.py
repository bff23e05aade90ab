"""Robust losses as weights: how much a sample of a given size still pulls (Huber; Tukey's biweight).

A size is the root mean square of a sample's six normalised residuals: 1 for a usual one. Scales come from medians, so
that up to half of the samples may be wrong without spoiling them.
"""

from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.geometry.masked import median

Loss = Literal["none", "huber", "tukey"]
LOSSES: tuple[Loss, ...] = ("none", "huber", "tukey")
MEDIAN_LENGTH = {1: 0.67449, 2: 1.17741, 3: 1.53817}
"""Median length of a normal error of so many dimensions, in standard deviations of one component."""
HUBER = 0.7  # sizes beyond it pull as if they had it: nearly a spatial median, for three wrong samples in ten
TUKEY = 2.6  # sizes beyond it pull nothing
WRONG = 1.93  # sizes beyond it are one in a thousand of right samples (chi-squared, six degrees of freedom)


def checked_loss(name: str) -> Loss:
    """``name`` as a loss; raises :class:`InputError` for another word."""
    for loss in LOSSES:
        if name == loss:
            return loss
    raise InputError(f"loss must be one of {', '.join(LOSSES)}, not {name!r}.")


def robust_variance(
    lengths: Float[jax.Array, " n"], used: Bool[jax.Array, " n"], dimensions: int
) -> Float[jax.Array, ""]:
    """The variance of one component of normal errors, from the median of their lengths."""
    return (median(lengths, used) / MEDIAN_LENGTH[dimensions]) ** 2


def loss_weights(size: Float[jax.Array, " n"], loss: Loss) -> Float[jax.Array, " n"]:
    """psi(s) / s of each size: 1 for small ones."""
    if loss == "huber":
        return jnp.minimum(1.0, HUBER / jnp.maximum(size, 1e-300))
    if loss == "tukey":
        return jnp.where(size < TUKEY, (1 - (size / TUKEY) ** 2) ** 2, 0.0)
    return jnp.ones_like(size)


def contradicts(weight: Float[np.ndarray, " *n"], loss: Loss) -> Bool[np.ndarray, " *n"]:
    """Which samples a loss weighs so low that they are hardly right ones: beyond ``WRONG``."""
    least = {"none": 0.0, "huber": HUBER / WRONG, "tukey": (1 - (WRONG / TUKEY) ** 2) ** 2}
    return weight < least[loss]


def loss_slopes(size: Float[jax.Array, " n"], loss: Loss) -> Float[jax.Array, " n"]:
    """The mean derivative of psi over the six directions: one is along the residual, five are across it."""
    across = loss_weights(size, loss)
    if loss == "huber":
        return jnp.where(size < HUBER, 1.0, 5 / 6 * across)
    if loss == "tukey":
        u = jnp.minimum(size / TUKEY, 1.0) ** 2
        return (5 * across + (1 - u) * (1 - 5 * u)) / 6
    return across
