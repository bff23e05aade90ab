"""Pairing the moved source with the target: closest points, cluster neighbourhood, uniqueness (thesis §2.5, annex B).

The text's direction is kept: each source point looks for its closest target point, so that one table around the
static target serves every start (ERRATA, §2.5).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxmodel.geometry.nearest import FAR, VoxelTable, candidate_stack, gather, nearest_one
from jaxmodel.register.method import Strategy

Row = Float[jax.Array, " n"]


class Clusters(eqx.Module):
    """The uniform grid over both clouds' joint box (§2.5.1): corner and edge, unit of the data."""

    origin: Float[jax.Array, "3"]
    edge: Float[jax.Array, ""]


class Pairs(eqx.Module):
    """One candidate target per source point; ``kept`` says whether the pair counts."""

    index: Int[jax.Array, " n"]
    point: tuple[Row, Row, Row]  # the target points paired, by axis
    distance: Row
    kept: Bool[jax.Array, " n"]


def find_pairs(
    strategy: Strategy,
    fast: VoxelTable | None,
    exact: VoxelTable | None,
    target: Float[jax.Array, "3 m"],
    moved: Float[jax.Array, "3 n"],
    mask: Bool[jax.Array, " n"],
    clusters: Clusters,
    max_distance: Float[jax.Array, ""],
) -> Pairs:
    """Pairs of one iteration before statistical rejection; ``moved`` is the source in the target's frame."""

    def near(point: list[jax.Array] | tuple[jax.Array, ...]) -> Bool[jax.Array, " n"]:
        """Whether a candidate's cluster lies within the neighbourhood of the point's own, on each axis (fig. 2.17)."""
        if strategy.neighbourhood is None:
            return jnp.ones(moved.shape[1], bool)
        inside = jnp.ones(moved.shape[1], bool)
        for axis in range(3):
            per_cluster = 1.0 / clusters.edge
            own = jnp.floor((moved[axis] - clusters.origin[axis]) * per_cluster)
            other = jnp.floor((point[axis] - clusters.origin[axis]) * per_cluster)
            inside &= jnp.abs(own - other) <= strategy.neighbourhood
        return inside

    if strategy.exact or strategy.stack > 1:
        assert exact is not None
        stack = candidate_stack(exact, target, moved, strategy.stack, near)
        if strategy.unique:
            best, index_best = _unique(stack.index, jnp.where(mask, stack.squared_distance, FAR), target.shape[1])
        else:
            best, index_best = stack.squared_distance[0], stack.index[0]
    else:
        assert fast is not None
        index_best = nearest_one(fast, moved)
        best = None
    x, y, z = (gather(target[axis], index_best) for axis in range(3))
    if best is None:
        best = (x - moved[0]) ** 2 + (y - moved[1]) ** 2 + (z - moved[2]) ** 2
        best = jnp.where(near((x, y, z)), best, FAR)
    kept = mask & (best < FAR) & (best <= max_distance * max_distance)
    return Pairs(index_best, (x, y, z), jnp.sqrt(jnp.where(kept, best, 0.0)), kept)


def _unique(
    index: Int[jax.Array, "k n"], squared: Float[jax.Array, "k n"], targets: int
) -> tuple[Row, Int[jax.Array, " n"]]:
    """Redistribution until no target is taken twice (§2.5.3, fig. 2.20): squared distance (FAR: unpaired) and target.

    In each round every target keeps the closest of the points that claim it; the others pop their stack. A point whose
    stack is used up stays unpaired. Rounds go on until nobody pops: on real scans 5 to 12, more than the K or 2K - 3
    rounds printed. Only then are equal distances told apart: the first of the equals stays, the rounds go on.
    """
    depth, count = index.shape
    columns = jnp.arange(count, dtype=jnp.int32)

    def top(rank: Int[jax.Array, " n"]) -> tuple[jax.Array, jax.Array]:
        claimed, distance = index[0], jnp.where(rank < depth, squared[0], FAR)
        for level in range(1, depth):
            claimed = jnp.where(rank == level, index[level], claimed)
            distance = jnp.where(rank == level, squared[level], distance)
        return jax.lax.optimization_barrier((claimed, distance))

    def one_round(carry: tuple) -> tuple:
        rank, _ = carry
        claimed, distance = top(rank)
        closest = jnp.full(targets, FAR, distance.dtype).at[claimed].min(distance, mode="promise_in_bounds")
        wins = (distance < FAR) & (distance <= gather(closest, claimed))
        # a candidate that failed the gates is FAR and is popped as well
        pops = (rank < depth) & ~wins
        settled = ~jnp.any(pops)

        def later_equals() -> jax.Array:
            first = (
                jnp.full(targets, count, jnp.int32)
                .at[claimed]
                .min(jnp.where(wins, columns, count), mode="promise_in_bounds")
            )
            return wins & (gather(first, claimed) != columns)

        pops = jax.lax.cond(settled, later_equals, lambda: pops)
        return rank + pops.astype(jnp.int32), jnp.any(pops)

    rank, _ = jax.lax.while_loop(lambda carry: carry[1], one_round, (jnp.zeros(count, jnp.int32), jnp.array(True)))
    claimed, distance = top(rank)
    return distance, claimed
