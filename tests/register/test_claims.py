"""The two claims of thesis §2.9.2: the tests find what is there and nothing where nothing is."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.register.claims import coherence, offset_starts, paired_effect, translation_effect


def even_rotations(count: int) -> np.ndarray:
    return Rotation.random(count, np.random.default_rng(3)).as_matrix()


def euler_grid(steps: int) -> np.ndarray:
    angles = 360.0 / steps * np.stack(np.meshgrid(*[np.arange(steps)] * 3, indexing="ij"), -1).reshape(-1, 3)
    return Rotation.from_euler("XYZ", angles, degrees=True).as_matrix()


def test_a_cap_of_rotations_is_coherent() -> None:
    rotations = even_rotations(600)
    inside = Rotation.from_matrix(rotations).magnitude() < np.deg2rad(90)
    found = coherence(rotations, inside, permutations=199)
    assert found is not None
    assert found.p_value == 1 / 200
    assert found.neighbour_rate > found.random_rate + 0.3


def test_random_labels_are_not_coherent() -> None:
    rotations = even_rotations(400)
    p_values = [
        found.p_value
        for seed in range(20)
        if (found := coherence(rotations, np.random.default_rng(seed).random(400) < 0.2, 199, seed)) is not None
    ]
    assert len(p_values) == 20
    assert sum(p < 0.05 for p in p_values) <= 4
    assert 0.25 < np.mean(p_values) < 0.75


def test_rotations_held_twice_count_once() -> None:
    grid = euler_grid(6)
    rounded = np.unique(np.round(grid.reshape(-1, 9), 6) + 0.0, axis=0)
    right = np.random.default_rng(0).random(len(grid)) < 0.3
    found = coherence(grid, right, permutations=19)
    assert found is not None
    assert found.distinct == len(rounded) < len(grid)


def test_doubling_every_start_changes_nothing() -> None:
    rotations = even_rotations(200)
    right = np.random.default_rng(1).random(200) < 0.3
    once, twice = coherence(rotations, right, 99), coherence(np.tile(rotations, (2, 1, 1)), np.tile(right, 2), 99)
    assert once == twice


def test_order_does_not_matter_for_the_rate() -> None:
    rotations = even_rotations(200)
    right = np.random.default_rng(1).random(200) < 0.3
    order = np.random.default_rng(2).permutation(200)
    once, other = coherence(rotations, right, 9), coherence(rotations[order], right[order], 9)
    assert once is not None and other is not None
    assert once.neighbour_rate == pytest.approx(other.neighbour_rate, abs=1e-12)


@pytest.mark.parametrize("converging", [0, 1, 30, 29])
def test_too_few_to_tell(converging: int) -> None:
    right = np.arange(30) < converging
    assert coherence(even_rotations(30), right) is None


def test_offsets_stay_in_the_ball_and_belong_to_their_start() -> None:
    starts = np.tile(np.eye(4), (50, 1, 1))
    starts[:, :3, 3] = [1.0, 2.0, 3.0]
    everything = offset_starts(starts, 0.5, 7, np.arange(50))
    some = offset_starts(starts, 0.5, 7, np.array([3, 40]))
    length = np.linalg.norm(everything[:, :3, 3] - [1.0, 2.0, 3.0], axis=1)
    assert np.all(length <= 0.5) and np.all(length > 0) and length.max() > 0.4
    assert np.array_equal(some, everything[[3, 40]])
    assert np.array_equal(everything[:, :3, :3], starts[:, :3, :3])
    assert np.array_equal(starts[0, :3, 3], [1.0, 2.0, 3.0])


def test_translation_effect_counts_and_tests() -> None:
    without = np.array([True] * 30 + [False] * 70)
    same = translation_effect(without, without)
    assert (same.both, same.only_without, same.only_with, same.neither, same.p_value) == (30, 0, 0, 70, 1.0)
    worse = translation_effect(without, np.zeros(100, dtype=bool))
    assert worse.only_without == 30 and worse.p_value == pytest.approx(2 * 0.5**30)
    assert (worse.rate_without, worse.rate_with) == (0.3, 0.0)
    with pytest.raises(InputError):
        translation_effect(np.zeros(0, dtype=bool), np.zeros(0, dtype=bool))


def test_counts_and_outcomes_give_the_same_test() -> None:
    draw = np.random.default_rng(5)
    without, with_offset = draw.random(200) < 0.3, draw.random(200) < 0.2
    found = translation_effect(without, with_offset)
    assert found == paired_effect(found.both, found.only_without, found.only_with, found.neither)
    assert found.rate_without == pytest.approx(without.mean()) and found.rate_with == pytest.approx(with_offset.mean())
