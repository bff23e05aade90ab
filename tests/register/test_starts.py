"""The thesis's grid has half as many rotations as triples; the even grid is even; centroids meet."""

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.se3 import is_rigid, quaternion_distance, rotation_to_quaternion
from jaxmodel.register.basin import truth_errors
from jaxmodel.register.starts import (
    euler_rotations,
    euler_starts,
    even_rotations,
    even_starts,
    plausible_starts,
    starts_from_rotations,
)


def distinct(rotations: np.ndarray) -> int:
    """Rotations that differ by more than rounding, both signs of a quaternion counted as one."""
    remaining = rotation_to_quaternion(rotations)
    count = 0
    while len(remaining):
        count += 1
        first = np.broadcast_to(remaining[0], remaining.shape)
        remaining = remaining[quaternion_distance(remaining, first) > 1e-6]
    return count


def neighbour_angles(rotations: np.ndarray) -> np.ndarray:
    """Angle from each rotation to the nearest other one, degrees."""
    q = rotation_to_quaternion(rotations)
    chord = KDTree(np.concatenate([q, -q])).query(q, k=2)[0][:, 1]
    return np.degrees(4 * np.arcsin(chord / 2))


def clouds() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.normal([100.0, 0, 0], 1.0, size=(40, 3)), rng.uniform(size=(30, 3)) - np.array([0, 50.0, 3])


def test_the_euler_grid_has_500_distinct_rotations_of_1000() -> None:
    rotations = euler_rotations(10)
    assert rotations.shape == (1000, 3, 3)
    assert distinct(rotations) == 500
    # the reason: (a, b, c) and (a + 180, 180 - b, c + 180) are one rotation
    numbered = rotations.reshape(10, 10, 10, 3, 3)
    np.testing.assert_allclose(numbered[2, 1, 7], numbered[7, 4, 2], atol=1e-14)


@pytest.mark.parametrize(("steps", "expected"), [(1, 1), (2, 4), (3, 27), (4, 24)])
def test_small_euler_grids(steps: int, expected: int) -> None:
    """Quarter turns give the 24 rotations of the cube, half turns the four of a box."""
    rotations = euler_rotations(steps)
    assert len(rotations) == steps**3
    assert distinct(rotations) == expected
    np.testing.assert_allclose(rotations[0], np.eye(3), atol=1e-15)


@pytest.mark.parametrize("count", [10, 100, 1000])
def test_even_rotations_are_distinct_and_proper(count: int) -> None:
    rotations = even_rotations(count)
    assert distinct(rotations) == count
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-12)
    np.testing.assert_allclose(rotations @ np.swapaxes(rotations, 1, 2), np.tile(np.eye(3), (count, 1, 1)), atol=1e-12)


def test_even_rotations_are_more_even_than_random_ones_and_than_the_grid() -> None:
    even = even_rotations(1000)
    random = Rotation.random(1000, np.random.default_rng(1)).as_matrix()
    spread = [np.std(angles) / np.mean(angles) for angles in map(neighbour_angles, (even, random))]
    assert spread[0] < 0.5 * spread[1]
    assert neighbour_angles(even).min() > 5 * neighbour_angles(random).min()
    # the largest hole: how far a rotation can be from the nearest start
    probes = rotation_to_quaternion(Rotation.random(20_000, np.random.default_rng(2)).as_matrix())

    def hole(rotations: np.ndarray) -> float:
        q = rotation_to_quaternion(rotations)
        return float(KDTree(np.concatenate([q, -q])).query(probes)[0].max())

    assert hole(even) < 0.8 * hole(random)
    assert hole(even) < 0.8 * hole(euler_rotations(10))


def test_even_rotations_have_no_preferred_direction() -> None:
    """The mean of an even set of rotations is zero: no direction is favoured."""
    assert np.abs(even_rotations(2000).mean(axis=0)).max() < 0.02


@pytest.mark.parametrize("starts", [euler_starts(*clouds(), steps=4), even_starts(*clouds(), count=50)])
def test_centroid_starts_bring_the_centroids_together(starts: np.ndarray) -> None:
    target, source = clouds()
    assert all(is_rigid(T) for T in starts)
    moved = starts[:, :3, :3] @ source.mean(axis=0) + starts[:, :3, 3]
    np.testing.assert_allclose(moved, np.tile(target.mean(axis=0), (len(starts), 1)), atol=1e-12)


def test_zero_starts_turn_about_the_origin() -> None:
    target, source = clouds()
    starts = euler_starts(target, source, steps=3, translation="zero")
    np.testing.assert_array_equal(starts[:, :3, 3], 0.0)
    np.testing.assert_array_equal(starts[:, :3, :3], euler_rotations(3))
    np.testing.assert_array_equal(starts[:, 3], np.tile([0, 0, 0, 1.0], (27, 1)))


def test_starts_move_with_the_target() -> None:
    """Turning about the source's centroid does not depend on where the clouds' origins are."""
    target, source = clouds()
    rotations, shift = even_rotations(20), np.array([3.0, -7.0, 11.0])
    here = starts_from_rotations(rotations, target, source)
    there = starts_from_rotations(rotations, target + shift, source)
    np.testing.assert_allclose(there[:, :3, 3] - here[:, :3, 3], np.tile(shift, (20, 1)), atol=1e-12)
    elsewhere = starts_from_rotations(rotations, target, source + shift)
    moved = elsewhere[:, :3, :3] @ (source[0] + shift) + elsewhere[:, :3, 3]
    np.testing.assert_allclose(moved, here[:, :3, :3] @ source[0] + here[:, :3, 3], atol=1e-12)


TRUTH = np.eye(4)
TRUTH[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
TRUTH[:3, 3] = [500.0, -20.0, 3.0]
CENTROID = np.array([-300.0, 40.0, 7.0])


def test_plausible_starts_have_the_stated_angles_and_shifts() -> None:
    starts = plausible_starts(TRUTH, CENTROID, 4000, 0, spread_deg=20.0, shift=3.0)
    errors = truth_errors(starts, TRUTH, CENTROID)
    assert all(is_rigid(start) for start in starts[:50])
    assert np.median(errors.rotation_deg) == pytest.approx(0.674 * 20, rel=0.05)  # half-normal law
    assert np.mean(errors.rotation_deg > 40) == pytest.approx(0.0455, abs=0.012)
    assert errors.translation.max() <= 3.0 + 1e-9
    assert np.median(errors.translation) == pytest.approx(3.0 * 0.5 ** (1 / 3), rel=0.03)  # uniform in a ball
    axes = Rotation.from_matrix(starts[:, :3, :3] @ TRUTH[:3, :3].T).as_rotvec()
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    assert np.allclose(axes.T @ axes / len(axes), np.eye(3) / 3, atol=0.03)  # no favoured axis


def test_a_plausible_start_is_the_same_alone_and_in_a_batch() -> None:
    many = plausible_starts(TRUTH, CENTROID, 20, 3, spread_deg=60.0, shift=1.0, most_deg=70.0)
    assert np.array_equal(plausible_starts(TRUTH, CENTROID, 7, 3, 60.0, 1.0, 70.0), many[:7])
    assert not np.allclose(plausible_starts(TRUTH, CENTROID, 7, 4, 60.0, 1.0, 70.0), many[:7])
    assert truth_errors(many, TRUTH, CENTROID).rotation_deg.max() <= 70.0 + 1e-6
