"""Unknown scales: common, by groups, by motion; exact without noise, and tied where the hand only turns."""

import numpy as np
import pytest
from calibration_cases import Simulation, conjugate, errors, motion

from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.self_calibration import Scales, self_calibrate
from jaxmodel.errors import InputError

GROUPS = np.array([0, 0, 1, 1, 1, 2, 2, 2])


def problem(seed: int, scales: np.ndarray, length: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s = Simulation(seed)
    X, B = s.X(), s.motions(len(scales), length=length)
    A = conjugate(X, B)
    A[:, :3, 3] /= scales[:, None]
    return X, A, B


@pytest.mark.parametrize("refine", [False, True])
@pytest.mark.parametrize(
    ("kind", "group", "scales"),
    [
        (Scales.COMMON, None, np.full(8, 2.5)),
        (Scales.GROUPS, GROUPS, np.array([2.0, 3.0, 0.5])[GROUPS]),
        (Scales.MOTIONS, None, np.linspace(0.2, 8.0, 8)),
    ],
)
def test_exact_scales(kind, group, scales, refine):
    for seed in range(3):
        X, A, B = problem(seed, scales)
        found = self_calibrate(A, B, kind, group, refine)
        assert found.outcome is Outcome.SOLVED and found.determined.all()
        assert max(errors(found.X, X)) < 1e-9
        np.testing.assert_allclose(found.scale[found.group], scales, rtol=1e-9)
        assert found.translation_residuals.max() < 1e-9


@pytest.mark.parametrize("kind", [Scales.COMMON, Scales.MOTIONS])
def test_a_hand_that_only_turns_ties_scale_and_translation(kind):
    X, A, B = problem(3, np.full(6, 2.0), length=0.0)
    found = self_calibrate(A, B, kind)
    assert found.outcome is Outcome.SCALE_TIED
    assert np.isnan(found.scale).all() and not found.determined.any()
    assert errors(found.X, X)[0] < 1e-9
    np.testing.assert_allclose(found.X[:3, 3], X[:3, 3] / 2.0, atol=1e-8)


def test_turning_about_another_fixed_point_ties_them_too():
    X, _, B = problem(4, np.ones(6), length=0.0)
    B = conjugate(motion([0, 0, 0], [0.4, -0.3, 0.2]), B)
    A = conjugate(X, B)
    for kind in (Scales.COMMON, Scales.MOTIONS):
        assert self_calibrate(A, B, kind).outcome is Outcome.SCALE_TIED


def test_a_known_translation_of_known_scale_unties_them():
    s = Simulation(5)
    X = s.X()
    B = np.concatenate([s.motions(4, length=0.0), motion([0, 0, 0], [0.3, 0.1, -0.2])[None]])
    A = conjugate(X, B)
    A[:, :3, 3] /= 3.0
    found = self_calibrate(A, B)
    assert found.outcome is Outcome.SOLVED
    assert max(errors(found.X, X)) < 1e-9 and abs(found.scale[0] / 3 - 1) < 1e-9


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_separate_translation_fixes_only_its_own_scale(noise):
    """Two pure rotations and one pure translation: eq. 4.4 has rank 5 of 6, eq. 4.3 all of its 4."""
    s = Simulation(3)
    X = s.X()
    B = np.stack(
        [motion([0.8, 0, 0], [0, 0, 0]), motion([0, 0.9, 0.1], [0, 0, 0]), motion([0, 0, 0], [0.3, 0.2, -0.1])]
    )
    A = s.noisy(conjugate(X, B), noise, noise)
    scales = np.array([2.0, 3.0, 4.0])
    each, common = A.copy(), A.copy()
    each[:, :3, 3] /= scales[:, None]
    common[:, :3, 3] /= 2.0
    close = 1e-9 + 20 * noise
    found = self_calibrate(each, B, Scales.MOTIONS)
    assert found.outcome is Outcome.SCALE_TIED
    assert found.determined.tolist() == [False, False, True] and np.isnan(found.scale[:2]).all()
    assert abs(found.scale[2] / 4 - 1) < close
    # tied: the translation in the unit of the first motion
    np.testing.assert_allclose(2 * found.X[:3, 3], X[:3, 3], atol=close)
    for kind, group in ((Scales.COMMON, None), (Scales.GROUPS, np.array([0, 1, 1]))):
        found = self_calibrate(common, B, kind, group)
        assert found.outcome is Outcome.SOLVED and found.determined.all()
        assert max(errors(found.X, X)) < close and np.abs(found.scale / 2 - 1).max() < close
    found = self_calibrate(common, B, Scales.GROUPS, np.array([0, 0, 1]))
    assert found.outcome is Outcome.SCALE_TIED and found.determined.tolist() == [False, True]


def test_small_motions_keep_the_scale_and_lose_the_translation():
    """1.5 - 3 degrees: the scale is as good as at 15 - 30, the translation an order of magnitude worse."""
    small, large = (np.median(thirty(low, 2 * low), axis=0) for low in (1.5, 15.0))
    assert small[0] < 3e-3
    assert 4 < small[1] / large[1] < 20


def thirty(low_deg: float, high_deg: float) -> np.ndarray:
    """Relative errors of scale and translation: 40 runs of 30 motions with 1 % noise of the camera's."""
    found_errors = []
    for seed in range(40):
        s = Simulation(seed)
        X, B = s.X(), s.motions(30, (np.radians(low_deg), np.radians(high_deg)))
        A = conjugate(X, B)
        lengths = np.linalg.norm(A[:, :3, 3], axis=1)
        A = s.noisy(A, 0.01 * np.radians((low_deg + high_deg) / 2), 0.0)
        A[:, :3, 3] += 0.01 * lengths[:, None] * s.rng.normal(size=(30, 3))
        A[:, :3, 3] /= 2.5
        found = self_calibrate(A, B)
        found_errors.append((abs(found.scale[0] / 2.5 - 1), errors(found.X, X)[1]))
    return np.array(found_errors)


def test_thirty_motions_at_one_percent():
    """Median error of the scale below 0.3 %, of the translation below 3 % at 15 - 30 degrees."""
    scale, shift = np.median(thirty(15, 30), axis=0)
    assert scale < 3e-3 and shift < 3e-2


def test_the_deviation_of_the_scale_is_that_of_its_errors():
    normal = []
    for seed in range(60):
        s = Simulation(seed)
        X, B = s.X(), s.motions(12)
        A = s.noisy(conjugate(X, B), 1e-6, 0.02)
        found = self_calibrate(A, B)
        normal.append((found.scale[0] - 1.0) / found.scale_deviation[0])
    assert 0.75 < np.std(normal) < 1.3


def test_parallel_axes_give_the_partial_answer():
    s = Simulation(6)
    X = s.X()
    B = np.stack([motion([0, 0, a], s.rng.normal(size=3)) for a in (0.4, 0.9, -0.6, 1.2)])
    found = self_calibrate(conjugate(X, B), B)
    assert found.outcome is Outcome.TRANSLATION_ALONG_AXIS
    assert errors(found.X, X)[0] < 1e-8


def test_bad_input_is_named():
    _, A, B = problem(7, np.ones(4))
    with pytest.raises(InputError, match="A has 4 rows and B has 3"):
        self_calibrate(A, B[:3])
    with pytest.raises(InputError, match="it is needed for scales='groups'"):
        self_calibrate(A, B, Scales.GROUPS)
    with pytest.raises(InputError, match="it has 3 entries"):
        self_calibrate(A, B, Scales.GROUPS, np.array([0, 0, 1]))
