import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from reference_march import walk

from jaxmodel.plan.traversal import advance, enter, flat_index, inside, last_crossing, mirrored_ray

SHAPE = (7, 5, 9)
RAYS, LONGEST = 512, 24


@jax.jit
def _walked(origin, direction):
    """Keys and times along each ray, one voxel a step; -1 beyond the grid."""
    ray = mirrored_ray(tuple(origin), tuple(direction), SHAPE)
    place, on = enter(ray, SHAPE)

    def body(state, _):
        place, on = state
        told = jnp.where(on, flat_index(ray, place.index, SHAPE), -1), place.entered, last_crossing(ray, place.index)
        following = advance(ray, place, jnp.ones_like(place.entered))
        return (following, on & inside(following.index, SHAPE)), told

    return jax.lax.scan(body, (place, on), None, length=LONGEST)[1]


@jax.jit
def _leapt(origin, direction, steps, clear):
    """Where rays are after ``steps`` voxels and then a cube of ``clear``, and how far a step at a time leads."""
    ray = mirrored_ray(tuple(origin), tuple(direction), SHAPE)
    place, meets = enter(ray, SHAPE)
    one = jnp.ones_like(place.entered)

    def before(i, place):
        moved = advance(ray, place, one)
        return jax.tree.map(lambda new, old: jnp.where(i < steps, new, old), moved, place)

    place = jax.lax.fori_loop(0, 12, before, place)
    first = place.index

    def step(state):
        place, walking = state
        moved = advance(ray, place, one)
        place = jax.tree.map(lambda new, old: jnp.where(walking, new, old), moved, place)
        gone = [now - then for now, then in zip(place.index, first, strict=True)]
        return place, walking & (jnp.maximum(jnp.maximum(gone[0], gone[1]), gone[2]) < clear)

    slow, _ = jax.lax.while_loop(lambda state: jnp.any(state[1]), step, (place, one > 0))
    return advance(ray, place, clear), slow, meets


def _rays(kind: str, seed: int):
    """Origins and unit directions ``(3, RAYS)``, float32, of a hard sort."""
    rng = np.random.default_rng(seed)
    size = np.asarray(SHAPE)
    origin = rng.uniform(-6, 15, (RAYS, 3))
    target = rng.uniform(0, 1, (RAYS, 3)) * size
    if kind == "within":
        origin = rng.uniform(0, 1, (RAYS, 3)) * size
    if kind == "lattice":
        # through corners and edges, along planes between voxels
        origin, target = np.round(2 * origin) / 2, np.round(2 * target) / 2
    direction = target - origin
    if kind == "signs":
        signs = np.array([s for s in itertools.product((-1, 0, 1), repeat=3) if any(s)])
        direction = signs[np.arange(RAYS) % len(signs)].astype(float)
        origin = rng.integers(-3, 12, (RAYS, 3)) / np.array([1, 1, 2])
    if kind == "grazing":
        flat = rng.integers(0, 3, RAYS)
        direction[np.arange(RAYS), flat] = rng.choice([0, 1e-30, -1e-20, 1e-7, -1e-6], RAYS)
        origin[np.arange(RAYS), flat] = rng.integers(0, 1 + size[flat])
    if kind == "far":
        origin = target - 2000 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    direction[np.linalg.norm(direction, axis=1) == 0] = (0, 0, 1)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return origin.T.astype(np.float32), direction.T.astype(np.float32)


@pytest.mark.parametrize("kind", ["anywhere", "within", "lattice", "signs", "grazing", "far"])
def test_voxels_and_times_are_those_of_the_reference(kind):
    origin, direction = _rays(kind, 0)
    key, entered, again = (np.asarray(array) for array in _walked(origin, direction))
    met = 0
    for ray in range(RAYS):
        expected = [
            (np.ravel_multi_index(voxel, SHAPE), time)
            for voxel, time, _ in walk(origin[:, ray], direction[:, ray], SHAPE)
        ]
        found = [(k, t) for k, t in zip(key[:, ray], entered[:, ray], strict=True) if k >= 0]
        assert found == expected
        assert len(found) < LONGEST
        assert np.array_equal(again[: len(found), ray], entered[: len(found), ray])
        met += bool(expected)
    assert met > RAYS / 20


@pytest.mark.parametrize("kind", ["anywhere", "lattice", "signs", "grazing"])
def test_neighbours_in_a_row_share_a_face(kind):
    key, _, _ = (np.asarray(array) for array in _walked(*_rays(kind, 1)))
    both = (key[:-1] >= 0) & (key[1:] >= 0)
    here, there = (np.stack(np.unravel_index(k[both], SHAPE)) for k in (key[:-1], key[1:]))
    assert np.array_equal(np.abs(here - there).sum(axis=0), np.ones(both.sum()))


@pytest.mark.parametrize("kind", ["anywhere", "within", "lattice", "signs", "grazing"])
def test_a_leap_lands_where_single_steps_do(kind):
    rng = np.random.default_rng(2)
    steps, clear = rng.integers(0, 8, RAYS), rng.integers(1, 7, RAYS).astype(np.float32)
    leap, slow, meets = _leapt(*_rays(kind, 2), steps, clear)
    assert np.asarray(meets).sum() > RAYS / 20
    for fast, single in zip(jax.tree.leaves(leap), jax.tree.leaves(slow), strict=True):
        assert np.array_equal(np.asarray(fast)[meets], np.asarray(single)[meets])


def test_a_ray_past_the_grid_has_no_voxel():
    origin = np.array([[-1, 8, 3, 3], [6, 2, 2.5, -1], [1, 1, 10, 4]], np.float32)
    direction = np.array([[1, 1, 0, 0], [0, 0, 0, -1], [0, 0, 1, 0]], np.float32)
    origin, direction = np.tile(origin, RAYS // 4), np.tile(direction, RAYS // 4)
    assert (np.asarray(_walked(origin, direction)[0]) == -1).all()
