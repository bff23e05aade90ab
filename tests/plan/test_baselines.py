"""Views without a utility: on their sphere, spread as stated, and the area factor's choice."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import pdist

from jaxmodel.errors import InputError
from jaxmodel.plan.baselines import (
    BORDER,
    EMPTY,
    OCCLUDED,
    OCCLUSION_PLANE,
    OCCUPIED,
    UNKNOWN,
    AreaFactor,
    ChoiceOutcome,
    ObservationSphere,
    farthest_first,
    overlap,
    overlaps_enough,
    random_views,
    uniform_views,
)

KEY = jax.random.key(11)
SPHERES = [
    ObservationSphere(np.zeros(3), 2.0),
    ObservationSphere(np.array([3.0, -1.0, 0.5]), 40.0, -20.0),
    ObservationSphere(np.array([0.0, 0.0, 1.0]), 0.1, 35.0),
]


def directions_of(sphere: ObservationSphere, poses: np.ndarray) -> np.ndarray:
    return (poses[:, :3, 3] - sphere.centre) / sphere.radius


@pytest.mark.parametrize("sphere", SPHERES, ids=lambda sphere: f"{sphere.lowest_elevation_deg:g}")
@pytest.mark.parametrize("make", ["random", "uniform"])
def test_views_stand_on_the_sphere_above_its_lowest_elevation_and_look_at_its_centre(
    sphere: ObservationSphere, make: str
) -> None:
    poses = random_views(sphere, KEY, 200) if make == "random" else uniform_views(sphere, 200)
    direction = directions_of(sphere, poses)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(poses[:, :3, 2], -direction, atol=1e-12)
    np.testing.assert_allclose(
        poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), np.eye(3)[None].repeat(200, 0), atol=1e-12
    )
    lowest = np.sin(np.deg2rad(sphere.lowest_elevation_deg))
    assert direction[:, 2].min() >= lowest - 1e-12
    # Even by area means that heights are even (Archimedes).
    height = np.sort((direction[:, 2] - lowest) / (1 - lowest))
    assert np.abs(height - (np.arange(200) + 0.5) / 200).max() < (0.12 if make == "random" else 1e-9)


def test_a_random_view_depends_on_its_number_and_the_key_only() -> None:
    sphere = SPHERES[1]
    few, many = random_views(sphere, KEY, 3), random_views(sphere, KEY, 20)
    np.testing.assert_array_equal(few, many[:3])
    assert len(np.unique(many[:, :3, 3], axis=0)) == 20
    assert not (random_views(sphere, jax.random.key(12), 20)[:, :3, 3] == many[:, :3, 3]).any()


@pytest.mark.parametrize("sphere", SPHERES, ids=lambda sphere: f"{sphere.lowest_elevation_deg:g}")
def test_every_beginning_of_the_uniform_views_is_spread(sphere: ObservationSphere) -> None:
    """The next view lies in the widest gap, and no two of a beginning are nearer than that gap."""
    direction = directions_of(sphere, uniform_views(sphere, 60))
    gaps = []
    for k in range(1, 60):
        to_chosen = np.linalg.norm(direction[:, None] - direction[None, :k], axis=2).min(axis=1)
        gaps.append(to_chosen.max())
        assert to_chosen[k] == pytest.approx(gaps[-1])
        assert pdist(direction[: k + 1]).min() >= gaps[-1] - 1e-12
    assert (np.diff(gaps) <= 1e-12).all()


def test_uniform_views_beat_random_ones_in_their_widest_gap() -> None:
    sphere = SPHERES[0]
    probes = directions_of(sphere, random_views(sphere, jax.random.key(99), 500))
    for count in (10, 40):
        even = directions_of(sphere, uniform_views(sphere, count))
        gap = np.linalg.norm(probes[:, None] - even, axis=2).min(axis=1).max()
        for seed in range(5):
            drawn = directions_of(sphere, random_views(sphere, jax.random.key(seed), count))
            assert gap < np.linalg.norm(probes[:, None] - drawn, axis=2).min(axis=1).max()


def test_the_first_uniform_view_can_be_asked_for() -> None:
    sphere = SPHERES[0]
    wish = np.array([0.6, 0.0, -0.8])
    free, asked = uniform_views(sphere, 30), uniform_views(sphere, 30, wish)
    np.testing.assert_array_equal(np.sort(free[:, :3, 3], axis=0), np.sort(asked[:, :3, 3], axis=0))
    direction = directions_of(sphere, asked)
    assert direction[0] @ wish == (direction @ wish).max()
    assert directions_of(sphere, free)[0, 2] == directions_of(sphere, free)[:, 2].max()


@given(st.integers(1, 40), st.integers(0, 1000))
def test_farthest_first_is_a_permutation_even_with_equal_directions(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))[rng.integers(0, count, count)]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert sorted(farthest_first(directions).tolist()) == list(range(count))


COUNTS = np.zeros((5, 6), dtype=np.int64)
COUNTS[0, [UNKNOWN, EMPTY]] = (50, 50)  # nothing but the unknown
COUNTS[1, [OCCUPIED, OCCLUSION_PLANE, EMPTY]] = (30, 20, 50)
COUNTS[2, [BORDER, OCCUPIED, UNKNOWN, OCCLUSION_PLANE]] = (20, 20, 30, 15)
COUNTS[3, [EMPTY]] = 100
COUNTS[4, [OCCLUDED, OCCUPIED]] = (70, 30)


def test_the_area_factor_counts_what_is_unseen_and_next_to_the_seen() -> None:
    np.testing.assert_array_equal(AreaFactor().scores(COUNTS), [50, 20, 45, 0, 0])
    assert AreaFactor().choose(COUNTS) == (0, 50.0, ChoiceOutcome.CHOSEN)
    assert AreaFactor().choose(np.concatenate([COUNTS, COUNTS])).view == 0


def test_overlap_is_the_share_of_the_model_among_the_hits() -> None:
    np.testing.assert_allclose(overlap(COUNTS), [0, 0.6, 40 / 85, 0, 0.3])
    np.testing.assert_array_equal(overlaps_enough(COUNTS, 0.3), [False, True, True, False, True])
    assert overlaps_enough(COUNTS, 0.0).all()


def test_the_constraints_leave_only_views_that_meet_them() -> None:
    assert AreaFactor(0.4).choose(COUNTS).view == 2
    assert AreaFactor(0.5).choose(COUNTS).view == 1
    assert AreaFactor(0.4).choose(COUNTS, np.array([True, True, False, True, True])).view == 1


def test_without_a_choice_the_outcome_says_why() -> None:
    for choice, outcome in (
        (AreaFactor().choose(COUNTS, np.zeros(5, dtype=bool)), ChoiceOutcome.NO_VIEW),
        (AreaFactor().choose(np.zeros((0, 6))), ChoiceOutcome.NO_VIEW),
        (AreaFactor(0.7).choose(COUNTS), ChoiceOutcome.NO_OVERLAP),
        (AreaFactor().choose(COUNTS[3:]), ChoiceOutcome.NOTHING_UNSEEN),
    ):
        assert choice.view == -1 and choice.outcome == outcome
    assert len({outcome.sentence for outcome in ChoiceOutcome}) == len(ChoiceOutcome)


@given(st.integers(0, 1000), st.floats(0, 1))
def test_the_choice_does_not_depend_on_the_order_or_the_number_of_rays(seed: int, minimum: float) -> None:
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 1000, (30, 6))
    order = rng.permutation(30)
    plain, shuffled = AreaFactor(minimum).choose(counts), AreaFactor(minimum).choose(counts[order])
    assert plain.outcome == shuffled.outcome and plain.score == shuffled.score
    doubled = AreaFactor(minimum).choose(2 * counts)
    assert doubled == (plain.view, 2 * plain.score, plain.outcome)
    if plain.outcome == ChoiceOutcome.CHOSEN:
        assert overlap(counts)[plain.view] >= minimum
        better = AreaFactor().scores(counts) > plain.score
        assert not (better & overlaps_enough(counts, minimum)).any()


def test_bad_input_is_refused() -> None:
    for radius in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="radius"):
            ObservationSphere(np.zeros(3), radius)
    with pytest.raises(InputError, match="centre"):
        ObservationSphere(np.array([np.nan, 0, 0]), 1.0)
    for elevation in (-91.0, 90.0, float("nan")):
        with pytest.raises(InputError, match="lowest_elevation_deg"):
            ObservationSphere(np.zeros(3), 1.0, elevation)
    with pytest.raises(InputError, match="count"):
        uniform_views(SPHERES[0], 0)
    with pytest.raises(InputError, match="count"):
        random_views(SPHERES[0], KEY, 0)
    with pytest.raises(InputError, match="minimum_overlap"):
        AreaFactor(1.5)
