from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.plan.label_map import object_map
from jaxmodel.plan.map_update import update
from jaxmodel.plan.ray_march import in_cells, look
from jaxmodel.plan.soft_march import soft_rays, soft_ready, soft_shares
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh

SENSOR = Sensor(32, 32, field_of_view_deg=40.0)
MANY = jax.jit(lambda space, poses, rays: jax.lax.map(lambda pose: soft_shares(space, pose, rays), poses))


def _moved(pose, x):
    """A pose turned by two small angles and shifted by three lengths (cells x 64)."""
    a, b = x[0], x[1]
    one, zero = jnp.ones_like(a), jnp.zeros_like(a)
    pan = jnp.stack([jnp.cos(a), zero, jnp.sin(a), zero, one, zero, -jnp.sin(a), zero, jnp.cos(a)]).reshape(3, 3)
    tilt = jnp.stack([one, zero, zero, zero, jnp.cos(b), -jnp.sin(b), zero, jnp.sin(b), jnp.cos(b)]).reshape(3, 3)
    return pose.at[:3, :3].set(pose[:3, :3] @ pan @ tilt).at[:3, 3].add(64 * x[2:])


@jax.jit
def _value(space, pose, rays, x):
    seen = soft_shares(space, _moved(pose, x), rays)
    return jnp.concatenate([seen.shares, seen.cosines])


_slope = jax.jit(lambda space, pose, rays: jax.jacfwd(_value, 3)(space, pose, rays, jnp.zeros(5, pose.dtype)))


@pytest.fixture(scope="module")
def scenes():
    found = []
    rng = np.random.default_rng(1)
    for name in ("valve", "boulder", "block_steps"):
        mesh = object_mesh(name)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        size = 2 * np.linalg.norm(vertices - centre, axis=1).max()
        sensor = Sensor(160, 160, field_of_view_deg=40.0)
        away = rng.normal(size=(20, 3))
        poses = np.stack([look_at(centre + 2 * size * e / np.linalg.norm(e), centre) for e in away])
        map = object_map(centre, size)
        for count, T in enumerate(poses[:4], 1):
            map = update(map, scan_mesh(vertices, faces, sensor, T), T, sensor)
            if count in (1, 4):
                found.append((map, soft_ready(map), poses[4:]))
    return found


def test_shares_and_cosines_agree_with_the_exact_march(scenes):
    errors, cosines = [], []
    for map, space, poses in scenes:
        exact = look(map, poses, SENSOR)
        soft = MANY(space, jnp.asarray(in_cells(map, poses)), soft_rays(map, SENSOR))
        errors.append(np.abs(np.asarray(soft.shares) - exact.shares))
        cosines.append(np.abs(np.asarray(soft.cosines) - exact.cosines / exact.total))
        assert np.asarray(soft.lost).max() < 0.01
    assert np.concatenate(errors).mean(axis=0).max() <= 0.01
    assert np.concatenate(errors).max() <= 0.03
    assert np.concatenate(cosines).max() <= 0.03


def test_gradient_is_that_of_the_function(scenes):
    """Float32 derivatives against central differences in float64, relative to the largest derivative of the view."""
    off = []
    for map, space, poses in scenes:
        rays = soft_rays(map, SENSOR)
        for pose in in_cells(map, poses[:8]):
            slope = np.asarray(_slope(space, jnp.asarray(pose), rays))
            with jax.enable_x64(True):
                exact, step = jnp.asarray(pose, jnp.float64), 1e-6
                value = partial(_value, space, exact, rays)
                unit = step * np.eye(5)
                difference = np.stack(
                    [np.asarray(value(jnp.asarray(u)) - value(jnp.asarray(-u))) / (2 * step) for u in unit], axis=1
                )
            off.append(np.abs(slope - difference).max() / np.abs(difference).max())
    assert np.mean(np.asarray(off) <= 1e-3) >= 0.99, np.sort(off)[-5:]


def test_hard_poses_have_finite_gradients(scenes):
    map, space, _ = scenes[1]
    rays = soft_rays(map, SENSOR)
    inside, missing = np.eye(4), np.eye(4)
    inside[:3, 3], missing[:3, 3] = 32.0, (32.0, 32.0, 200.0)
    along, corner = np.eye(4), np.eye(4)
    along[:3, 3], corner[:3, 3] = (32.0, 32.0, -100.0), 0.0
    flat = jax.tree.map(lambda a: a, rays)
    parallel = flat.directions.at[:].set(jnp.asarray([[0.0], [0.0], [1.0]]))
    for pose in (inside, missing, along, corner):
        for r in (rays, type(rays)(rays.origins, parallel, rays.nearest, rays.farthest)):
            slope = _slope(space, jnp.asarray(pose, jnp.float32), r)
            assert np.isfinite(np.asarray(slope)).all()
    assert not np.asarray(MANY(space, jnp.asarray(missing, jnp.float32)[None], rays).shares).any()


def test_a_batch_is_its_views(scenes):
    map, space, poses = scenes[0]
    rays, items = soft_rays(map, SENSOR), jnp.asarray(in_cells(map, poses[:3]))
    batch = jax.jit(jax.vmap(lambda pose: soft_shares(space, pose, rays)))(items)
    single = MANY(space, items, rays)
    np.testing.assert_allclose(batch.shares, single.shares, atol=2e-5)
