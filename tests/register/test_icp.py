"""One registration: exact recovery, equivariance, padding, filters, endings, and the trace."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.lanes import Engine, run
from jaxmodel.register import IcpMethod, Outcome, Registration, Strategy, register, register_trace
from jaxmodel.register.icp import Icp, IcpResult, Pose
from jaxmodel.register.methods import named, names
from jaxmodel.register.problem import prepare
from jaxmodel.scan.cloud import Cloud
from tests.register.conftest import Pair, moved, pose, small

METHODS = [*names(), "dual_quaternion", "svd"]


def method_of(name: str) -> IcpMethod:
    """A published method, or the thesis's with another fit."""
    if name in names():
        return named(name)
    return eqx.tree_at(lambda m: m.max_iterations, IcpMethod(fit=name, strategies=(Strategy(),)), 60)  # type: ignore


@pytest.mark.parametrize("name", METHODS)
def test_a_noise_free_motion_is_recovered_exactly(exact_pair: Pair, name: str) -> None:
    found = register(exact_pair.target, exact_pair.source, exact_pair.near, method_of(name))
    assert found.outcome == Outcome.CONVERGED
    np.testing.assert_allclose(found.T_target_source, exact_pair.T_target_source, rtol=0, atol=3e-6)
    assert found.error < 1e-6
    assert found.matched_fraction > 0.85  # Zhang's filter also cuts the tail of mere rounding
    assert found.shared_rate > 0.97
    R = found.T_target_source[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", names())
def test_the_exact_answer_is_a_fixed_point_and_stops(exact_pair: Pair, name: str) -> None:
    method = small(name)
    found = register(exact_pair.target, exact_pair.source, exact_pair.T_target_source, method)
    assert found.outcome == Outcome.CONVERGED
    assert found.steps <= 8 * len(method.strategies)
    np.testing.assert_allclose(found.T_target_source, exact_pair.T_target_source, rtol=0, atol=2e-6)


def test_a_cloud_registers_with_itself_at_the_identity(exact_pair: Pair) -> None:
    """Without a start the two scans share a frame already."""
    found = register(exact_pair.target, exact_pair.target, method=small("thesis_2005"))
    np.testing.assert_allclose(found.T_target_source, np.eye(4), rtol=0, atol=2e-6)
    assert found.shared_rate == 1.0


@pytest.mark.parametrize("name", ["thesis_2005", "chen_medioni_1991"])
@pytest.mark.parametrize("G", [pose((0.5, 1.5, -0.7), (5.0, 0, -3)), pose((0, 0, np.pi), (-1.0, 2, 0))])
def test_the_answer_moves_with_the_target_and_the_source(exact_pair: Pair, name: str, G: np.ndarray) -> None:
    """Target moved by G: G T. Source moved by G: T G^-1."""
    with_target = register(moved(G, exact_pair.target), exact_pair.source, G @ exact_pair.near, small(name))
    np.testing.assert_allclose(with_target.T_target_source, G @ exact_pair.T_target_source, rtol=0, atol=1e-5)
    inverse = np.linalg.inv(G)
    with_source = register(exact_pair.target, moved(G, exact_pair.source), exact_pair.near @ inverse, small(name))
    np.testing.assert_allclose(with_source.T_target_source, exact_pair.T_target_source @ inverse, rtol=0, atol=1e-5)


@pytest.mark.parametrize("name", ["thesis_2005", "chen_medioni_1991", "point_to_point"])
@pytest.mark.parametrize("scale", [1000.0, 1e-3])
def test_the_unit_of_length_does_not_matter(resampled_pair: Pair, name: str, scale: float) -> None:
    def scaled(T: np.ndarray) -> np.ndarray:
        return np.block([[T[:3, :3], scale * T[:3, 3:]], [T[3:]]])

    method = small(name)
    metre = register(resampled_pair.target, resampled_pair.source, resampled_pair.near, method)
    other = register(scale * resampled_pair.target, scale * resampled_pair.source, scaled(resampled_pair.near), method)
    assert other.outcome == metre.outcome
    np.testing.assert_allclose(other.T_target_source[:3, :3], metre.T_target_source[:3, :3], rtol=0, atol=1e-5)
    np.testing.assert_allclose(other.T_target_source[:3, 3] / scale, metre.T_target_source[:3, 3], rtol=0, atol=1e-5)
    assert other.error / scale == pytest.approx(metre.error, rel=1e-4)


def test_far_from_the_origin(resampled_pair: Pair) -> None:
    near, far = np.eye(4), pose((0, 0, 0), (2e4, -3e4, 1e4))
    results = [
        register(moved(G, resampled_pair.target), resampled_pair.source, G @ resampled_pair.near, small("thesis_2005"))
        for G in (near, far)
    ]
    back = np.linalg.inv(far) @ results[1].T_target_source
    np.testing.assert_allclose(back, results[0].T_target_source, rtol=0, atol=1e-5)


def run_kernel(kernel: Icp, frames, start: np.ndarray) -> IcpResult:
    R, t = frames.to_centred(start[None])
    return run(kernel, Pose(R, t), Engine("cores", chunk=2))


@pytest.mark.parametrize("name", ["thesis_2005_text", "chen_medioni_1991"])
def test_padding_changes_nothing(resampled_pair: Pair, name: str) -> None:
    """Half again as many entries, all padding and full of junk, give the same registration to rounding."""
    method = small(name)
    problem, frames = prepare(resampled_pair.target, resampled_pair.source, method)

    def longer(array: np.ndarray, junk: float) -> np.ndarray:
        return np.concatenate([array, np.full((*array.shape[:-1], 128), junk, array.dtype)], axis=-1)

    padded = eqx.tree_at(
        lambda p: [p.source, p.mask, p.target, p.target_mask, p.border],
        problem,
        [
            longer(np.asarray(problem.source), 7.0),
            longer(np.asarray(problem.mask), False),
            longer(np.asarray(problem.target), -7.0),
            longer(np.asarray(problem.target_mask), False),
            longer(np.asarray(problem.border), True),
        ],
    )
    if problem.normals is not None:
        padded = eqx.tree_at(lambda p: p.normals, padded, longer(np.asarray(problem.normals), 3.0))
    plain, more = (run_kernel(Icp(p, method), frames, resampled_pair.near) for p in (problem, padded))
    assert more.outcome == plain.outcome
    np.testing.assert_allclose(more.pose.rotation, plain.pose.rotation, rtol=0, atol=1e-5)
    np.testing.assert_allclose(more.pose.translation, plain.pose.translation, rtol=0, atol=1e-5)
    np.testing.assert_allclose(more.error, plain.error, rtol=1e-4)
    np.testing.assert_array_equal(more.shared_rate, plain.shared_rate)
    assert abs(float(more.matched_fraction[0] - plain.matched_fraction[0])) < 0.01


@eqx.filter_jit
def first_pairs(kernel: Icp, start: Pose, strategy: Strategy):
    pairs, limit = kernel.pairs(strategy, kernel.init(start))
    return pairs, limit, pairs.kept


def kept_pairs(
    target: np.ndarray | Cloud, source: np.ndarray, method: IcpMethod, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Target index, distance and kept flag of each source point in the first iteration, and Zhang's limit."""
    problem, frames = prepare(target, source, method)
    R, t = frames.to_centred(start[None])
    kernel = jax.tree.map(jnp.asarray, Icp(problem, method))
    pairs, limit, kept = first_pairs(kernel, Pose(jnp.asarray(R[0]), jnp.asarray(t[0])), method.strategies[0])
    return np.asarray(pairs.index), np.asarray(pairs.distance), np.asarray(kept), float(limit)


def test_the_border_filter_drops_pairs_with_border_points_and_no_others(resampled_pair: Pair) -> None:
    border = resampled_pair.target[:, 2] > 0.1
    target = Cloud(resampled_pair.target, border=border)
    plain = IcpMethod((Strategy(statistical_filter=False),), cells=48)
    with_filter = IcpMethod(plain.strategies, border_filter=True, cells=48)
    free = kept_pairs(target, resampled_pair.source, plain, resampled_pair.near)
    filtered = kept_pairs(target, resampled_pair.source, with_filter, resampled_pair.near)
    assert len(resampled_pair.source) == 250
    np.testing.assert_array_equal(filtered[0], free[0])
    expected = free[2] & ~np.append(border, np.zeros(256 - len(border), bool))[free[0]]
    np.testing.assert_array_equal(filtered[2], expected)
    assert 0 < filtered[2].sum() < free[2].sum() == 250


def test_zhangs_filter_keeps_the_pairs_below_its_limit(resampled_pair: Pair) -> None:
    method = IcpMethod(zhang=small("thesis_2005").zhang, cells=48)
    plain = kept_pairs(resampled_pair.target, resampled_pair.source, IcpMethod(cells=48), resampled_pair.near)
    filtered = kept_pairs(resampled_pair.target, resampled_pair.source, method, resampled_pair.near)
    limit = filtered[3]
    np.testing.assert_array_equal(filtered[2], plain[2] & (plain[1] <= limit))
    assert 0 < (~filtered[2])[:250].sum() < 100
    problem, _ = prepare(resampled_pair.target, resampled_pair.source, method)
    mean, sigma = plain[1][:250].mean(), plain[1][:250].std()
    D = float(problem.resolution)
    assert mean < D
    assert limit == pytest.approx(mean + 3 * sigma, rel=1e-4)


def at_shift(pair: Pair, shift: float) -> np.ndarray:
    return pose((0, 0, 0), (shift, 0, 0)) @ pair.near


@pytest.mark.parametrize("name", ["thesis_2005", "point_to_point", "chen_medioni_1991"])
def test_too_few_pairs_is_reported_and_the_pose_stays(exact_pair: Pair, name: str) -> None:
    start = at_shift(exact_pair, 50.0)
    found = register(exact_pair.target, exact_pair.source, start, small(name))
    assert found.outcome == Outcome.TOO_FEW_PAIRS
    assert found.outcome.sentence == "fewer than four pairs were left after rejection"
    assert found.steps == 1
    assert found.matched_fraction == 0.0
    assert found.shared_rate == 0.0
    assert found.error == np.inf
    np.testing.assert_allclose(found.T_target_source, start, rtol=0, atol=2e-5)


def test_a_start_beyond_float32_is_reported(exact_pair: Pair) -> None:
    found = register(exact_pair.target, exact_pair.source, at_shift(exact_pair, 1e39), small("point_to_point"))
    assert found.outcome == Outcome.NOT_FINITE
    assert found.error == np.inf


@pytest.mark.parametrize("name", ["point_to_point", "besl_mckay_1992", "chen_medioni_1991"])
def test_points_on_a_line_are_degenerate(name: str) -> None:
    line = np.linspace(-1, 1, 200)[:, None] ** 3 * np.array([0.6, 0.0, 0.8]) + [0, 3.0, 0]
    found = register(line, line, pose((0, 0.02, 0), (0, 0.01, 0)), small(name))
    assert found.outcome == Outcome.DEGENERATE
    assert found.outcome.sentence == "the kept pairs do not determine the motion"
    assert np.isfinite(found.T_target_source).all()


@pytest.mark.parametrize("limit", [1, 2])
def test_the_iteration_limit_is_reported(resampled_pair: Pair, limit: int) -> None:
    method = eqx.tree_at(lambda m: m.max_iterations, small("besl_mckay_1992"), limit)
    found = register(resampled_pair.target, resampled_pair.source, resampled_pair.near, method)
    assert (found.outcome, found.steps) == (Outcome.MAX_ITERATIONS, limit)


def test_a_stricter_stop_takes_longer(resampled_pair: Pair) -> None:
    slopes = [10.0, 1.0, 0.01]
    methods = [eqx.tree_at(lambda m: m.strategies[0].slope_percent, small("besl_mckay_1992"), s) for s in slopes]
    steps = [register(resampled_pair.target, resampled_pair.source, resampled_pair.near, m).steps for m in methods]
    assert steps == sorted(steps)
    assert steps[0] < steps[2]


def test_plain_icp_never_raises_its_squared_error() -> None:
    """Besl and McKay's theorem holds for exact pairs: the sum of squares falls in both halves of an iteration."""
    rng = np.random.default_rng(3)
    target, source = rng.normal(size=(250, 3)), rng.normal(size=(200, 3))
    method = IcpMethod((Strategy(exact=True, slope_percent=1e-4),), exact_cells=48, candidates=16, max_iterations=40)
    _, trace = register_trace(target, source, pose((0.1, 0.5, 0), (0.2, 0, 0)), method)
    squares = []
    for T in trace.T_target_source:
        p = moved(T, source)
        squares.append(np.min(np.sum((p[:, None] - target[None]) ** 2, axis=2), axis=1).sum())
    assert len(squares) > 5
    assert np.all(np.diff(squares) <= 1e-4 * squares[0])
    assert squares[-1] < 0.95 * squares[0]


@pytest.mark.parametrize("name", ["thesis_2005", "besl_mckay_1992"])
def test_the_trace_ends_where_the_registration_ends(resampled_pair: Pair, name: str) -> None:
    target, source, start = resampled_pair.target, resampled_pair.source, resampled_pair.near
    plain = register(target, source, start, small(name))
    traced, trace = register_trace(target, source, start, small(name))
    assert isinstance(traced, Registration)
    assert traced.outcome == plain.outcome
    np.testing.assert_allclose(traced.T_target_source, plain.T_target_source, rtol=0, atol=1e-5)
    assert (traced.steps, traced.switch_1, traced.switch_2) == (plain.steps, plain.switch_1, plain.switch_2)
    assert traced.error == pytest.approx(plain.error, rel=1e-3)
    assert {len(rows) for rows in (trace.error, trace.matched_fraction, trace.shared_rate, trace.strategy)} == {
        traced.steps
    }
    np.testing.assert_allclose(trace.T_target_source[0], start, rtol=0, atol=2e-6)
    assert np.all(np.diff(trace.strategy) >= 0)
    assert np.all((trace.matched_fraction > 0) & (trace.matched_fraction <= 1))
    assert np.all((trace.shared_rate > 0) & (trace.shared_rate <= 1))


def test_switches_and_increases_are_those_of_the_trace(resampled_pair: Pair) -> None:
    method = small("thesis_2005")
    traced, trace = register_trace(resampled_pair.target, resampled_pair.source, resampled_pair.near, method)
    assert traced.outcome == Outcome.CONVERGED
    assert trace.strategy.tolist() == sorted(trace.strategy) and set(trace.strategy) == {0, 1, 2}
    for number, switch in ((1, traced.switch_1), (2, traced.switch_2)):
        assert trace.strategy[switch] == number
        assert trace.strategy[switch - 1] == number - 1
    within = np.diff(trace.strategy) == 0
    assert traced.increases == np.sum((np.diff(trace.error) > 0) & within)


def test_the_shared_rate_is_that_of_the_clusters(resampled_pair: Pair) -> None:
    """Clusters with points of both clouds over clusters with points of either, in the joint box at the end."""
    method = small("thesis_2005")
    found = register(resampled_pair.target, resampled_pair.source, resampled_pair.near, method)
    target, source = resampled_pair.target, moved(found.T_target_source, resampled_pair.source)
    low = np.minimum(target.min(axis=0), source.min(axis=0))
    edge = (np.maximum(target.max(axis=0), source.max(axis=0)) - low).max() / method.clusters
    ours, theirs = ({tuple(c) for c in np.floor((p - low) / edge).astype(int)} for p in (source, target))
    # a point within rounding of a cluster's wall may fall on either side
    assert found.shared_rate == pytest.approx(len(ours & theirs) / len(ours | theirs), abs=0.01)


def test_partial_overlap_is_registered_by_the_thesis_method(resampled_pair: Pair) -> None:
    found = register(resampled_pair.target, resampled_pair.source, resampled_pair.near)
    p = resampled_pair.source
    off = moved(found.T_target_source, p) - moved(resampled_pair.T_target_source, p)
    assert np.linalg.norm(off, axis=1).max() < 0.05
