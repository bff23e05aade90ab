"""Very many sets of poses by sums over poses: the same answers as pair by pair."""

from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import Setup, calibrate_poses, solve_many
from jaxmodel.calibrate.many_poses import METHODS, Method, solve_many_poses
from jaxmodel.errors import InputError
from jaxmodel.geometry import batch_last, se3
from tests.calibrate.calibration_cases import Simulation, errors, motion

# two Gauss-Newton steps end ``solve_nonlinear``: at noise 0.02 what they leave is of its fourth power
AGREEMENT = {"linear": 1e-9, "linear_one_step": 1e-9, "tsai_lenz": 1e-9, "nonlinear": 1e-7}


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


def pair_by_pair(hand: np.ndarray, camera: np.ndarray, method: Method, mask: np.ndarray | None = None) -> np.ndarray:
    """X of the set-up; all but one step have the camera's motion for A."""
    A, B = both_directions(hand, camera)
    i, j = np.nonzero(~np.eye(hand.shape[1], dtype=bool))
    both = None if mask is None else mask[:, i] & mask[:, j]
    if method == "linear_one_step":
        return solve_many(B, A, both, method=method, verdict=False).X
    return se3.inverse(solve_many(A, B, both, method=method, verdict=False).X)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02])
def test_the_sums_over_poses_are_those_over_all_pairs(method: Method, noise: float) -> None:
    _, hand, camera = drawn(1, noise=noise)
    found = solve_many_poses(hand, camera, method=method)
    expected = pair_by_pair(hand, camera, method)
    np.testing.assert_allclose(found, expected, rtol=0, atol=AGREEMENT[method] if noise else 1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_ragged_sets_are_those_over_the_pairs_that_are_there(method: Method) -> None:
    _, hand, camera = drawn(9, noise=0.005)
    count = np.random.default_rng(1).integers(4, hand.shape[1] + 1, len(hand))
    mask = np.arange(hand.shape[1]) < count[:, None]
    found = solve_many_poses(np.where(mask[..., None, None], hand, np.nan), camera, mask, method=method)
    np.testing.assert_allclose(found, pair_by_pair(hand, camera, method, mask), rtol=0, atol=AGREEMENT[method])
    assert len(set(count)) > 2


@pytest.mark.parametrize("method", METHODS)
def test_small_noisy_motions_agree_in_units_of_their_error(method: Method) -> None:
    """Motions of 1e-3 rad magnify noise a thousandfold: rounding, too, so both ways agree to 1e-7 of the error."""
    X, hand, camera = drawn(10, angle=1e-3, noise=1e-5)
    found, expected = solve_many_poses(hand, camera, method=method), pair_by_pair(hand, camera, method)
    for one, other, true in zip(found, expected, X, strict=True):
        apart, wrong = np.abs(one - other), np.abs(one - true)
        for part in (np.s_[:3, :3], np.s_[:3, 3]):
            assert apart[part].max() < 1e-7 * max(wrong[part].max(), 1e-5)


def test_nonlinear_takes_the_camera_for_the_noisy_stream() -> None:
    """Its X is that of ``nonlinear``, noise in A, with the camera for A and not with the hand."""
    _, hand, camera = drawn(1, noise=0.02)
    found = solve_many_poses(hand, camera, method="nonlinear")
    A, B = both_directions(hand, camera)
    other = solve_many(B, A, method="nonlinear", verdict=False).X
    assert np.abs(found - other).max() > 100 * AGREEMENT["nonlinear"]


def test_one_step_answers_where_hand_or_camera_only_turns() -> None:
    """Translations that say nothing of the rotation's size leave the decoupled solution (Propositions 1 and 2)."""
    X, hand, _ = drawn(11)
    hand[..., :3, 3] = 0.0
    for about in (hand, hand @ se3.inverse(X)[:, None]):  # the hand's own origin, then the camera's
        found = solve_many_poses(about, se3.inverse(about @ X[:, None]), method="linear_one_step")
        np.testing.assert_allclose(found, X, rtol=0, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("angle", "turn", "shift"), [(3.0, 1e-9, 1e-9), (1e-2, 1e-9, 1e-9), (1e-4, 1e-9, 1e-6)])
def test_exact_poses_give_the_exact_answer(method: Method, angle: float, turn: float, shift: float) -> None:
    X, hand, camera = drawn(2, angle=angle)
    for found, true in zip(solve_many_poses(hand, camera, method=method), X, strict=True):
        rotation, translation = errors(found, true)
        assert rotation < turn and translation < shift


def test_tsai_lenz_stands_an_X_that_turns_by_half_a_turn() -> None:
    X, hand, camera = drawn(3, noise=1e-3, X_angle=np.pi)
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


@pytest.mark.parametrize("method", METHODS)
def test_one_bad_set_spoils_no_other(method: Method) -> None:
    X, hand, camera = drawn(6)
    hand[3, 2, 0, 0], mask = np.nan, np.ones(hand.shape[:2], bool)
    mask[5, 2:] = False
    found = solve_many_poses(hand, camera, mask, method=method)
    lost = np.isnan(found).all(axis=(1, 2))
    assert np.flatnonzero(lost).tolist() == [3, 5]
    np.testing.assert_allclose(found[~lost], X[~lost], rtol=0, atol=1e-9)


def test_more_sets_than_one_call_takes_are_all_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jaxmodel.calibrate.many_poses.CHUNK", 1)
    X, hand, camera = drawn(7, sets=70)
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


def test_positive_systems_are_solved_and_an_unknown_without_a_pivot_is_left_at_zero() -> None:
    random = np.random.default_rng(0)
    rows = random.normal(size=(20, 9, 5)) * [1.0, 1e3, 1e-3, 1.0, 1.0]
    matrix, right = np.swapaxes(rows, 1, 2) @ rows, random.normal(size=(20, 5))
    matrix[0, 3], matrix[0, :, 3], right[0, 3] = 0.0, 0.0, 0.0
    with jax.enable_x64(True):
        found = np.asarray(batch_last.solve_positive(jnp.asarray(np.moveaxis(matrix, 0, -1)), jnp.asarray(right.T))).T
    residual = np.einsum("nij,nj->ni", matrix, found) - right
    size = np.einsum("nij,nj->ni", np.abs(matrix), np.abs(found)) + np.abs(right)
    assert (np.abs(residual) <= 1e-11 * size).all()
    assert found[0, 3] == 0.0 and (found[1:] != 0.0).all()
