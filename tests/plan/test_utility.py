"""The utility: the thesis's curve and its conditions, weights that follow what can be met."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.plan.labels import LABELS, Label
from jaxmodel.plan.utility import Utility, preference

ALPHAS = np.array([0.001, 0.05, 0.2, 0.375, 0.5, 0.9])


def coefficients(alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """A, B, C, D of both branches as eq. 4.6 gives them."""
    below = np.array([-2 / alpha**3, 3 / alpha**2, 0, 0])
    above = np.array([-2, 3 * (alpha + 1), -6 * alpha, 3 * alpha - 1]) / (alpha - 1) ** 3
    return below, above


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_conditions_of_the_curve(alpha: float) -> None:
    """Eq. 4.2: values and slopes at 0, alpha and 1; eq. 4.3: rising before, falling after, positive between."""
    slope = jax.grad(lambda x: preference(x, alpha))
    assert preference(0.0, alpha) == 0 and preference(1.0, alpha) == 0
    assert float(preference(alpha, alpha)) == pytest.approx(1, abs=1e-6)
    assert [float(slope(x)) for x in (0.0, 1.0)] == [0, 0]
    assert abs(float(slope(float(np.float32(alpha))))) < 1e-2
    below, above = np.linspace(0.02, 0.98, 30) * alpha, alpha + np.linspace(0.02, 0.98, 30) * (1 - alpha)
    assert (np.asarray(jax.vmap(slope)(below)) > 0).all()
    assert (np.asarray(jax.vmap(slope)(above)) < 0).all()
    assert (np.asarray(preference(np.concatenate([below, above]), alpha)) > 0).all()


@pytest.mark.parametrize("alpha", ALPHAS[1:])
def test_the_curve_is_the_piecewise_cubic_of_equation_4_6(alpha: float) -> None:
    x = np.linspace(0, 1, 101)
    below, above = coefficients(alpha)
    expected = np.where(x < alpha, np.polyval(below, x), np.polyval(above, x))
    np.testing.assert_allclose(preference(x, alpha), expected, atol=2e-5)


def test_the_slope_is_finite_beyond_the_ends() -> None:
    for x in (-0.1, 0.0, 1.0, 1.1):
        assert np.isfinite(jax.grad(lambda x: preference(x, 0.2))(x))


def test_the_sum_of_equation_4_9() -> None:
    """Four labels count, three of them by their quality."""
    random = np.random.default_rng(0)
    shares, quality = random.dirichlet(np.ones(LABELS), 20), random.random((20, LABELS))
    f = lambda label, alpha: np.asarray(preference(shares[:, label], alpha))  # noqa: E731
    expected = (
        quality[:, Label.OCCUPIED] * f(Label.OCCUPIED, 0.20)
        + quality[:, Label.OCCLUSION_PLANE] * f(Label.OCCLUSION_PLANE, 0.375)
        + f(Label.UNKNOWN, 0.375)
        + quality[:, Label.BORDER] * f(Label.BORDER, 0.05)
    )
    np.testing.assert_allclose(Utility()(shares, quality), expected, rtol=1e-5)


def test_weights_are_traced() -> None:
    traces = []

    @jax.jit
    def value(utility: Utility, shares: jax.Array) -> jax.Array:
        traces.append(1)
        return utility(shares, jnp.ones(LABELS))

    shares = jnp.full(LABELS, 1 / LABELS)
    values = {float(value(Utility(unknown=jnp.float32(alpha)), shares)) for alpha in (0.1, 0.2, 0.3)}
    assert len(traces) == 1 and len(values) == 3


def test_fixed_shares_die_and_scheduled_ones_do_not() -> None:
    """With one ray in a hundred on the unknown, the fixed curve hardly tells views apart; the scheduled one does."""
    shares = np.zeros((2, LABELS))
    shares[:, Label.UNKNOWN] = 0.005, 0.01
    fixed = np.asarray(Utility().terms(shares, shares))[:, Label.UNKNOWN]
    scheduled = np.asarray(Utility().attainable(shares.max(axis=0)).terms(shares, shares))[:, Label.UNKNOWN]
    assert np.ptp(fixed) < 0.003
    assert np.ptp(scheduled) == pytest.approx(0.5, abs=1e-4)
    assert scheduled.max() == pytest.approx(1, abs=1e-5)


def test_a_schedule_never_asks_for_more_than_the_nominal_share() -> None:
    whole = Utility().attainable(np.ones(LABELS))
    assert [float(getattr(whole, name)) for name in ("occupied", "occlusion_plane", "unknown", "border")] == [
        0.2,
        0.375,
        0.375,
        0.05,
    ]
    nothing = Utility().attainable(np.zeros(LABELS))
    assert np.isfinite(nothing(np.zeros(LABELS), np.zeros(LABELS)))


@pytest.mark.parametrize("value", [0.0, 1.0, -0.2, 1.5, float("nan")])
def test_a_nominal_share_must_lie_between_0_and_1(value: float) -> None:
    with pytest.raises(InputError, match=r"utility\.unknown: expected a share between 0 and 1"):
        Utility(unknown=value)
