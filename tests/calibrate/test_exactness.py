"""Exact motions give X exactly: two to fifty of them, 1e-4 rad to pi, every sign convention, every method."""

import numpy as np
import pytest
from calibration_cases import Simulation, conjugate, errors
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import Outcome, solve_many
from jaxmodel.calibrate.solve import METHODS

EVERY = sorted(METHODS)
COUNTS = (2, 3, 8, 50)
LONGEST = max(COUNTS)
MOST_SETS = 108  # of one collection: the others are filled up with sets of no motion


class Sets:
    """Sets of motions padded to one length and number, so that each method compiles once."""

    def __init__(self) -> None:
        self.A: list[np.ndarray] = []
        self.B: list[np.ndarray] = []
        self.mask: list[np.ndarray] = []
        self.X: list[np.ndarray] = []

    def add(self, A: np.ndarray, B: np.ndarray, X: np.ndarray) -> None:
        rest = np.broadcast_to(np.eye(4), (LONGEST - len(A), 4, 4))
        self.A.append(np.concatenate([A, rest]))
        self.B.append(np.concatenate([B, rest]))
        self.mask.append(np.arange(LONGEST) < len(A))
        self.X.append(X)

    def add_every_sign(self, B: np.ndarray, X: np.ndarray) -> None:
        """As they are, every other motion run backwards, and the two streams exchanged (then X is the inverse)."""
        A = conjugate(X, B)
        self.add(A, B, X)
        half = np.arange(len(A))[:, None, None] % 2 == 0
        self.add(np.where(half, np.linalg.inv(A), A), np.where(half, np.linalg.inv(B), B), X)
        self.add(B, A, np.linalg.inv(X))

    def solved(self, method: str) -> tuple[list[Outcome], np.ndarray]:
        empty = MOST_SETS - len(self.X)
        none = np.broadcast_to(np.eye(4), (empty, LONGEST, 4, 4))
        mask = np.concatenate([np.stack(self.mask), np.zeros((empty, LONGEST), bool)])
        found = solve_many(np.concatenate([self.A, none]), np.concatenate([self.B, none]), mask, method)
        X, outcomes = found.X[: len(self.X)], found.outcome[: len(self.X)]
        assert np.isfinite(X).all() and (found.outcome[len(self.X) :] == Outcome.NO_MOTION).all()
        worst = [errors(one, true) for one, true in zip(X, self.X, strict=True)]
        return [Outcome(o) for o in outcomes], np.array(worst)


def sets(angles: tuple[float | tuple[float, float], ...], seed: int, angles_of_X=(0.0, 1.5, np.pi)) -> Sets:
    result = Sets()
    for k, angle in enumerate(angles):
        for count in COUNTS:
            for angle_of_X in angles_of_X:
                s = Simulation(1000 * seed + 100 * k + count)
                result.add_every_sign(s.motions(count, angle), s.X(angle_of_X))
    return result


@pytest.fixture(scope="module")
def usual() -> Sets:
    return sets(((1e-2, np.pi), 1e-2, 3.0), 1)


@pytest.fixture(scope="module")
def small() -> Sets:
    return sets((1e-4, 1e-3), 2)


@pytest.fixture(scope="module")
def half_turns() -> Sets:
    return sets((np.pi - 1e-4, np.pi), 3, (1.5,))


def check(found: tuple[list[Outcome], np.ndarray], turn: float, shift: float) -> None:
    outcomes, worst = found
    assert all(outcome is Outcome.SOLVED for outcome in outcomes)
    assert worst[:, 0].max() < turn and worst[:, 1].max() < shift, worst.max(axis=0)


@pytest.mark.parametrize("method", EVERY)
def test_from_a_hundredth_to_pi(method, usual):
    check(usual.solved(method), 1e-9, 1e-9)


@pytest.mark.parametrize("method", EVERY)
def test_down_to_a_ten_thousandth(method, small):
    check(small.solved(method), 1e-9, 1e-6)


@pytest.mark.parametrize("method", EVERY)
def test_half_turns_of_oblique_axes(method, half_turns):
    """Linear equations alone leave two half turns ambiguous; what the translations add makes X the one answer."""
    check(half_turns.solved(method), 1e-9, 1e-9)


def test_the_sets_are_what_they_claim(usual, small):
    for collection, least in ((usual, 1e-2), (small, 1e-4)):
        angles = np.concatenate(
            [
                Rotation.from_matrix(B[mask][:, :3, :3]).magnitude()
                for B, mask in zip(collection.B, collection.mask, strict=True)
            ]
        )
        assert abs(angles.min() / least - 1) < 0.5
        axes = [
            Rotation.from_matrix(B[:2, :3, :3]).as_rotvec()
            / np.linalg.norm(Rotation.from_matrix(B[:2, :3, :3]).as_rotvec(), axis=1, keepdims=True)
            for B in collection.B
        ]
        assert max(abs(pair[0] @ pair[1]) for pair in axes) < np.cos(np.radians(29.9))
