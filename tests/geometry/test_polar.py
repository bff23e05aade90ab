"""The polar factor is that of the SVD; the skew matrix is the cross product."""

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.polar import nearest_rotation, skew

nearest = jax.jit(jax.vmap(nearest_rotation))


def test_nearest_rotation_is_that_of_the_svd() -> None:  # oracle: numpy.linalg.svd
    rng = np.random.default_rng(0)
    R = Rotation.random(200, rng=rng).as_matrix()
    noise = rng.normal(size=R.shape) * np.geomspace(1e-12, 0.3, 200)[:, None, None]
    matrices = (R + noise) * np.geomspace(1e-30, 1e30, 200)[:, None, None]
    matrices = matrices[np.linalg.det(R + noise) > 0.05]
    U, _, Vt = np.linalg.svd(matrices)
    with jax.enable_x64(True):
        result = np.asarray(nearest(matrices))
    np.testing.assert_allclose(result, U @ Vt, atol=1e-14)


def test_a_rotation_stays_and_nonsense_stays_finite() -> None:
    R = Rotation.random(5, rng=np.random.default_rng(1)).as_matrix()
    with jax.enable_x64(True):
        np.testing.assert_allclose(np.asarray(nearest(R)), R, atol=1e-15)
        hollow = np.asarray(nearest(np.stack([np.zeros((3, 3)), -np.eye(3), np.diag([1.0, 1.0, 0.0])])))
    np.testing.assert_array_equal(hollow, np.broadcast_to(np.eye(3), (3, 3, 3)))


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(2).normal(size=(2, 7, 3))
    with jax.enable_x64(True):
        product = np.einsum("nij,nj->ni", np.asarray(jax.jit(skew)(a)), b)
    np.testing.assert_allclose(product, np.cross(a, b), atol=1e-15)
