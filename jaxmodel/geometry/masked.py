"""Padding to size classes, and statistics that ignore it. A mask travels with each padded array."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Shaped


def size_class(count: int, smallest: int = 256) -> int:
    """The padded length for ``count`` items: a power of two or one and a half times one.

    Clouds of similar size then share compiled kernels, at no more than half again the work.
    """
    if count <= smallest:
        return smallest
    power = 1 << (int(count) - 1).bit_length()
    return power * 3 // 4 if count <= power * 3 // 4 else power


def pad_rows(values: Shaped[np.ndarray, "n *rest"], length: int) -> Shaped[np.ndarray, "m *rest"]:
    """``values`` extended with zeros to ``length`` rows."""
    padded = np.zeros((length, *values.shape[1:]), values.dtype)
    padded[: len(values)] = values
    return padded


def mean(values: Float[jax.Array, "*batch n"], mask: Bool[jax.Array, "*batch n"]) -> Float[jax.Array, "*batch"]:
    """Mean over the last axis of the entries whose mask is set; 0 where none is."""
    count = jnp.sum(mask, axis=-1)
    return jnp.sum(jnp.where(mask, values, 0.0), axis=-1) / jnp.maximum(count, 1)


def quantile(
    values: Float[jax.Array, "*batch n"], mask: Bool[jax.Array, "*batch n"], q: float
) -> Float[jax.Array, "*batch"]:
    """The q-quantile (linear interpolation) over the last axis of the masked entries; NaN where none is set."""
    ordered = jnp.sort(jnp.where(mask, values, jnp.inf), axis=-1)
    count = jnp.sum(mask, axis=-1)
    position = q * jnp.maximum(count - 1, 0)
    low = jnp.floor(position).astype(jnp.int32)
    high = jnp.minimum(low + 1, jnp.maximum(count - 1, 0))
    below = jnp.take_along_axis(ordered, low[..., None], axis=-1)[..., 0]
    above = jnp.take_along_axis(ordered, high[..., None], axis=-1)[..., 0]
    value = below + (position - low) * jnp.where(high > low, above - below, 0.0)
    return jnp.where(count > 0, value, jnp.nan)


def median(values: Float[jax.Array, "*batch n"], mask: Bool[jax.Array, "*batch n"]) -> Float[jax.Array, "*batch"]:
    """Median over the last axis of the masked entries; NaN where none is set."""
    return quantile(values, mask, 0.5)
