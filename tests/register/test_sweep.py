"""A sweep: each start's result is its own, to the last bit, and the best of them is chosen by rule."""

import dataclasses

import equinox as eqx
import jax
import numpy as np
import pytest

from jaxmodel import lanes
from jaxmodel.errors import InputError
from jaxmodel.geometry.se3 import rotation_angle_deg
from jaxmodel.lanes import Engine
from jaxmodel.register import IcpMethod, Outcome, Strategy, Sweep, register, sweep, sweep_chunks
from jaxmodel.register.problem import prepare
from jaxmodel.register.starts import even_starts
from jaxmodel.register.sweep import sweep_prepared
from tests.register.conftest import Pair, moved, small

THESIS = small("thesis_2005")
FIELDS = list(Sweep.__dataclass_fields__)


def limited(name: str, iterations: int) -> IcpMethod:
    return eqx.tree_at(lambda m: m.max_iterations, small(name), iterations)


def assert_same(a: Sweep, b: Sweep) -> None:
    for field in FIELDS:
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)


def gathered(chunks, count: int) -> Sweep:
    """Chunks in any order, back in start order."""
    parts = list(chunks)
    members = np.concatenate([m for _, m, _ in parts])
    assert sorted(members) == list(range(count))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[np.argsort(members)], *(part for _, _, part in parts))


@pytest.fixture(scope="module")
def starts(resampled_pair: Pair) -> np.ndarray:
    return even_starts(resampled_pair.target, resampled_pair.source, 40)


@pytest.fixture(scope="module")
def whole(resampled_pair: Pair, starts: np.ndarray) -> Sweep:
    return sweep(resampled_pair.target, resampled_pair.source, starts, THESIS, chunk=40)


def test_results_are_in_start_order_and_complete(resampled_pair: Pair, starts: np.ndarray, whole: Sweep) -> None:
    assert len(whole) == 40
    assert whole.T_target_source.dtype == np.float64
    R = whole.T_target_source[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (40, 1, 1)), rtol=0, atol=1e-14)
    assert set(whole.outcome) <= {int(o) for o in Outcome}
    assert np.all((whole.matched_fraction >= 0) & (whole.matched_fraction <= 1))
    assert np.all((whole.shared_rate >= 0) & (whole.shared_rate <= 1))
    converged = whole.outcome == Outcome.CONVERGED
    assert converged.sum() > 20
    assert np.all(whole.switch_1[converged] < whole.switch_2[converged])
    assert np.all(whole.switch_2[converged] < whole.steps[converged])
    one = whole.registration(7)
    assert one.start == 7 and isinstance(one.outcome, Outcome)
    assert (one.error, one.steps) == (whole.error[7], whole.steps[7])


@pytest.mark.parametrize("chunk", [16, 40, 7])
def test_order_and_chunks_do_not_change_a_bit(
    resampled_pair: Pair, starts: np.ndarray, whole: Sweep, chunk: int
) -> None:
    order = np.random.default_rng(1).permutation(40)
    chunks = sweep_chunks(resampled_pair.target, resampled_pair.source, starts, THESIS, chunk=chunk, order=order)
    assert_same(gathered(chunks, 40), whole)


def test_a_start_alone_gives_the_same_to_the_last_bit(resampled_pair: Pair, starts: np.ndarray, whole: Sweep) -> None:
    for number in (0, 17, 39):
        alone = register(resampled_pair.target, resampled_pair.source, starts[number], THESIS)
        np.testing.assert_array_equal(alone.T_target_source, whole.T_target_source[number])
        ours = [getattr(alone, field) for field in FIELDS[1:]]
        assert ours == [getattr(whole, field)[number] for field in FIELDS[1:]]


def test_the_same_starts_twice_give_the_same_rows(resampled_pair: Pair, starts: np.ndarray, whole: Sweep) -> None:
    twice = sweep(resampled_pair.target, resampled_pair.source, np.tile(starts, (2, 1, 1)), THESIS, chunk=40)
    assert_same(jax.tree.map(lambda a: a[:40], twice), whole)
    assert_same(jax.tree.map(lambda a: a[40:], twice), whole)


def test_chunks_already_done_are_skipped(resampled_pair: Pair, starts: np.ndarray, whole: Sweep) -> None:
    chunks = sweep_chunks(
        resampled_pair.target, resampled_pair.source, starts, THESIS, chunk=16, skip=frozenset({0, 2})
    )
    ((number, members, part),) = list(chunks)
    assert number == 1
    np.testing.assert_array_equal(members, np.arange(16, 32))
    assert_same(part, jax.tree.map(lambda a: a[16:32], whole))


@pytest.mark.parametrize("chunk", [10, 24])
def test_lanes_do_not_depend_on_order_and_chunks(resampled_pair: Pair, starts: np.ndarray, chunk: int) -> None:
    pair, method = resampled_pair, limited("point_to_point", 30)
    straight = sweep(pair.target, pair.source, starts[:24], method, lanes=8, chunk=24)
    order = np.random.default_rng(2).permutation(24)
    shuffled = sweep_chunks(pair.target, pair.source, starts[:24], method, lanes=8, chunk=chunk, order=order)
    assert_same(gathered(shuffled, 24), straight)


def same_basin(a: Sweep, b: Sweep, size: float) -> np.ndarray:
    """Where two sweeps end within 5 degrees and 5 % of the target's size of one another."""
    turned = rotation_angle_deg(np.swapaxes(a.T_target_source[:, :3, :3], 1, 2) @ b.T_target_source[:, :3, :3])
    shifted = np.linalg.norm(a.T_target_source[:, :3, 3] - b.T_target_source[:, :3, 3], axis=1)
    return (turned < 5.0) & (shifted < 0.05 * size) & (a.outcome == b.outcome)


def assert_executors_agree(pair: Pair, method: IcpMethod) -> None:
    """Cores, 64 and 256 lanes: the same basin for 99.5 % of 400 starts, and there the same pose to 1e-5 (median)."""
    centred = Pair(pair.target - pair.target.mean(axis=0), pair.source - pair.source.mean(axis=0), np.eye(4), np.eye(4))
    size = float(np.linalg.norm(np.ptp(pair.target, axis=0)))
    starts = even_starts(centred.target, centred.source, 400)
    runs = [sweep(centred.target, centred.source, starts, method, lanes=n, chunk=400) for n in (None, 64, 256)]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        same = same_basin(runs[a], runs[b], size)
        assert same.mean() >= 0.995
        difference = np.abs(runs[a].T_target_source - runs[b].T_target_source).max(axis=(1, 2))[same]
        assert np.mean(difference < 1e-5) >= 0.995
        assert np.median(difference) < 2e-6


def test_executors_agree_on_the_plain_method(exact_pair: Pair) -> None:
    assert_executors_agree(exact_pair, limited("point_to_point", 40))


@pytest.mark.slow
def test_executors_agree_on_the_thesis_method(exact_pair: Pair) -> None:
    assert_executors_agree(exact_pair, limited("thesis_2005", 60))


@pytest.mark.parametrize("fit", ["svd", "dual_quaternion"])
def test_the_other_fits_end_in_the_same_place(resampled_pair: Pair, starts: np.ndarray, fit: str) -> None:
    pair, plain = resampled_pair, IcpMethod((Strategy(slope_percent=0.1),), max_iterations=25, cells=48)
    other = dataclasses.replace(plain, fit=fit)
    a, b = (sweep(pair.target, pair.source, starts[:16], m, chunk=16) for m in (plain, other))
    difference = np.abs(a.T_target_source - b.T_target_source).max(axis=(1, 2))
    assert np.mean(difference < 1e-4) >= 0.9


def test_one_compilation_whatever_the_values(resampled_pair: Pair, exact_pair: Pair, starts: np.ndarray) -> None:
    """A second sweep with other numbers, other clouds of the size class and another count compiles nothing."""
    pair = resampled_pair
    method = limited("point_to_point", 20)
    programs = lanes._cores(len(jax.devices()), True)
    sweep(pair.target, pair.source, starts, method, chunk=16)
    compiled = programs._cache_size()
    for field, value in (
        ("max_iterations", 7),
        ("max_distance", 0.4),
        ("rotation_tolerance_deg", 1.0),
        ("translation_tolerance", 1e-3),
    ):
        sweep(pair.target, pair.source, starts[:5], dataclasses.replace(method, **{field: value}), chunk=16)
    sweep(exact_pair.target[:231], exact_pair.source[:190], starts[:33], method, chunk=16)
    assert programs._cache_size() == compiled
    sweep(pair.target, pair.source, starts[:2], dataclasses.replace(method, border_filter=True), chunk=16)
    assert programs._cache_size() == compiled + 1  # a flag is another program: the count does count


def test_one_trace_a_kernel_over_a_whole_sweep(
    monkeypatch: pytest.MonkeyPatch, resampled_pair: Pair, starts: np.ndarray
) -> None:
    """Five chunks, three values of an option in each strategy: the step is traced for the first chunk alone."""
    from jaxmodel.register.icp import Icp

    traces = []
    step = Icp.step

    def counted(self, state):
        traces.append(1)
        return step(self, state)

    monkeypatch.setattr(Icp, "step", counted)
    pair, first = resampled_pair, 0
    for slope in (0.5, 2.0, 5.0):
        method = dataclasses.replace(limited("thesis_2005", 3), clusters=11)  # a program no other test compiles
        method = eqx.tree_at(lambda m: [s.slope_percent for s in m.strategies], method, [slope] * 3)
        for number, _, _ in sweep_chunks(pair.target, pair.source, starts, method, chunk=8):
            if number == 0 and slope == 0.5:
                first = len(traces)
    assert 0 < first <= 3
    assert len(traces) == first


def test_a_sweep_finds_the_motion_without_a_guess(exact_pair: Pair) -> None:
    pair = exact_pair
    found = sweep(pair.target, pair.source, even_starts(pair.target, pair.source, 120), THESIS, chunk=40)
    best = found.best
    off = moved(best.T_target_source, pair.source) - moved(pair.T_target_source, pair.source)
    assert np.linalg.norm(off, axis=1).max() < 1e-5
    assert best.error == found.error[best.start] < 1e-6


def made(error: list[float], matched: list[float]) -> Sweep:
    count = len(error)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3] = np.arange(count)
    whole = np.zeros(count, np.int32)
    return Sweep(poses, np.array(error), np.array(matched), np.ones(count), whole, whole, whole, whole, whole)


@pytest.mark.parametrize(
    ("error", "matched", "expected"),
    [
        ([3.0, 1.0, 2.0], [1.0, 1.0, 1.0], 1),  # lowest error
        ([3.0, 1.0, 2.0], [1.0, 0.49, 0.6], 2),  # unless it matches less than half of the most
        ([3.0, 1.0, 2.0], [0.8, 0.4, 0.6], 1),  # exactly half will do
        ([3.0, 0.1, 0.2], [0.3, 0.01, 0.1], 0),  # half of the sweep's largest, not of all points
        ([2.0, 1.0, 1.0], [1.0, 1.0, 1.0], 1),  # the first of equals
        ([np.inf, 5.0], [0.0, 0.9], 1),
    ],
)
def test_the_best_start(error: list[float], matched: list[float], expected: int) -> None:
    best = made(error, matched).best
    assert best.start == expected
    assert best.error == error[expected]
    assert best.T_target_source[0, 3] == expected


def test_the_best_of_nothing_is_still_an_answer() -> None:
    best = made([np.inf, np.inf], [0.0, 0.0]).best
    assert (best.start, best.error) == (0, np.inf)


def broken(T: np.ndarray, fault: str) -> np.ndarray:
    T = T.copy()
    if fault == "mirror":
        T[:3, 0] *= -1
    elif fault == "scale":
        T[:3, :3] *= 2
    elif fault == "nan":
        T[1, 3] = np.nan
    elif fault == "infinite":
        T[2, 3] = np.inf
    else:
        T[3] = [0, 0, 1, 1]
    return T


@pytest.mark.parametrize("fault", ["mirror", "scale", "nan", "infinite", "bottom row"])
def test_starts_that_are_no_motion_are_named(exact_pair: Pair, starts: np.ndarray, fault: str) -> None:
    bad = np.concatenate([starts[:3], broken(starts[3], fault)[None], starts[4:]])
    with pytest.raises(InputError, match="start 3 is not a rigid motion"):
        sweep(exact_pair.target, exact_pair.source, bad)
    with pytest.raises(InputError, match="start 0 is not a rigid motion"):
        register(exact_pair.target, exact_pair.source, broken(starts[3], fault))


def test_no_starts_are_refused(exact_pair: Pair) -> None:
    with pytest.raises(InputError, match=r"starts must be \(s, 4, 4\) with s at least 1, not \(0, 4, 4\)"):
        sweep(exact_pair.target, exact_pair.source, np.ones((0, 4, 4)))


def test_bad_clouds_and_methods_are_refused(exact_pair: Pair, starts: np.ndarray) -> None:
    dirty = exact_pair.source.copy()
    dirty[11, 1] = np.nan
    with pytest.raises(InputError, match="the source: point 11 "):
        sweep(exact_pair.target, dirty, starts)
    with pytest.raises(InputError, match="the target is empty"):
        sweep(np.zeros((0, 3)), exact_pair.source, starts)
    with pytest.raises(InputError, match="unknown method 'icp'"):
        sweep(exact_pair.target, exact_pair.source, starts, "icp")


def test_lanes_and_chunks_may_be_any_positive_number(exact_pair: Pair, starts: np.ndarray) -> None:
    for name, value in (("chunk", 0), ("lanes", 0), ("lanes", -2)):
        with pytest.raises(ValueError, match=f"{name} must be at least 1, not {value}"):
            sweep(exact_pair.target, exact_pair.source, starts, "point_to_point", **{name: value})  # type: ignore
    given = Engine("cores", chunk=3)
    three = sweep(exact_pair.target, exact_pair.source, starts[:4], limited("point_to_point", 5), engine=given)
    assert len(three) == 4


def test_a_pair_made_ready_once_gives_the_same_sweep(resampled_pair: Pair, starts: np.ndarray, whole: Sweep) -> None:
    ready, engine = prepare(resampled_pair.target, resampled_pair.source, THESIS), Engine("cores", chunk=40)
    assert_same(gathered(sweep_prepared(ready, starts, THESIS, engine), 40), whole)
    (chunk,) = sweep_prepared(ready, starts[:7], THESIS, engine)
    assert_same(chunk[2], jax.tree.map(lambda leaf: leaf[:7], whole))
