"""Closed forms over very many sets of poses: the same answers as pair by pair."""

from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import Setup, calibrate_poses, solve_many
from jaxmodel.calibrate.many_poses import Method, solve_many_poses
from jaxmodel.errors import InputError
from jaxmodel.geometry import batch_last, se3
from tests.calibrate.calibration_cases import Simulation, errors, motion

METHODS: tuple[Method, ...] = ("linear", "tsai_lenz")


def drawn(
    seed: int, sets: int = 12, poses: int = 7, angle: float = 1.5, noise: float = 0.0, X_angle: float | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """X, hand and camera poses of an eye in the hand."""
    sim = Simulation(seed)
    X = np.stack([sim.X(X_angle) for _ in range(sets)])
    hand = np.stack([sim.motions(poses, (0.2 * angle, angle)) for _ in range(sets)])
    target = np.stack([motion(sim.rng.uniform(0, 3) * sim.unit(), sim.rng.normal(size=3)) for _ in range(sets)])
    camera = se3.inverse(hand @ X[:, None]) @ target[:, None]
    return X, hand, sim.noisy(camera, noise, noise)


def both_directions(hand: np.ndarray, camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    i, j = np.nonzero(~np.eye(hand.shape[1], dtype=bool))
    return camera[:, j] @ se3.inverse(camera[:, i]), se3.inverse(hand[:, j]) @ hand[:, i]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_sums_over_poses_are_those_over_all_pairs(method: Method, noise: float) -> None:
    _, hand, camera = drawn(1, noise=noise)
    found = solve_many_poses(hand, camera, method=method)
    expected = se3.inverse(solve_many(*both_directions(hand, camera), method=method, verdict=False).X)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("angle", "turn", "shift"), [(3.0, 1e-9, 1e-9), (1e-2, 1e-9, 1e-9), (1e-4, 1e-9, 1e-6)])
def test_exact_poses_give_the_exact_answer(method: Method, angle: float, turn: float, shift: float) -> None:
    X, hand, camera = drawn(2, angle=angle)
    for found, true in zip(solve_many_poses(hand, camera, method=method), X, strict=True):
        rotation, translation = errors(found, true)
        assert rotation < turn and translation < shift


def test_tsai_lenz_stands_an_X_that_turns_by_half_a_turn() -> None:
    X, hand, camera = drawn(3, poses=16, noise=1e-3, X_angle=np.pi)
    for found, true in zip(solve_many_poses(hand, camera, method="tsai_lenz"), X, strict=True):
        assert errors(found, true)[0] < 0.01


@pytest.mark.parametrize("method", METHODS)
def test_the_order_of_poses_and_of_sets_and_what_is_masked_do_not_matter(method: Method) -> None:
    _, hand, camera = drawn(4, noise=0.02)
    found = solve_many_poses(hand, camera, method=method)
    order = np.random.default_rng(0).permutation(hand.shape[1])
    shuffled = solve_many_poses(hand[::-1, order], camera[::-1, order], method=method)[::-1]
    np.testing.assert_allclose(shuffled, found, rtol=0, atol=1e-9)
    rubbish = np.full((len(hand), 2, 4, 4), np.nan)
    mask = np.ones((len(hand), hand.shape[1] + 2), bool)
    mask[:, :2] = False
    hand, camera = (np.concatenate([rubbish, poses], axis=1) for poses in (hand, camera))
    np.testing.assert_allclose(solve_many_poses(hand, camera, mask, method=method), found, rtol=0, atol=1e-9)


@pytest.mark.parametrize("setup", [Setup.EYE_TO_HAND, Setup.MOVING_FRAMES])
def test_other_set_ups_agree_with_one_set_at_a_time(setup: Setup) -> None:
    _, hand, camera = drawn(5, sets=2, noise=1e-12)
    if setup is Setup.MOVING_FRAMES:
        camera = se3.inverse(camera)
    else:  # H_i^-1 X C_i is what the camera sees of a target on the hand
        hand = se3.inverse(hand)
    for one, found in enumerate(solve_many_poses(hand, camera, setup=setup)):
        expected = calibrate_poses(hand[one], camera[one], setup, "linear").X
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_one_bad_set_spoils_no_other() -> None:
    X, hand, camera = drawn(6)
    hand[3, 2, 0, 0], mask = np.nan, np.ones(hand.shape[:2], bool)
    mask[5, 2:] = False
    found = solve_many_poses(hand, camera, mask)
    lost = np.isnan(found).all(axis=(1, 2))
    assert np.flatnonzero(lost).tolist() == [3, 5]
    np.testing.assert_allclose(found[~lost], X[~lost], rtol=0, atol=1e-9)


def test_more_sets_than_one_call_takes_are_all_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jaxmodel.calibrate.many_poses.CHUNK", 1)
    X, hand, camera = drawn(7, sets=70, poses=4)
    np.testing.assert_allclose(solve_many_poses(hand, camera), X, rtol=0, atol=1e-9)
    assert solve_many_poses(hand[:0], camera[:0]).shape == (0, 4, 4)


def test_bad_input_is_named() -> None:
    _, hand, camera = drawn(8, sets=2)
    with pytest.raises(InputError, match=r"must both be \(batch, n, 4, 4\)"):
        solve_many_poses(hand, camera[:1])
    with pytest.raises(InputError, match="mask must be"):
        solve_many_poses(hand, camera, np.ones(3, bool))
    with pytest.raises(InputError, match="not 'park'"):
        solve_many_poses(hand, camera, method=cast(Any, "park"))


def test_quaternions_of_every_rotation_come_back() -> None:
    turns = Rotation.random(200, np.random.default_rng(0)).as_matrix()
    half = Rotation.from_rotvec(np.pi * np.eye(3)).as_matrix()
    R = np.moveaxis(np.concatenate([turns, half, np.eye(3)[None]]), 0, -1)
    with jax.enable_x64(True):
        back = np.asarray(batch_last.rotation(batch_last.quaternion(jnp.asarray(R))))
    np.testing.assert_allclose(back, R, rtol=0, atol=1e-14)
