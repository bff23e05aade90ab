"""Three estimators, one contract: they agree, equal an oracle, recover exactly, and say what they cannot determine."""

from functools import lru_cache, partial
from typing import get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import FitOutcome, RigidFit, fit_rigid, rigid_fit
from jaxmodel.geometry.rigid_fit import Method, rotation_from_quaternion
from jaxmodel.geometry.se3 import rotation_angle_deg

METHODS = get_args(Method)
TOLERANCE = {np.float64: 1e-12, np.float32: 1e-5}
DTYPES = [np.float64, np.float32]
SIZE = 32


@lru_cache
def compiled(method: Method):
    return jax.jit(jax.vmap(partial(rigid_fit, method=method)))


def fit(source, target, weights, mask, method: Method, dtype: type) -> tuple[np.ndarray, FitOutcome]:
    """One problem padded with NaN to ``SIZE`` rows, so that every test runs one compiled program a method."""
    T, outcome = fit_batch(source[None], target[None], weights[None], mask[None], method, dtype)
    return T[0], FitOutcome(int(outcome[0]))


def fit_batch(source, target, weights, mask, method: Method, dtype: type) -> tuple[np.ndarray, np.ndarray]:
    batch, count = mask.shape
    p, q = (np.full((batch, SIZE, 3), np.nan, dtype) for _ in range(2))
    w, used = np.full((batch, SIZE), np.nan, dtype), np.zeros((batch, SIZE), bool)
    p[:, :count], q[:, :count], w[:, :count], used[:, :count] = source, target, weights, mask
    with jax.enable_x64(dtype is np.float64):
        result: RigidFit = compiled(method)(p, q, w, used)
        assert result.T_target_source.dtype == dtype
        return np.asarray(result.T_target_source), np.asarray(result.outcome)


def random_problem(seed: int, count: int, noise: float, dtype: type = np.float64):
    """A noisy weighted problem; float32 ones are rounded first, so that every method sees the same numbers."""
    rng = np.random.default_rng([seed, count])
    source = rng.normal(size=(count, 3)) * rng.uniform(0.5, 2.0, size=3)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(None, rng).as_matrix(), rng.uniform(-3, 3, size=3)
    target = source @ T[:3, :3].T + T[:3, 3] + noise * rng.normal(size=(count, 3))
    weights = rng.uniform(0.1, 2.0, size=count)
    return source.astype(dtype), target.astype(dtype), weights.astype(dtype), T


def oracle(source, target, weights) -> np.ndarray:
    """scipy's Rotation.align_vectors about the weighted means."""
    p, q, w = (np.asarray(a, np.float64) for a in (source, target, weights))
    p_mean, q_mean = np.average(p, axis=0, weights=w), np.average(q, axis=0, weights=w)
    T = np.eye(4)
    T[:3, :3] = Rotation.align_vectors(q - q_mean, p - p_mean, weights=w)[0].as_matrix()
    T[:3, 3] = q_mean - T[:3, :3] @ p_mean
    return T


problems = st.tuples(st.integers(0, 10**6), st.integers(6, SIZE), st.sampled_from([0.0, 1e-3, 0.1]))


@pytest.mark.parametrize("dtype", DTYPES)
@given(problem=problems)
def test_methods_agree_and_equal_the_oracle(dtype: type, problem: tuple[int, int, float]) -> None:
    source, target, weights, _ = random_problem(*problem, dtype=dtype)
    mask = np.ones(len(source), bool)
    expected = oracle(source, target, weights)
    for method in METHODS:
        T, outcome = fit(source, target, weights, mask, method, dtype)
        assert outcome == FitOutcome.OK
        np.testing.assert_allclose(T, expected, rtol=0, atol=TOLERANCE[dtype], err_msg=method)
        R = np.asarray(T[:3, :3], np.float64)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=20 * np.finfo(dtype).eps)
        assert np.linalg.det(R) > 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("angle", [0.0, 1e-6, 1.0, np.pi - 1e-6, np.pi])
def test_noise_free_motion_is_recovered(method: Method, dtype: type, angle: float) -> None:
    rng = np.random.default_rng(int(angle * 10))
    source = rng.normal(size=(12, 3))
    axis = rng.normal(size=3)
    R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    T, outcome = fit(source, source @ R.T + [0.3, -2, 1], rng.uniform(0.1, 1, 12), np.ones(12, bool), method, dtype)
    assert outcome == FitOutcome.OK
    precision = 50 * np.finfo(dtype).eps
    np.testing.assert_allclose(T[:3, :3], R, rtol=0, atol=precision)
    np.testing.assert_allclose(T[:3, 3], [0.3, -2, 1], rtol=0, atol=precision)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_three_points_and_plane_sets_suffice(method: Method, dtype: type) -> None:
    """Coplanar sets have a covariance of rank two: a mirror image fits as well, and must not be the answer."""
    for count in (3, 9):
        rng = np.random.default_rng(count)
        source = rng.normal(size=(count, 3)) * [1.0, 0.7, 0.0]
        R = Rotation.random(None, rng).as_matrix()
        T, outcome = fit(source, source @ R.T + 1.0, np.ones(count), np.ones(count, bool), method, dtype)
        assert outcome == FitOutcome.OK
        np.testing.assert_allclose(T[:3, :3], R, rtol=0, atol=100 * np.finfo(dtype).eps)


@pytest.mark.parametrize("method", METHODS)
def test_a_thin_set_is_still_determined(method: Method) -> None:
    rng = np.random.default_rng(1)
    source = rng.normal(size=(20, 3)) * [1.0, 1e-3, 1e-3]
    R = Rotation.random(None, rng).as_matrix()
    T, outcome = fit(source, source @ R.T, np.ones(20), np.ones(20, bool), method, np.float64)
    assert outcome == FitOutcome.OK
    np.testing.assert_allclose(T[:3, :3], R, rtol=0, atol=1e-8)


def batch_of(seeds: range) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    source, target, weights, _ = (np.stack(c) for c in zip(*(random_problem(i, 16, 0.02) for i in seeds), strict=True))
    return source, target, weights


@pytest.mark.parametrize("method", METHODS)
def test_a_mirrored_lane_is_repaired_alone(method: Method) -> None:
    source, target, weights = batch_of(range(4))
    mask = np.ones((4, 16), bool)
    before, _ = fit_batch(source, target, weights, mask, method, np.float64)
    target[1] = target[1] * [-1, 1, 1]  # the best orthogonal map is now a reflection
    after, outcome = fit_batch(source, target, weights, mask, method, np.float64)
    np.testing.assert_array_equal(after[[0, 2, 3]], before[[0, 2, 3]])
    np.testing.assert_array_equal(outcome, FitOutcome.OK)
    np.testing.assert_allclose(np.linalg.det(after[:, :3, :3]), 1.0, atol=1e-12)
    for lane in range(4):
        np.testing.assert_allclose(after[lane], oracle(source[lane], target[lane], weights[lane]), rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_degenerate_lane_does_not_touch_the_others(method: Method) -> None:
    source, target, weights = batch_of(range(4))
    mask = np.ones((4, 16), bool)
    before, _ = fit_batch(source, target, weights, mask, method, np.float64)
    source[0, 3], mask[2], target[3] = np.nan, False, target[3, 0]
    after, outcome = fit_batch(source, target, weights, mask, method, np.float64)
    assert outcome.tolist() == [FitOutcome.NOT_FINITE, FitOutcome.OK, FitOutcome.EMPTY, FitOutcome.COINCIDENT]
    np.testing.assert_array_equal(after[1], before[1])
    assert np.isnan(after[[0, 2, 3]]).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("junk", [np.nan, np.inf, -np.inf, 1e300, 0.0])
def test_entries_that_do_not_count_may_hold_anything(method: Method, junk: float) -> None:
    source, target, weights, _ = random_problem(3, 24, 0.1)
    counts = np.random.default_rng(0).uniform(size=24) < 0.6
    mask = np.ones(24, bool)
    clean, _ = fit(source, target, np.where(counts, weights, 0.0), mask, method, np.float64)
    np.testing.assert_allclose(clean, oracle(source[counts], target[counts], weights[counts]), rtol=0, atol=1e-12)
    source, target = (np.where(counts[:, None], points, junk) for points in (source, target))
    by_weight, outcome = fit(source, target, np.where(counts, weights, 0.0), mask, method, np.float64)
    assert outcome == FitOutcome.OK
    np.testing.assert_array_equal(by_weight, clean)
    by_mask, outcome = fit(source, target, np.where(counts, weights, junk), counts, method, np.float64)
    assert outcome == FitOutcome.OK
    np.testing.assert_array_equal(by_mask, clean)


def line(count: int, offset: float = 0.0) -> np.ndarray:
    direction = np.array([0.36, 0.48, -0.8])
    return offset + np.linspace(-1, 2, count)[:, None] ** 3 * direction


DEGENERATE = {
    "line": (line(10), FitOutcome.COLLINEAR),
    "two points": (np.repeat([[0.0, 1, 2], [3, 1, 0]], 4, axis=0), FitOutcome.COLLINEAR),
    "far line": (line(10, 1e4), FitOutcome.COLLINEAR),
    "one point": (np.array([[1.0, 2, 3]]), FitOutcome.COINCIDENT),
    "coincident": (np.full((8, 3), 0.1), FitOutcome.COINCIDENT),
    "far coincident": (np.full((8, 3), 1e5 / 3), FitOutcome.COINCIDENT),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", DEGENERATE)
def test_sets_that_determine_no_motion_are_reported(method: Method, dtype: type, name: str) -> None:
    points, expected = DEGENERATE[name]
    R = Rotation.from_euler("xyz", [0.3, 1.2, -2.0]).as_matrix()
    weights, mask = np.linspace(0.5, 1.5, len(points)), np.ones(len(points), bool)
    spread = np.random.default_rng(0).normal(size=points.shape)  # the other set is well spread: one bad set is enough
    for source, target in ((points, points @ R.T), (points, spread), (spread, points)):
        T, outcome = fit(source, target, weights, mask, method, dtype)
        assert outcome == expected
        assert np.isnan(T).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_empty_and_not_finite_sets_are_reported(method: Method, dtype: type) -> None:
    source, target, weights, _ = random_problem(5, 12, 0.1)
    every = np.ones(12, bool)
    assert fit(source, target, weights, ~every, method, dtype)[1] == FitOutcome.EMPTY
    assert fit(source, target, np.zeros(12), every, method, dtype)[1] == FitOutcome.EMPTY
    for bad in (np.nan, np.inf, -np.inf):
        for which in range(3):
            p, q, w = arrays = source.copy(), target.copy(), weights.copy()
            arrays[which][7] = bad
            T, outcome = fit(p, q, w, every, method, dtype)
            assert outcome == FitOutcome.NOT_FINITE
            assert np.isnan(T).all()
    negative = weights.copy()
    negative[2] = -1.0
    assert fit(source, target, negative, every, method, dtype)[1] == FitOutcome.NOT_FINITE


@pytest.mark.parametrize("method", METHODS)
def test_uncorrelated_sets_are_not_called_a_fit(method: Method) -> None:
    """Two cubes paired so that their covariance is exactly zero: every rotation fits equally well."""
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), -1).reshape(-1, 3)
    target = signs[:, [0, 1, 2]] * signs[:, [1, 2, 0]]
    np.testing.assert_array_equal(signs.T @ target, 0.0)
    for dtype in DTYPES:
        T, outcome = fit(signs, target, np.ones(8), np.ones(8, bool), method, dtype)
        assert outcome != FitOutcome.OK
        assert np.isnan(T).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("dtype", "distance"), [(np.float64, 1e6), (np.float32, 1e3)])
def test_far_from_the_origin(method: Method, dtype: type, distance: float) -> None:
    rng = np.random.default_rng(7)
    source = (rng.normal(size=(20, 3)) + distance * np.array([1, -1, 0.5])).astype(dtype)
    R = Rotation.from_rotvec([0.4, -0.2, 0.9]).as_matrix()
    target = (source.astype(np.float64) @ R.T + [distance, 0, 0] + 0.01 * rng.normal(size=(20, 3))).astype(dtype)
    weights = rng.uniform(0.5, 1.5, 20).astype(dtype)
    T, outcome = fit(source, target, weights, np.ones(20, bool), method, dtype)
    assert outcome == FitOutcome.OK
    expected = oracle(source, target, weights)
    rounding = np.finfo(dtype).eps * distance
    np.testing.assert_allclose(T[:3, :3], expected[:3, :3], rtol=0, atol=4 * rounding)
    # R p + t cancels two numbers of the size of the distance: compare where the points land
    landed = source.astype(np.float64) @ T[:3, :3].T.astype(np.float64) + T[:3, 3]
    np.testing.assert_allclose(landed, source @ expected[:3, :3].T + expected[:3, 3], rtol=0, atol=20 * rounding)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("scale", [1e3, 1e-3, 1e-6])
def test_the_unit_of_length_does_not_matter(method: Method, dtype: type, scale: float) -> None:
    source, target, weights, _ = random_problem(11, 20, 0.05, dtype)
    every = np.ones(20, bool)
    metre, _ = fit(source, target, weights, every, method, dtype)
    other, outcome = fit(source * dtype(scale), target * dtype(scale), weights, every, method, dtype)
    assert outcome == FitOutcome.OK
    np.testing.assert_allclose(other[:3, :3], metre[:3, :3], rtol=0, atol=TOLERANCE[dtype])
    np.testing.assert_allclose(other[:3, 3] / scale, metre[:3, 3], rtol=0, atol=TOLERANCE[dtype])


@pytest.mark.parametrize("method", METHODS)
def test_the_fit_moves_with_the_data(method: Method) -> None:
    """Moving the target by G turns T into G T; swapping the sets inverts T; the order of pairs is nothing."""
    source, target, weights, _ = random_problem(13, 20, 0.1)
    every = np.ones(20, bool)
    T, _ = fit(source, target, weights, every, method, np.float64)
    _, _, _, G = random_problem(14, 20, 0.0)
    moved, _ = fit(source, target @ G[:3, :3].T + G[:3, 3], weights, every, method, np.float64)
    np.testing.assert_allclose(moved, G @ T, rtol=0, atol=1e-12)
    swapped, _ = fit(target, source, weights, every, method, np.float64)
    np.testing.assert_allclose(swapped @ T, np.eye(4), rtol=0, atol=1e-12)
    order = np.random.default_rng(0).permutation(20)
    shuffled, _ = fit(source[order], target[order], weights[order], every, method, np.float64)
    np.testing.assert_allclose(shuffled, T, rtol=0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_no_nearby_motion_is_better(method: Method) -> None:
    source, target, weights, _ = random_problem(17, 20, 0.3)
    T, _ = fit(source, target, weights, np.ones(20, bool), method, np.float64)

    def cost(pose: np.ndarray) -> float:
        return float(weights @ np.sum((target - source @ pose[:3, :3].T - pose[:3, 3]) ** 2, axis=1))

    for seed in range(20):
        rng = np.random.default_rng(seed)
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(1e-3 * rng.normal(size=3)).as_matrix()
        step[:3, 3] = 1e-3 * rng.normal(size=3)
        assert cost(step @ T) > cost(T)


def test_host_function_keeps_precision_and_weights() -> None:
    source, target, weights, truth = random_problem(19, 30, 0.0)
    T = fit_rigid(source, target, weights)
    assert T.dtype == np.float64
    np.testing.assert_allclose(T, truth, atol=1e-14)
    single = fit_rigid(source.astype(np.float32), target.astype(np.float32), method="quaternion")
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, truth, atol=5e-6)
    assert rotation_angle_deg(np.asarray(T[:3, :3].T @ truth[:3, :3])) < 1e-6


def test_host_function_refuses_with_a_sentence() -> None:
    source, target, weights, _ = random_problem(23, 30, 0.1)
    with pytest.raises(ValueError, match="on a line"):
        fit_rigid(line(5), line(5))
    with pytest.raises(ValueError, match="coincide"):
        fit_rigid(np.ones((5, 3)), np.ones((5, 3)))
    with pytest.raises(ValueError, match="no pair carries weight"):
        fit_rigid(np.zeros((0, 3)), np.zeros((0, 3)))
    with pytest.raises(ValueError, match="not finite"):
        fit_rigid(source, np.where(target > 0, target, np.nan))
    with pytest.raises(ValueError, match=r"both be \(n, 3\)"):
        fit_rigid(source[:5], target)
    with pytest.raises(ValueError, match=r"both be \(n, 3\)"):
        fit_rigid(source[:, :2], target[:, :2])
    with pytest.raises(ValueError, match="weights must be"):
        fit_rigid(source, target, weights[:4])


def test_inside_jit_a_degenerate_problem_gives_nan() -> None:
    points = jnp.asarray(line(5), jnp.float32)
    assert np.isnan(jax.jit(fit_rigid)(points, points)).all()


def test_rotation_from_quaternion_is_scipys() -> None:  # oracle
    for rotation in Rotation.random(10, np.random.default_rng(2)):
        q = rotation.as_quat(scalar_first=True).astype(np.float32)
        np.testing.assert_allclose(rotation_from_quaternion(jnp.asarray(q)), rotation.as_matrix(), atol=5e-7)
