"""Zhang's statistical filter of pairs (thesis §2.5.3; Zhang 1994), with the fixed scale D of annex B (ERRATA)."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

BINS = 32


def zhang_limit(
    distance: Float[jax.Array, " n"],
    kept: Bool[jax.Array, " n"],
    scale: Float[jax.Array, ""],
    previous: Float[jax.Array, ""],
) -> Float[jax.Array, ""]:
    """The distance limit of this iteration from the pairs below the previous one's.

    mean < D: mean + 3 sigma; mean < 3 D: mean + 2 sigma; mean < 6 D: mean + sigma; else the first valley of the
    distances' histogram after its main peak. D is ``scale``. Without a pair the previous limit stays.
    """
    kept = kept & (distance < previous)
    count, total, squares = sum_over_points(
        [kept.astype(distance.dtype), *(jnp.where(kept, value, 0.0) for value in (distance, distance * distance))],
        repeatable=True,
    )
    safe = jnp.maximum(count, 1.0)
    mean = total / safe
    sigma = jnp.sqrt(jnp.maximum(squares / safe - mean * mean, 0.0))
    factor = jnp.where(mean < scale, 3.0, jnp.where(mean < 3.0 * scale, 2.0, 1.0))
    limit = jax.lax.cond(
        mean < 6.0 * scale,
        lambda: mean + factor * sigma,
        lambda: histogram_valley(distance, kept),
    )
    return jnp.where(count > 0, limit, previous)


def histogram_valley(distance: Float[jax.Array, " n"], kept: Bool[jax.Array, " n"]) -> Float[jax.Array, ""]:
    """Upper edge of the first valley after the main peak of the kept distances' histogram.

    The histogram has 32 bins up to the largest kept distance. The valley is the first bin after the peak that is lower
    than the one before it and not higher than the one after it; without one everything is kept.
    """
    largest = jnp.max(jnp.where(kept, distance, 0.0))
    width = jnp.maximum(largest / BINS, jnp.finfo(distance.dtype).tiny)
    bins = jnp.clip((distance / width).astype(jnp.int32), 0, BINS - 1)
    counts = jnp.zeros(BINS, jnp.int32).at[bins].add(kept.astype(jnp.int32))
    position = jnp.arange(BINS)
    before = jnp.concatenate([counts[:1], counts[:-1]])
    after = jnp.concatenate([counts[1:], counts[-1:] + 1])
    valley = (position > jnp.argmax(counts)) & (counts < before) & (counts <= after)
    first = jnp.argmax(valley)
    return jnp.where(jnp.any(valley), (first + 1) * width, jnp.nextafter(largest, jnp.inf))


def sum_over_points(
    terms: list[Float[jax.Array, " n"]],
    repeatable: bool = False,
    bounds: list[Float[jax.Array, ""]] | None = None,
) -> tuple[Float[jax.Array, ""], ...]:
    """All sums in one pass over the points: what makes the terms is computed once per point, not once per sum.

    A ``repeatable`` sum has the same bits in whatever order the compiler adds: terms are rounded to integer multiples
    of a power of two, the smallest with which no sum of n of them overflows 32 bits (a relative 2e-6 of the largest
    term with 2048 points). Without ``bounds``, one per term that no absolute value exceeds, that takes a first pass for
    the largest term, so the terms should then be cheap: no gathers.
    """
    if not repeatable:
        return _reduce(terms, jnp.add)
    bits = min(22, 30 - (terms[0].shape[0] - 1).bit_length())
    largest = _reduce([jnp.abs(term) for term in terms], jnp.maximum) if bounds is None else bounds
    units = [_unit(value, bits) for value in largest]
    counts = [_to_integer(term * (1.0 / unit)) for term, unit in zip(terms, units, strict=True)]
    return tuple(total.astype(unit.dtype) * unit for total, unit in zip(_reduce(counts, jnp.add), units, strict=True))


def _to_integer(values: Float[jax.Array, " n"]) -> Int[jax.Array, " n"]:
    """The nearest integers of values below 2^22 in size: the low bits of the sum with 1.5 * 2^23, whose unit is one."""
    offset = np.float32(1.5 * 2**23)
    return jax.lax.bitcast_convert_type(values + offset, jnp.int32) - offset.view(np.int32)


def _unit(largest: Float[jax.Array, ""], bits: int) -> Float[jax.Array, ""]:
    """The power of two of which ``largest`` (not negative) is less than ``2 ** bits`` multiples, made from its bits."""
    exponent = (jax.lax.bitcast_convert_type(largest, jnp.int32) >> 23) + 1 - bits
    return jax.lax.bitcast_convert_type(jnp.clip(exponent, 1, 253) << 23, jnp.float32)


def _reduce(terms: list[jax.Array], combine: Callable) -> tuple[jax.Array, ...]:
    starts = tuple(jnp.zeros((), term.dtype) for term in terms)
    return tuple(
        jax.lax.reduce(tuple(terms), starts, lambda a, b: tuple(combine(x, y) for x, y in zip(a, b, strict=True)), (0,))
    )
