"""The fits of one iteration: equal to the reference fits, exact where they can be, honest where they cannot."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.rigid_fit import METHODS, Method, fit_rigid, weighted_moments
from jaxmodel.register.estimation import Estimate, fit_point_to_plane, fit_point_to_point

SIZE = 64
point_to_point = jax.jit(
    lambda p, q, w, method: fit_point_to_point(weighted_moments(p, q, w), method), static_argnums=3
)
point_to_plane = jax.jit(fit_point_to_plane)


def cloud(seed: int, count: int = SIZE) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32)


@pytest.mark.parametrize("method", METHODS)
def test_point_to_point_is_the_reference_fit(method: Method) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        R, t = Rotation.random(None, rng).as_matrix(), rng.normal(size=3)
        source = cloud(seed)
        target = (source @ R.T + t + 0.05 * rng.normal(size=source.shape)).astype(np.float32)
        weights = rng.integers(0, 2, size=SIZE).astype(np.float32)
        fit: Estimate = point_to_point(source, target, weights, method)
        expected = fit_rigid(source.astype(np.float64), target.astype(np.float64), weights.astype(np.float64))
        assert bool(fit.determined)
        np.testing.assert_allclose(fit.rotation, expected[:3, :3], rtol=0, atol=2e-6)
        np.testing.assert_allclose(fit.translation, expected[:3, 3], rtol=0, atol=4e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["line", "point", "nothing", "two points"])
def test_point_to_point_says_what_it_cannot_determine(method: Method, name: str) -> None:
    points = {
        "line": np.linspace(-1, 1, SIZE, dtype=np.float32)[:, None] * np.array([0.36, 0.48, -0.8], np.float32),
        "point": np.ones((SIZE, 3), np.float32),
        "nothing": cloud(0),
        "two points": np.where(np.arange(SIZE)[:, None] % 2 == 0, cloud(1)[:1], cloud(1)[1:2]),
    }[name]
    weights = np.full(SIZE, 0.0 if name == "nothing" else 1.0, np.float32)
    assert not bool(point_to_point(points, points[:, [1, 2, 0]], weights, method).determined)


def plane_step(R, t, source, target, normal, weight) -> Estimate:
    moved = (R @ source.T + t[:, None]).astype(np.float32)
    q, n = (list(np.ascontiguousarray(a.T, np.float32)) for a in (target, normal))
    return point_to_plane(R.astype(np.float32), t.astype(np.float32), moved, q, n, weight.astype(np.float32))


def unit_normals(seed: int) -> np.ndarray:
    normals = np.random.default_rng(seed).normal(size=(SIZE, 3))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_point_to_plane_solves_its_linear_problem() -> None:
    """Oracle: numpy.linalg.lstsq in float64 on the same rows; the small turn is applied as a proper rotation."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        R, t = Rotation.random(None, rng).as_matrix(), rng.normal(size=3)
        source, normal = cloud(seed).astype(np.float64), unit_normals(seed)
        moved = source @ R.T + t
        target = moved + 0.01 * rng.normal(size=moved.shape)
        weight = rng.uniform(0, 1, SIZE) * (rng.uniform(size=SIZE) < 0.7)
        rows = np.concatenate([np.cross(moved, normal), normal], axis=1) * np.sqrt(weight)[:, None]
        right = np.sum(normal * (target - moved), axis=1) * np.sqrt(weight)
        omega, shift = np.split(np.linalg.lstsq(rows, right, rcond=None)[0], 2)
        fit = plane_step(R, t, source, target, normal, weight)
        length = np.linalg.norm(omega)
        turn = Rotation.from_rotvec(2 * np.arctan(length / 2) * omega / length).as_matrix()
        assert bool(fit.determined)
        np.testing.assert_allclose(fit.rotation, turn @ R, rtol=0, atol=3e-6)
        np.testing.assert_allclose(fit.translation, turn @ t + shift, rtol=0, atol=6e-6)


def test_point_to_plane_stays_at_the_answer_and_finds_it_quadratically() -> None:
    source, normal = cloud(3).astype(np.float64), unit_normals(3)
    R, t = Rotation.from_rotvec([0.5, -1.0, 0.3]).as_matrix(), np.array([0.2, -0.1, 0.4])
    target, weight = source @ R.T + t, np.ones(SIZE)
    fit = plane_step(R, t, source, target, normal, weight)
    np.testing.assert_allclose(fit.rotation, R, rtol=0, atol=2e-6)
    start_R, start_t = Rotation.from_rotvec([0.02, -0.03, 0.01]).as_matrix() @ R, t + np.array([0.02, 0.01, -0.02])
    errors = []
    for _ in range(3):
        fit = plane_step(start_R, start_t, source, target, normal, weight)
        start_R, start_t = np.asarray(fit.rotation, np.float64), np.asarray(fit.translation, np.float64)
        errors.append(np.abs(start_R - R).max() + np.abs(start_t - t).max())
    assert errors[0] < 5e-3
    assert errors[1] < 2e-5
    assert errors[2] < 5e-6
    np.testing.assert_allclose(start_R @ start_R.T, np.eye(3), atol=1e-6)


@pytest.mark.parametrize("name", ["one plane", "sphere", "cylinder", "nothing"])
def test_point_to_plane_says_what_it_cannot_determine(name: str) -> None:
    """A plane slides on itself, a sphere turns, a cylinder does both."""
    points = cloud(4).astype(np.float64)
    if name == "one plane":
        points[:, 2] = 0
        normal = np.tile([0.0, 0.0, 1.0], (SIZE, 1))
    elif name == "sphere":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        normal = points
    elif name == "cylinder":
        points[:, :2] /= np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        normal = points * [1, 1, 0]
    else:
        normal = unit_normals(4)
    weight = np.zeros(SIZE) if name == "nothing" else np.ones(SIZE)
    assert not bool(plane_step(np.eye(3), np.zeros(3), points, points + 0.01, normal, weight).determined)
