"""Poses that local geometry proposes: points whose surroundings look alike, taken in sets that fit one rigid motion.

Most pairs of points that look alike are wrong, but the right ones agree with each other and the wrong ones do not: a
rigid motion keeps the distance of two points and the angles of their normals. Each pair of points is a seed; the pairs
that share most agreeing pairs with it (the second-order compatibility of Chen et al. 2022, SC2-PCR) are fitted with
it. Nothing is drawn at random.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.geometry.rigid_fit import quaternion_from_moments, rotation_from_quaternion, weighted_moments
from jaxmodel.lanes import CPU_OPTIONS

ALTERNATIVES = 2
"""Points of the target that each point of the source may look like."""
SUPPORT = 8
"""Agreeing pairs that are fitted to a seed."""
ANGLE = 0.35
"""Most that angles within two agreeing pairs may differ by, radian: estimated normals err."""


class Pairs(NamedTuple):
    """Points that look alike: row i of each belongs to row i of the others. Frames of their own scans."""

    source: Float[np.ndarray, "n 3"]
    source_normals: Float[np.ndarray, "n 3"]
    target: Float[np.ndarray, "n 3"]
    target_normals: Float[np.ndarray, "n 3"]


def alike(
    target: Float[np.ndarray, "m f"], source: Float[np.ndarray, "n f"], count: int
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """The ``count`` most distinct of the pairs (target row, source row) that look alike.

    A pair looks alike when either is among the ``ALTERNATIVES`` nearest of the other, features being rows of one
    length; those that are so both ways come first. Half are the closest, half those closest beyond what they have in
    common with everything: of a solid with flat faces the closest pairs are flat, and say nothing.
    """
    likeness = target.astype(np.float32) @ source.T.astype(np.float32)
    mine, theirs = (_most_alike(matrix) for matrix in (likeness, likeness.T))
    m, n = likeness.shape
    pairs = [(np.repeat(np.arange(m), mine.shape[1]), mine.ravel())]
    pairs += [(theirs.ravel(), np.repeat(np.arange(n), theirs.shape[1]))]
    rows, columns = (np.concatenate(both) for both in zip(*pairs, strict=True))
    key, times = np.unique(rows * n + columns, return_counts=True)
    rows, columns = key // n, key % n
    closeness = likeness[rows, columns]
    usual = np.maximum(likeness.mean(axis=1)[rows], likeness.mean(axis=0)[columns])
    by_closeness = np.lexsort((-closeness, times == 1))
    by_rarity = np.lexsort((usual - closeness, times == 1))
    chosen = np.stack([by_closeness, by_rarity], axis=1).ravel()
    chosen = chosen[np.sort(np.unique(chosen, return_index=True)[1])][:count]
    return rows[chosen], columns[chosen]


def _most_alike(likeness: Float[np.ndarray, "m n"]) -> Int[np.ndarray, "m k"]:
    """The columns of the ``ALTERNATIVES`` largest values of each row."""
    left, found = likeness.copy(), []
    for _ in range(min(ALTERNATIVES, likeness.shape[1])):
        found.append(left.argmax(axis=1))
        np.put_along_axis(left, found[-1][:, None], -np.inf, axis=1)
    return np.stack(found, axis=1)


def propose(pairs: Pairs, tolerance: float) -> Float[np.ndarray, "n 4 4"]:
    """A pose T_target_source from each pair as the seed.

    ``tolerance``: most that the distances within two agreeing pairs may differ by, unit of the data.
    """
    centres = pairs.target.mean(axis=0), pairs.source.mean(axis=0)
    p, q = (
        jnp.asarray(points - c, jnp.float32)
        for points, c in zip((pairs.source, pairs.target), centres[::-1], strict=True)
    )
    n, m = (jnp.asarray(normals, jnp.float32) for normals in (pairs.source_normals, pairs.target_normals))
    R, t = (np.asarray(a, np.float64) for a in _fitted(p, n, q, m, jnp.float32(tolerance)))
    T = np.tile(np.eye(4), (len(R), 1, 1))
    T[:, :3, :3] = R
    T[:, :3, 3] = t + centres[0] - R @ centres[1]
    return T


@partial(jax.jit, compiler_options=CPU_OPTIONS if jax.default_backend() == "cpu" else None)
def _fitted(
    p: Float[jax.Array, "n 3"],
    n: Float[jax.Array, "n 3"],
    q: Float[jax.Array, "n 3"],
    m: Float[jax.Array, "n 3"],
    tolerance: Float[jax.Array, ""],
) -> tuple[Float[jax.Array, "n 3 3"], Float[jax.Array, "n 3"]]:
    agree = _agreement(p, n, q, m, tolerance)
    shared = agree @ agree * agree

    def one_seed(row: Float[jax.Array, " n"], number: jax.Array) -> tuple[jax.Array, jax.Array]:
        weight, chosen = jax.lax.top_k(row, SUPPORT)
        weight = jnp.concatenate([jnp.max(weight, keepdims=True) + 1.0, weight])
        chosen = jnp.concatenate([number[None], chosen])
        moments = weighted_moments(p[chosen], q[chosen], weight)
        quaternion, _ = quaternion_from_moments(moments)
        R = rotation_from_quaternion(quaternion)
        return R, moments.target_mean - R @ moments.source_mean

    return jax.lax.map(lambda each: one_seed(*each), (shared, jnp.arange(len(p))), batch_size=64)


def _agreement(
    p: Float[jax.Array, "n 3"],
    n: Float[jax.Array, "n 3"],
    q: Float[jax.Array, "n 3"],
    m: Float[jax.Array, "n 3"],
    tolerance: Float[jax.Array, ""],
) -> Float[jax.Array, "n n"]:
    """1 where two pairs fit one rigid motion: the distance, the angle of the normals, and theirs with the line."""
    distance, along = _measured(p, n)
    distance_q, along_q = _measured(q, m)
    turn = jnp.abs(_angle(n @ n.T) - _angle(m @ m.T))
    lean = jnp.abs(along - along_q)
    lean = jnp.maximum(lean, lean.T)
    apart = jnp.minimum(distance, distance_q) > 2 * tolerance  # near pairs say little, and say it often
    agrees = (jnp.abs(distance - distance_q) < tolerance) & (turn < ANGLE) & (lean < ANGLE) & apart
    return agrees.astype(jnp.float32)


def _measured(p: Float[jax.Array, "n 3"], n: Float[jax.Array, "n 3"]) -> tuple[jax.Array, jax.Array]:
    """Distances of all points, and the angles of each row's normal with the line to each column's point."""
    line = p[None, :, :] - p[:, None, :]
    distance = jnp.sqrt(jnp.sum(line**2, axis=2))
    return distance, _angle(jnp.einsum("ija,ia->ij", line, n) / jnp.maximum(distance, 1e-30))


def _angle(cosine: Float[jax.Array, "n n"]) -> Float[jax.Array, "n n"]:
    return jnp.arccos(jnp.clip(cosine, -1.0, 1.0))
