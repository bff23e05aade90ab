"""The methods beside the product's own: axis/angle as printed, with unit axes."""

import numpy as np
import pytest

from jaxmodel.calibrate import simulation
from jaxmodel.run.hand_eye.methods import UNIT_AXES, solved

COUNT, MOTIONS = 20, 16


@pytest.fixture(scope="module")
def problems() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """X, B with two large motions and fourteen of a hundredth of their size, and normals for noise."""
    drawn = simulation.normals(3, 0, 0, COUNT, 6 + 12 * MOTIONS)
    X, rest = simulation.rigid(drawn[:, :6], 1.0, 1.0), drawn[:, 6:].reshape(COUNT, 2, MOTIONS, 6)
    small = np.where(np.arange(MOTIONS) < 2, 1.0, 0.01)[:, None]
    return X, simulation.rigid(small * rest[:, 0], 0.8, 1.0), rest[:, 1]


def test_unit_axes_are_exact_without_noise(problems: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    X, B, _ = problems
    found, _ = solved(UNIT_AXES, simulation.conjugate(X, B), B)
    angle, shift = simulation.errors(found, X)
    assert angle.max() < 1e-6 and shift.max() < 1e-6


def test_unit_axes_let_the_noise_of_small_motions_in(problems: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    X, B, drawn = problems
    A = simulation.rigid(drawn, 0.003, 0.003) @ simulation.conjugate(X, B)
    errors = [simulation.errors(solved(method, A, B)[0], X)[0] for method in (UNIT_AXES, "axis/angle")]
    assert np.median(errors[0]) > 5 * np.median(errors[1])
