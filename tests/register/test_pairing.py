"""Uniqueness against a slow reference, the gates against their definitions, and what a pair must be."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.geometry.nearest import FAR, VoxelTable, build_table
from jaxmodel.register.method import Strategy
from jaxmodel.register.pairing import Clusters, Pairs, _unique, find_pairs

unique = jax.jit(_unique, static_argnums=2)
COUNT, DEPTH = 96, 4


def reference(index: np.ndarray, squared: np.ndarray) -> dict[int, int]:
    """Point -> target by deferred acceptance, one point at a time: a target keeps the closest, the earlier of equals.

    The outcome of deferred acceptance does not depend on the order of the proposals, so rounds must give the same.
    """
    depth, count = index.shape
    rank, holder = np.zeros(count, int), {}
    waiting = list(range(count))[::-1]
    while waiting:
        point = waiting.pop()
        while rank[point] < depth and squared[rank[point], point] >= FAR:
            rank[point] += 1
        if rank[point] == depth:
            continue
        target = int(index[rank[point], point])
        other = holder.get(target)
        if other is None:
            holder[target] = point
            continue
        loser = max(point, other, key=lambda p: (squared[rank[p], p], p))
        holder[target] = point + other - loser
        rank[loser] += 1
        waiting.append(loser)
    return {point: target for target, point in holder.items()}


def random_stacks(seed: int, targets: int) -> tuple[np.ndarray, np.ndarray]:
    """Stacks with distinct targets, nearest first, whole-number distances (ties) and some FAR entries at the end."""
    rng = np.random.default_rng(seed)
    index = np.stack([rng.permutation(targets)[:DEPTH] for _ in range(COUNT)], axis=1).astype(np.int32)
    squared = np.sort(rng.integers(0, 12 if seed % 2 else 100_000, size=(DEPTH, COUNT)), axis=0).astype(np.float32)
    missing = rng.integers(0, DEPTH + 1, size=COUNT)
    missing[rng.uniform(size=COUNT) < 0.7] = 0
    squared[np.arange(DEPTH)[:, None] >= DEPTH - missing] = FAR
    return index, squared


@pytest.mark.parametrize("targets", [20, 80, 400])
@pytest.mark.parametrize("seed", range(8))
def test_redistribution_has_the_references_winners(seed: int, targets: int) -> None:
    index, squared = random_stacks(seed, targets)
    distance, claimed = (np.asarray(a) for a in unique(index, squared, targets))
    ours = {int(p): int(claimed[p]) for p in np.flatnonzero(distance < FAR)}
    assert ours == reference(index, squared)
    assert len(set(ours.values())) == len(ours)
    rank = np.argmax(index == claimed, axis=0)
    for point in ours:
        assert distance[point] == squared[rank[point], point]
    # a point left out has been refused by each of its candidates, for a closer point or an earlier equal one
    holder = {target: point for point, target in ours.items()}
    for point in set(range(COUNT)) - set(ours):
        for level in range(DEPTH):
            if squared[level, point] < FAR:
                winner = holder[int(index[level, point])]
                assert (distance[winner], winner) < (squared[level, point], point)


def test_redistribution_of_figure_2_20() -> None:
    """Three points want target 0; the closest keeps it, the next pops to 1, the last is pushed on to 2."""
    index = np.array([[0, 0, 0, 1], [1, 1, 1, 2]], np.int32)
    squared = np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 3.0, 6.0, 9.0]], np.float32)
    distance, claimed = (np.asarray(a) for a in jax.jit(_unique, static_argnums=2)(index, squared, 3))
    # point 1 takes target 1 from point 3, which pops to 2; point 2 has used up its stack
    np.testing.assert_array_equal(distance, np.array([1.0, 3.0, FAR, 9.0], np.float32))
    np.testing.assert_array_equal(claimed[[0, 1, 3]], [0, 1, 2])


def test_equal_points_share_nothing() -> None:
    """All points coincide: the first takes the nearest target, and so on down the stack; the rest stay unpaired."""
    index = np.tile(np.array([[7], [3], [5], [1]], np.int32), (1, COUNT))
    squared = np.tile(np.array([[0.0], [1.0], [1.0], [4.0]], np.float32), (1, COUNT))
    distance, claimed = (np.asarray(a) for a in unique(index, squared, 20))
    np.testing.assert_array_equal(claimed[:DEPTH], [7, 3, 5, 1])
    np.testing.assert_array_equal(distance[:DEPTH], [0, 1, 1, 4])
    np.testing.assert_array_equal(distance[DEPTH:], FAR)


class Scene(eqx.Module):
    """A target with both tables and a shifted source of 250 points padded to 256."""

    target: Any
    source: Any
    mask: Any
    fast: VoxelTable
    exact: VoxelTable
    clusters: Clusters


@pytest.fixture(scope="module")
def scene() -> Scene:
    rng = np.random.default_rng(0)
    target = rng.uniform(-1, 1, size=(300, 3)).astype(np.float32)
    source = np.zeros((256, 3), np.float32)
    source[:250] = rng.uniform(-1.1, 1.1, size=(250, 3))
    clusters = Clusters(jnp.full(3, -1.1, jnp.float32), jnp.float32(2.2 / 20))
    fast, exact = build_table(target, 48, 1), build_table(target, 32, 16)
    return Scene(target.T.copy(), source.T.copy(), np.arange(256) < 250, fast, exact, clusters)


@jax.jit
def _paired(scene: Scene, strategy: Strategy, max_distance: jax.Array) -> Pairs:
    return find_pairs(
        strategy, scene.fast, scene.exact, scene.target, scene.source, scene.mask, scene.clusters, max_distance
    )


def paired(scene: Scene, neighbourhood: float | None = None, max_distance: float = np.inf, **kind: Any) -> Pairs:
    arrays = eqx.tree_at(lambda s: [s.target, s.source, s.mask], scene, replace_fn=jnp.asarray)
    pairs = _paired(arrays, Strategy(neighbourhood=neighbourhood, **kind), jnp.float32(max_distance))
    return jax.tree.map(np.asarray, pairs)


KINDS = {
    "fast": {},
    "exact": {"exact": True},
    "stack": {"stack": 4},
    "unique": {"stack": 4, "unique": True},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("neighbourhood", [None, 1.0, 2.0])
def test_a_pair_is_what_it_says(scene: Scene, kind: str, neighbourhood: float | None) -> None:
    """Point and distance belong to the index; padding is never paired; the neighbourhood holds on every axis."""
    pairs = paired(scene, neighbourhood, **KINDS[kind])
    kept = pairs.kept
    assert 20 < kept.sum() <= 250
    assert not kept[250:].any()
    point = np.stack(pairs.point)
    np.testing.assert_array_equal(point, scene.target[:, pairs.index])
    np.testing.assert_allclose(pairs.distance[kept], np.linalg.norm(point - scene.source, axis=0)[kept], rtol=1e-5)
    assert np.all(pairs.distance[~kept] == 0)
    if neighbourhood is not None:
        own, other = (np.floor((a - -1.1) / np.float32(0.11)) for a in (scene.source, point))
        assert np.all(np.abs(own - other)[:, kept] <= neighbourhood)
    if kind == "unique":
        assert len(set(pairs.index[kept])) == kept.sum()


@pytest.mark.parametrize("neighbourhood", [None, 2.0])
def test_the_top_of_the_stack_is_the_nearest_in_the_neighbourhood(scene: Scene, neighbourhood: float | None) -> None:
    """Against the definition: of all target points whose cluster is near enough, the closest (oracle: brute force)."""
    pairs = paired(scene, neighbourhood, exact=True)
    own = np.floor((scene.source[:, :, None] + 1.1) / np.float32(0.11))
    other = np.floor((scene.target[:, None, :] + 1.1) / np.float32(0.11))
    distance = np.linalg.norm(scene.source[:, :, None] - scene.target[:, None, :], axis=0)
    allowed = np.ones_like(distance, bool)
    if neighbourhood is not None:
        allowed = np.all(np.abs(own - other) <= neighbourhood, axis=0)
    distance = np.where(allowed, distance, np.inf)[:250]
    has_pair = np.isfinite(distance.min(axis=1))
    # a table answers from its cell's candidates: nearly all the same, never closer than the closest
    assert np.mean(pairs.kept[:250] == has_pair) > 0.98
    both = pairs.kept[:250] & has_pair
    assert np.mean(pairs.index[:250][both] == np.argmin(distance, axis=1)[both]) > 0.98
    assert np.all(pairs.distance[:250][both] >= distance.min(axis=1)[both] * (1 - 1e-5))
    if neighbourhood is not None:
        assert 0.05 < np.mean(~has_pair) < 0.95


def test_no_pair_is_kept_outside_the_neighbourhood(scene: Scene) -> None:
    """A source far from everything has no pair at all under any strategy with a neighbourhood."""
    away = eqx.tree_at(lambda s: s.source, scene, scene.source + np.float32(50.0))
    for kind in KINDS.values():
        assert not paired(away, 2.0, **kind).kept.any()
        assert paired(away, None, **kind).kept.any()


@pytest.mark.parametrize("kind", KINDS)
def test_the_distance_limit(scene: Scene, kind: str) -> None:
    free, limited = (paired(scene, None, limit, **KINDS[kind]) for limit in (np.inf, 0.15))
    np.testing.assert_array_equal(limited.kept, free.kept & (free.distance <= 0.15))
    assert 10 < limited.kept.sum() < free.kept.sum()
    np.testing.assert_array_equal(limited.index, free.index)


def test_the_fast_pairs_are_nearly_the_nearest(scene: Scene) -> None:
    pairs = paired(scene)
    true, _ = KDTree(scene.target.T).query(scene.source.T)
    excess = (pairs.distance - true)[:250]
    assert excess.min() > -1e-6
    assert excess.max() <= np.sqrt(3) * scene.fast.cell


def test_a_used_up_stack_leaves_the_point_unpaired(scene: Scene) -> None:
    """Fifty copies of each point share four candidates: at most four of the fifty are paired."""
    crowd = eqx.tree_at(lambda s: s.source, scene, np.repeat(scene.source[:, :6], 50, axis=1)[:, :256].copy())
    pairs = paired(crowd, None, stack=4, unique=True)
    for group in range(5):
        assert pairs.kept[50 * group : 50 * group + 50].sum() <= 4
        assert pairs.kept[50 * group]  # the first of the equals keeps a pair
    assert len(set(pairs.index[pairs.kept])) == pairs.kept.sum()
