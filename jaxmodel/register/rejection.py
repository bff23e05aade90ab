"""Zhang's statistical filter of pairs (thesis §2.5.3; Zhang 1994), with the fixed scale D of annex B (ERRATA)."""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

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
        [kept.astype(distance.dtype), *(jnp.where(kept, value, 0.0) for value in (distance, distance * distance))]
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


def sum_over_points(terms: list[Float[jax.Array, " n"]]) -> tuple[Float[jax.Array, ""], ...]:
    """All sums in one pass over the points: what makes the terms is computed once per point, not once per sum."""
    zeros = tuple(jnp.zeros((), term.dtype) for term in terms)
    return tuple(
        jax.lax.reduce(tuple(terms), zeros, lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)), (0,))
    )
