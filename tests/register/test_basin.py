"""The convergence atlas: rates, basins, and the plateau found without the truth."""

from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

from jaxmodel.register import Outcome, Sweep, basin, sweep
from jaxmodel.register.starts import euler_starts, even_starts
from jaxmodel.scan.cloud import Cloud

CENTROID, SIZE = np.array([1.0, -2.0, 5.0]), 2.0


def made_sweep(rotvecs: np.ndarray, shifts: np.ndarray, error: np.ndarray, matched: np.ndarray | None = None) -> Sweep:
    """A sweep whose poses turn by ``rotvecs`` and put the source's centroid at CENTROID + ``shifts``."""
    count = len(error)
    T = np.tile(np.eye(4), (count, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(rotvecs).as_matrix()
    T[:, :3, 3] = CENTROID + shifts - T[:, :3, :3] @ CENTROID
    whole = np.zeros(count, np.int32)
    matched = np.ones(count) if matched is None else matched
    return Sweep(T, error.astype(float), matched, matched, whole, whole, whole, whole, whole + Outcome.CONVERGED)


def two_basins(low: int, high: int, gap: float, seed: int = 0) -> Sweep:
    """``low`` starts at one pose with error 1, ``high`` scattered ones with error ``gap`` and more."""
    draw = np.random.default_rng(seed)
    near = draw.normal(scale=0.005, size=(low, 3))
    far = Rotation.from_rotvec(draw.normal(loc=(3.0, 0.0, 0.0), scale=2.0, size=(high, 3))).as_rotvec()
    error = np.concatenate([1 + 0.01 * draw.random(low), gap * 1.01 + draw.random(high)])
    shifts = np.concatenate([near, draw.normal(scale=SIZE, size=(high, 3)) + 2 * SIZE])
    order = draw.permutation(low + high)
    return made_sweep(np.concatenate([near, far])[order], shifts[order], error[order])


@pytest.mark.parametrize(("count", "total"), [(0, 10), (35, 1000), (150, 1000), (10, 10)])
def test_wilson_interval_is_scipys(count: int, total: int) -> None:
    found = basin.success(np.arange(total) < count)
    oracle = binomtest(count, total).proportion_ci(0.95, "wilson")
    assert (found.count, found.total, found.rate) == (count, total, count / total)
    np.testing.assert_allclose([found.low, found.high], [oracle.low, oracle.high], atol=1e-12)


def test_an_empty_sweep_has_no_rate() -> None:
    with pytest.raises(ValueError, match="at least one start"):
        basin.success(np.zeros(0, bool))


def test_truth_errors_are_measured_at_the_centroid() -> None:
    angle = np.radians(4.0)
    turns, shifts = np.array([[0, 0, 0], [0, 0, angle], [0, angle, 0]]), np.array([[0.3, 0, 0], [0, 0, 0], [0, 0, 0.1]])
    made = made_sweep(turns, shifts, np.ones(3))
    errors = basin.truth_errors(made.T_target_source, np.eye(4), CENTROID)
    np.testing.assert_allclose(errors.rotation_deg, [0, 4, 4], atol=1e-9)
    np.testing.assert_allclose(errors.translation, [0.3, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(errors.quaternion, [0, *[2 * np.sin(angle / 4)] * 2], atol=1e-12)
    assert basin.right(errors, 5.0, 0.2).tolist() == [False, True, True]


def test_a_pose_that_is_not_finite_is_never_right() -> None:
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1] = np.nan
    errors = basin.truth_errors(T, np.eye(4), CENTROID)
    assert basin.right(errors, 180.0, 1e9).tolist() == [True, False]
    assert basin.labels(T, np.array([1.0, np.nan]), CENTROID, SIZE).tolist() == [0, -1]


def test_the_euler_grid_of_1000_has_500_distinct_rotations() -> None:
    points = np.random.default_rng(0).normal(size=(10, 3))
    assert basin.distinct(euler_starts(points, points)) == 500
    assert basin.distinct(even_starts(points, points, 300)) == 300


def test_labels_do_not_depend_on_the_order() -> None:
    made = two_basins(40, 60, 1.5)
    found = basin.labels(made.T_target_source, made.error, CENTROID, SIZE)
    order = np.random.default_rng(1).permutation(100)
    again = basin.labels(made.T_target_source[order], made.error[order], CENTROID, SIZE)
    assert np.array_equal(again, found[order])
    assert np.sum(found == 0) == 40 and found.min() == 0


def test_basins_follow_the_error() -> None:
    made = two_basins(5, 8, 2.0)
    found = basin.labels(made.T_target_source, made.error, CENTROID, SIZE)
    lowest = [made.error[found == label].min() for label in range(found.max() + 1)]
    assert lowest == sorted(lowest)


def test_a_clear_plateau_is_named_with_all_its_members() -> None:
    made = two_basins(30, 70, 1.5)
    plateau = basin.plateau(made, CENTROID, SIZE)
    assert plateau.found and np.array_equal(plateau.members, made.error < 1.2)
    assert 1.45 < plateau.gap < 1.6 and "30 of 100" in plateau.sentence


@pytest.mark.parametrize(("low", "gap", "why"), [(2, 3.0, "only 2 of"), (30, 1.05, "next basin")])
def test_without_a_clear_plateau_the_test_abstains(low: int, gap: float, why: str) -> None:
    plateau = basin.plateau(two_basins(low, 70, gap), CENTROID, SIZE)
    assert not plateau.found and not plateau.members.any() and why in plateau.sentence


def test_one_start_tells_nothing() -> None:
    plateau = basin.plateau(two_basins(1, 0, 1.0), CENTROID, SIZE)
    assert not plateau.found and "only 1 starts" in plateau.sentence


def test_few_pairs_with_a_low_error_are_no_plateau() -> None:
    made = two_basins(30, 70, 1.5)
    matched = np.where(made.error < 1.2, 0.2, 0.9)
    poor = eqx.tree_at(lambda s: s.matched_fraction, made, matched)
    assert not basin.plateau(poor, CENTROID, SIZE).members[made.error < 1.2].any()
    assert poor.best.error > 1.4


def test_same_basin_is_joint() -> None:
    first = two_basins(30, 20, 1.5)
    nudged = made_sweep(np.zeros((50, 3)), np.zeros((50, 3)), first.error)
    assert basin.same_basin(first, first, CENTROID, SIZE).all()
    assert basin.same_basin(first, nudged, CENTROID, SIZE).sum() == 30


@pytest.mark.data
@pytest.mark.slow
def test_thesis_method_on_real_scans(data_dir: Path) -> None:
    """An overlapping pair: best right, plateau named. A pair without common surface: the test abstains."""
    from jaxmodel.control_points import Subsample, select
    from jaxmodel.io.datasets import StanfordBunny

    bunny = StanfordBunny(data_dir)
    clouds: dict[str, Cloud] = {
        name: select(bunny.scan(name), Subsample(count=2000), 0) for name in ("bun000", "bun045", "bun180")
    }
    target, source = clouds["bun000"], clouds["bun045"]
    centroid, size = source.points.mean(axis=0), float(np.linalg.norm(np.ptp(source.points, axis=0)))
    found = sweep(target, source, even_starts(target.points, source.points, 250), "thesis_2005")
    errors = basin.truth_errors(found.T_target_source, bunny.T_target_source("bun000", "bun045"), centroid)
    is_right = basin.right(errors, 5.0, 0.005)
    assert is_right[found.best.start]
    plateau = basin.plateau(found, centroid, size)
    assert plateau.found
    both = np.sum(plateau.members & is_right)
    assert both / plateau.members.sum() >= 0.95 and both / is_right.sum() >= 0.95

    apart = sweep(clouds["bun180"], target, even_starts(clouds["bun180"].points, target.points, 250), "thesis_2005")
    assert not basin.plateau(apart, target.points.mean(axis=0), size).found


def test_axis_and_angle_errors_are_those_of_the_rotation_between_the_views() -> None:
    """A turn of 40 degrees about z is the truth; wrong by 3 degrees about it, then with the axis tilted by 10."""
    axis, tilted = np.array([0.0, 0.0, 1.0]), np.array([0.0, np.sin(np.radians(10)), np.cos(np.radians(10))])
    rotvecs = np.radians([40 * axis, 43 * axis, 40 * tilted, 37 * tilted, -40 * axis])
    made = made_sweep(rotvecs, np.zeros((5, 3)), np.ones(5))
    poses = np.concatenate([made.T_target_source, np.full((1, 4, 4), np.nan)])
    truth = np.eye(4)
    truth[:3, :3] = Rotation.from_rotvec(np.radians(40) * axis).as_matrix()
    axis_error, angle_error = basin.axis_angle_errors(poses, truth)
    chord = 2 * np.sin(np.radians(5))
    assert np.allclose(axis_error[:5], [0, 0, chord, chord, 2], atol=1e-9) and np.isinf(axis_error[5])
    assert np.allclose(angle_error[:5], [0, 3, 0, 3, 0], atol=1e-9) and np.isinf(angle_error[5])
