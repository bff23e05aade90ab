"""All solvers, one contract: exact without noise, equivariant, indifferent to order and padding, and never nonsense."""

import jax.numpy as jnp
import numpy as np
import pytest
from calibration_cases import Simulation, conjugate, errors, motion
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import Outcome, solve, solve_many
from jaxmodel.calibrate.solve import METHODS
from jaxmodel.errors import InputError

EVERY = sorted(METHODS)
SCALED = [name for name in EVERY if name != "quaternion_penalty"]
# one step and the published penalty weigh rotation against translation by the unit of length
UNIT_FREE = [name for name in EVERY if name not in ("linear_one_step", "quaternion_penalty")]


@pytest.mark.parametrize("method", EVERY)
def test_exact_motions_give_x_exactly(method):
    for seed, angle, count in [(0, (1e-2, np.pi), 2), (1, (1e-2, np.pi), 50), (2, 1e-2, 3), (3, np.pi, 5), (4, 3.1, 2)]:
        for angle_of_X in (0.0, 1.0, np.pi):
            s = Simulation(seed)
            X, B = s.X(angle_of_X), s.motions(count, angle)
            found = solve(conjugate(X, B), B, method)
            turn, shift = errors(found.X, X)
            assert found.outcome is Outcome.SOLVED
            assert turn < 1e-9 and shift < 1e-9, (seed, angle_of_X, turn, shift)
            assert found.rotation_residuals.max() < 1e-9


@pytest.mark.parametrize("method", EVERY)
def test_small_exact_motions(method):
    s = Simulation(5)
    X, B = s.X(), s.motions(6, 1e-4)
    turn, shift = errors(solve(conjugate(X, B), B, method).X, X)
    assert turn < 1e-9 and shift < 1e-6


@pytest.mark.parametrize("method", SCALED)
def test_an_unknown_scale_is_found_exactly(method):
    for seed, scale in [(0, 2.5), (1, 1e-3), (2, 40.0)]:
        s = Simulation(seed)
        X, B = s.X(), s.motions(6, (0.1, 2.0))
        A = conjugate(X, B)
        A[:, :3, 3] /= scale
        found = solve(A, B, method, unknown_scale=True)
        turn, shift = errors(found.X, X)
        assert found.outcome is Outcome.SOLVED
        assert turn < 1e-9 and shift < 1e-9 and abs(found.scale / scale - 1) < 1e-9


@pytest.mark.parametrize("method", EVERY)
def test_change_of_frames(method):
    """X of (P A P^-1, Q B Q^-1) is P X Q^-1, noise and all, where the noise is as isotropic as the method."""
    s = Simulation(6)
    X, B = s.X(0.8), s.motions(12)
    A = s.noisy(conjugate(X, B), 0.01, 0.02)
    P, Q = motion(0.3 * s.unit(), np.zeros(3)), motion(0.2 * s.unit(), np.zeros(3))
    plain = solve(A, B, method).X
    moved = solve(conjugate(P, A), conjugate(Q, B), method).X
    # Tsai and Lenz weigh by the tangent of half X's angle, and dual quaternions drop each equation's scalar part: both
    # are another problem in another frame
    tolerance = 3e-3 if method in ("tsai_lenz", "dual_quaternion") else 1e-7
    np.testing.assert_allclose(moved, P @ plain @ np.linalg.inv(Q), atol=tolerance)


@pytest.mark.parametrize("method", EVERY)
def test_order_and_padding_change_nothing(method):
    s = Simulation(7)
    X, B = s.X(), s.motions(11)
    A = s.noisy(conjugate(X, B), 0.01, 0.01)
    reference = solve(A, B, method).X
    orders = np.stack([s.rng.permutation(11) for _ in range(1000)])
    permuted = solve_many(A[orders], B[orders], None, method, verdict=False)
    np.testing.assert_allclose(permuted.X, np.broadcast_to(reference, permuted.X.shape), rtol=0, atol=1e-9)
    padded_A, padded_B = np.full((1, 16, 4, 4), np.nan), np.full((1, 16, 4, 4), np.nan)
    rows = np.sort(s.rng.choice(16, 11, replace=False))
    padded_A[0, rows], padded_B[0, rows] = A, B
    mask = np.zeros((1, 16), bool)
    mask[0, rows] = True
    padded = solve_many(padded_A, padded_B, mask, method)
    np.testing.assert_allclose(padded.X[0], reference, rtol=0, atol=1e-9)
    assert padded.outcome[0] == Outcome.SOLVED
    assert np.isnan(padded.rotation_residuals[0, ~mask[0]]).all()


def answer(A: np.ndarray, B: np.ndarray, method: str) -> np.ndarray:
    """A method's answer as it is, in the shape of ``solve``: nothing is compiled anew."""
    rest = np.broadcast_to(np.eye(4), (16 - len(A), 4, 4))
    mask = np.arange(16)[None] < len(A)
    A, B = (np.concatenate([T, rest])[None] for T in (A, B))
    return solve_many(A, B, mask, method, verdict=False).X[0]


@pytest.mark.parametrize("method", UNIT_FREE)
def test_metres_and_millimetres_give_one_answer(method):
    """Motions of any size, as noisy as they are small: the answer in millimetres is that in metres times 1000."""
    s = Simulation(16)
    X = s.X()
    B = np.stack([s.motions(11, angle) for angle in (1.0, 0.1, 1e-3) for _ in range(4)])
    A = s.noisy(conjugate(X, B), 1e-4, 1e-3)
    A[:4], A[4:8] = s.noisy(conjugate(X, B[:4]), 0.02, 0.02), s.noisy(conjugate(X, B[4:8]), 0.01, 0.02)
    metres = np.stack([answer(a, b, method) for a, b in zip(A, B, strict=True)])
    A[..., :3, 3] *= 1000
    B[..., :3, 3] *= 1000
    millimetres = np.stack([answer(a, b, method) for a, b in zip(A, B, strict=True)])
    np.testing.assert_allclose(millimetres[:, :3, :3], metres[:, :3, :3], rtol=0, atol=1e-9)
    lengths = np.linalg.norm(metres[:, :3, 3], axis=1)
    assert (np.linalg.norm(millimetres[:, :3, 3] / 1000 - metres[:, :3, 3], axis=1) < 1e-9 * lengths).all()


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("unknown_scale", [False, True])
def test_one_step_answers_pure_rotations_as_the_two_steps(noise, unknown_scale):
    """Without translations of B nothing says how long vec R_X is: eq. 3.12 decouples (Propositions 1 and 2)."""
    s = Simulation(17)
    X, B = s.X(), s.motions(12, (0.3, 2.0), length=0.0)
    A, B = s.noisy(conjugate(X, B), noise, noise), s.noisy(B, 0.0, noise)
    one, two = (solve(A, B, method, unknown_scale) for method in ("linear_one_step", "linear"))
    assert one.outcome is two.outcome is (Outcome.SCALE_TIED if unknown_scale else Outcome.SOLVED)
    np.testing.assert_allclose(one.X, two.X, rtol=0, atol=1e-9)
    assert errors(one.X, X)[0] < (3 * noise if noise else 1e-9)


@pytest.mark.parametrize("method", EVERY)
def test_a_weight_counts_copies(method):
    s = Simulation(8)
    X, B = s.X(), s.motions(6)
    A = s.noisy(conjugate(X, B), 0.01, 0.01)
    copies = np.array([1, 2, 0, 3, 1, 1])
    weighted = solve(A, B, method, weights=copies.astype(float)).X
    repeated = solve(np.repeat(A, copies, axis=0), np.repeat(B, copies, axis=0), method).X
    # the number of rows enters the estimated variances of rotation and translation, hence their ratio not at all
    np.testing.assert_allclose(weighted, repeated, atol=1e-7)


def test_methods_agree_as_the_noise_vanishes():
    for noise in (1e-2, 1e-3, 1e-4):
        s = Simulation(9)
        X, B = s.X(1.0), s.motions(16)
        A = s.noisy(conjugate(X, B), noise, noise)
        for method in EVERY:
            turn, shift = errors(solve(A, B, method).X, X)
            assert turn < 2 * noise and shift < 4 * noise, method


def test_one_bad_problem_leaves_its_neighbours_alone():
    s = Simulation(10)
    X = s.X()
    B = np.stack([s.motions(5) for _ in range(4)])
    A = conjugate(X, B)
    A[1, 2, 0, 0] = np.nan
    mask = np.ones((4, 5), bool)
    mask[2] = False
    found = solve_many(A, B, mask)
    assert [Outcome(o) for o in found.outcome] == [
        Outcome.SOLVED,
        Outcome.NOT_FINITE,
        Outcome.NO_MOTION,
        Outcome.SOLVED,
    ]
    for i in (0, 3):
        assert max(errors(found.X[i], X)) < 1e-12
    assert np.isnan(found.X[[1, 2]]).all()


def test_an_empty_batch():
    assert solve_many(np.zeros((0, 3, 4, 4)), np.zeros((0, 3, 4, 4))).X.shape == (0, 4, 4)
    assert solve_many(np.zeros((2, 0, 4, 4)), np.zeros((2, 0, 4, 4))).outcome.tolist() == [Outcome.NO_MOTION] * 2


def test_the_setting_of_the_caller_is_left_alone():
    s = Simulation(11)
    X, B = s.X(), s.motions(4)
    solve(conjugate(X, B), B)
    assert jnp.zeros(1).dtype == np.float32
    assert solve(conjugate(X, B), B).X.dtype == np.float64


def test_the_same_shapes_compile_once():
    from jaxmodel.calibrate.solve import _kernel

    s = Simulation(12)
    X = s.X()
    for count in (3, 9, 16):
        B = s.motions(count)
        solve(conjugate(X, B), B)
    compiled = _kernel("linear", False)._cache_size()
    for count in (4, 10):
        B = s.motions(count)
        solve(conjugate(X, B), B)
    assert _kernel("linear", False)._cache_size() == compiled


def test_nonlinear_is_the_least_squares_solution():  # oracle: scipy.optimize.least_squares
    s = Simulation(13)
    X, B = s.X(), s.motions(15)
    A = s.noisy(conjugate(X, B), 0.01, 0.03)
    found = solve(A, B, "nonlinear").X

    def residual(x: np.ndarray, weights: tuple[float, float]) -> np.ndarray:
        X = found.copy()
        X[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix() @ X[:3, :3]
        X[:3, 3] += x[3:]
        predicted = conjugate(X, B)
        turn = (A[:, :3, :3] - predicted[:, :3, :3]).reshape(-1) / np.sqrt(2)
        return np.concatenate([turn * weights[0], (A[:, :3, 3] - predicted[:, :3, 3]).reshape(-1) * weights[1]])

    plain = residual(np.zeros(6), (1.0, 1.0))
    count = 9 * len(A)
    weights = 1 / np.sqrt(np.mean(plain[:count] ** 2) * 3), 1 / np.sqrt(np.mean(plain[count:] ** 2))
    oracle = least_squares(residual, np.zeros(6), args=(weights,), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert np.abs(oracle.x).max() < 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda A, B: (A[:2], B), "A has 2 rows and B has 3"),
        (lambda A, B: (A[:0], B[:0]), "hold no motion"),
        (lambda A, B: (A * np.nan, B), "A, row 0: holds a value that is not a finite number"),
        (lambda A, B: (A, B @ np.diag([1.0, 1, -1, 1])), "B, row 0: expected a rigid motion; it is a reflection"),
        (lambda A, B: (A, B * [[[1.0]], [[1.1]], [[1.0]]]), "B, row 1: expected a rigid motion"),
        (lambda A, B: (A.swapaxes(1, 2), B), "row 0: expected a rigid motion; its last row"),
    ],
)
def test_bad_input_is_named(change, message):
    s = Simulation(14)
    B = s.motions(3)
    with pytest.raises(InputError, match=message):
        solve(*change(conjugate(s.X(), B), B))


def test_bad_options_are_named():
    s = Simulation(15)
    B = s.motions(3)
    with pytest.raises(InputError, match="method must be one of linear"):
        solve(B, B, "linaer")
    with pytest.raises(InputError, match="no unknown scale"):
        solve(B, B, "quaternion_penalty", unknown_scale=True)
    with pytest.raises(InputError, match="weights must be 3"):
        solve(B, B, weights=np.array([1.0, -1.0, 1.0]))
    with pytest.raises(InputError, match=r"\(batch, n, 4, 4\)"):
        solve_many(B, B)
