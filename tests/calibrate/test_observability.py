"""What each set of motions determines: RR-3507 Table 3.1, the half turns, and the sets that its ranks miss."""

import numpy as np
import pytest
from calibration_cases import Simulation, conjugate, errors, motion

from jaxmodel.calibrate import Outcome, solve, solve_many
from jaxmodel.calibrate.observability import linear_ranks
from jaxmodel.calibrate.solve import KNOWN_SCALE_ONLY, METHODS

X_AXIS, Y_AXIS, Z_AXIS = np.eye(3)
NONE = np.zeros(3)
OBLIQUE = (X_AXIS + Z_AXIS) / np.sqrt(2)


def case(name: str, s: Simulation) -> list[np.ndarray]:
    def general():
        return motion(s.rng.uniform(0.5, 2.5) * s.unit(), s.rng.normal(size=3))

    def shift():
        return motion(NONE, s.rng.normal(size=3))

    def about_z(angle: float):
        return motion(angle * Z_AXIS, s.rng.normal(size=3))

    return {
        "two general": lambda: list(s.motions(2)),
        "eight general": lambda: [general() for _ in range(8)],
        "two rotations": lambda: [motion(1.0 * X_AXIS, NONE), motion(1.5 * OBLIQUE, NONE)],
        "one rotation, one general": lambda: [motion(Z_AXIS, NONE), motion(1.3 * OBLIQUE, s.rng.normal(size=3))],
        "one general": lambda: [general()],
        "the same four times": lambda: [general()] * 4,
        "parallel axes": lambda: [about_z(a) for a in (0.5, 1.0, 1.5, -1.0, 2.0, 0.3)],
        "planar": lambda: [motion(a * Z_AXIS, [*s.rng.normal(size=2), 0]) for a in (0.5, 1.0, 1.5, -1.0)],
        "rotation and translation across": lambda: [motion(Z_AXIS, NONE), motion(NONE, X_AXIS)],
        "general and two translations": lambda: [about_z(1.0), shift(), shift()],
        "rotation and translation along": lambda: [motion(Z_AXIS, NONE), motion(NONE, Z_AXIS)],
        "screws of one axis": lambda: [motion(a * Z_AXIS, b * Z_AXIS) for a, b in ((0.5, 1), (1, 2), (1.5, -1))],
        "three translations": lambda: [shift() for _ in range(3)],
        "two translations": lambda: [shift() for _ in range(2)],
        "parallel translations": lambda: [motion(NONE, a * X_AXIS) for a in (1, 2, -1)],
        "nothing": lambda: [np.eye(4)] * 3,
        "half turns about perpendicular axes": lambda: [motion(np.pi * Z_AXIS, NONE), motion(np.pi * X_AXIS, NONE)],
        "half turns about oblique axes": lambda: [motion(np.pi * Z_AXIS, NONE), motion(np.pi * OBLIQUE, NONE)],
        "half turns with a pitch": lambda: [motion(np.pi * Z_AXIS, OBLIQUE), motion(np.pi * X_AXIS, Y_AXIS + X_AXIS)],
        "three half turns": lambda: [
            motion(np.pi * axis, NONE) for axis in (X_AXIS, OBLIQUE, np.array([0.48, 0.6, 0.64]))
        ],
    }[name]()


SOLVED, ALONG, ABOUT = Outcome.SOLVED, Outcome.TRANSLATION_ALONG_AXIS, Outcome.ROTATION_ABOUT_AXIS
SEVERAL = Outcome.SEVERAL_ANSWERS
# outcome, free direction in B's frame (None: none, or not of interest), ranks of the linear systems, other answers
CASES = {
    "two general": (SOLVED, None, (8, 12), 0),
    "eight general": (SOLVED, None, (8, 12), 0),
    "two rotations": (SOLVED, None, (8, 11), 0),
    "one rotation, one general": (SOLVED, None, (8, 12), 0),
    "one general": (ABOUT, None, (6, 9), 0),
    "the same four times": (ABOUT, None, (6, 9), 0),
    "parallel axes": (ALONG, Z_AXIS, (6, 11), 0),
    "planar": (ALONG, Z_AXIS, (6, 10), 0),
    "rotation and translation across": (ALONG, Z_AXIS, (6, 10), 0),
    "general and two translations": (ALONG, Z_AXIS, (6, 11), 0),
    "rotation and translation along": (ABOUT, Z_AXIS, (6, 9), 0),
    "screws of one axis": (ABOUT, Z_AXIS, (6, 9), 0),
    "three translations": (Outcome.ROTATION_ONLY, None, (0, 9), 0),
    "two translations": (Outcome.ROTATION_ONLY, None, (0, 6), 0),
    "parallel translations": (ABOUT, X_AXIS, (0, 3), 0),
    "nothing": (Outcome.NO_MOTION, None, (0, 0), 0),
    "half turns about perpendicular axes": (SEVERAL, None, (6, 9), 3),
    "half turns about oblique axes": (SEVERAL, None, (7, 10), 1),
    "half turns with a pitch": (SOLVED, None, (6, 12), 0),
    "three half turns": (SOLVED, None, (8, 11), 0),
}


def direction_of(found) -> np.ndarray | None:
    seen = found.observability
    return seen.free_direction if seen.free_axis is None else seen.free_axis


@pytest.mark.parametrize("name", CASES)
def test_exact_motions_get_the_right_verdict_and_direction(name):
    expected, direction, ranks, others = CASES[name]
    for seed in range(3):
        s = Simulation(seed)
        X, B = s.X(), np.stack(case(name, s))
        A = conjugate(X, B)
        found = solve(A, B)
        assert found.outcome is expected, (seed, found.sentence)
        assert found.observability.linear_rank == linear_ranks(A, B) == ranks
        assert len(found.observability.alternatives) == others
        assert np.isfinite(found.X).all()
        # whatever is left free, X itself fits
        assert found.rotation_residuals.max() < 1e-7 and found.translation_residuals.max() < 1e-7
        if direction is not None:
            np.testing.assert_allclose(abs(direction_of(found) @ X[:3, :3] @ direction), 1.0, atol=1e-9)
        if expected in (SOLVED, ALONG, Outcome.ROTATION_ONLY):
            assert errors(found.X, X)[0] < 1e-9
        if expected is ALONG:
            n = found.observability.free_direction
            np.testing.assert_allclose(found.X[:3, 3], X[:3, 3] - n * (n @ X[:3, 3]), atol=1e-8)


def test_the_other_answers_are_answers():
    for name in ("half turns about perpendicular axes", "half turns about oblique axes"):
        s = Simulation(20)
        X, B = s.X(), np.stack(case(name, s))
        A = conjugate(X, B)
        found = solve(A, B)
        every = [found.X, *found.observability.alternatives]
        for other in every:
            np.testing.assert_allclose(A @ other, other @ B, atol=1e-9)
        assert min(max(errors(other, X)) for other in every) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("noise", [1e-3, 1e-2])
@pytest.mark.parametrize("noisy_B", [False, True])
def test_noisy_motions_get_the_right_verdict_and_direction_19_times_in_20(noise, noisy_B):
    total, wrong = 0, []
    for name, (expected, direction, _, _) in CASES.items():
        for seed in range(20):
            s = Simulation(100 + seed)
            X, B = s.X(), np.stack(case(name, s))
            A = s.noisy(conjugate(X, B), noise, noise)
            B = s.noisy(B, noise, noise) if noisy_B else B
            found = solve(A, B)
            total += 1
            assert np.isfinite(found.X).all()
            right = found.outcome is expected
            if right and direction is not None:
                # the shortest motions of these sets turn by 0.3 rad or shift by 1: their axes are off by 3 noise or so
                right = abs(direction_of(found) @ X[:3, :3] @ direction) > np.cos(10 * noise)
            if not right:
                wrong.append((name, seed, found.outcome.name))
    assert len(wrong) <= 0.05 * total, wrong


def every_case(noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """One problem for each case, padded to one length, and sets that are worse: mispaired, doubled, at rest."""
    s = Simulation(50)
    X = s.X()
    sets = {name: np.stack(case(name, s)) for name in CASES}
    A = {name: s.noisy(conjugate(X, B), noise, noise) for name, B in sets.items()}
    general = sets["eight general"]
    sets |= {
        "mispaired": general[::-1],
        "doubled": np.repeat(general[:4], 2, axis=0),
        "at rest": general * 0 + np.eye(4),
    }
    A |= {"mispaired": A["eight general"], "doubled": np.repeat(A["eight general"][:4], 2, axis=0)}
    A |= {"at rest": s.noisy(sets["at rest"], noise, noise)}
    shape = (len(sets), 8, 4, 4)
    padded_A, padded_B = np.full(shape, np.nan), np.full(shape, np.nan)
    for k, name in enumerate(sets):
        padded_A[k, : len(A[name])], padded_B[k, : len(A[name])] = A[name], sets[name]
    return padded_A, padded_B, np.asarray(np.isfinite(padded_A).all(axis=(2, 3))), list(sets)


@pytest.mark.parametrize("method", sorted(METHODS))
@pytest.mark.parametrize("unknown_scale", [False, True])
def test_no_method_ever_answers_nan(method, unknown_scale):
    if unknown_scale and method in KNOWN_SCALE_ONLY:
        return
    for noise in (0.0, 0.01):
        A, B, mask, names = every_case(noise)
        raw = solve_many(A, B, mask, method, unknown_scale, verdict=False)
        assert np.isfinite(raw.X).all(), [names[k] for k in np.flatnonzero(~np.isfinite(raw.X).all(axis=(1, 2)))]
        assert np.isfinite(raw.rotation_residuals[mask]).all() and np.isfinite(raw.translation_residuals[mask]).all()
        if unknown_scale:
            continue
        judged = solve_many(A, B, mask, method)
        assert np.isfinite(judged.X).all()
        if noise == 0.0:
            wrong = [
                (name, Outcome(o).name)
                for name, o in zip(names, judged.outcome, strict=True)
                if name in CASES and Outcome(o) is not CASES[name][0]
            ]
            assert not wrong


def test_pure_rotations_tie_the_scale_to_the_translation():
    for noise in (0.0, 1e-3):
        s = Simulation(30)
        X = s.X()
        B = s.motions(6, length=0.0)
        A = s.noisy(conjugate(X, B), noise, noise)
        A[:, :3, 3] /= 2.0
        found = solve(A, B, unknown_scale=True)
        assert found.outcome is Outcome.SCALE_TIED
        assert np.isnan(found.scale)
        # in the unit of A the answer is X with half its translation
        assert errors(found.X, X)[0] < 10 * noise + 1e-9
        np.testing.assert_allclose(found.X[:3, 3], X[:3, 3] / 2, atol=20 * noise + 1e-9)


def test_turning_about_a_fixed_point_ties_the_scale_too():
    """Not only about the hand's own origin, as RR-3507 §4.2 says: about any fixed point."""
    s = Simulation(31)
    X, centre = s.X(), motion(NONE, [0.3, -0.2, 0.5])
    B = conjugate(centre, s.motions(5, length=0.0))
    A = conjugate(X, B)
    A[:, :3, 3] /= 3.0
    assert solve(A, B, unknown_scale=True).outcome is Outcome.SCALE_TIED


def test_every_outcome_has_a_sentence():
    assert all(outcome.sentence for outcome in Outcome)
    assert len({outcome.sentence for outcome in Outcome}) == len(Outcome)
    assert [outcome for outcome in Outcome if outcome.usable] == [Outcome.SOLVED]
