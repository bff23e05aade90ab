"""The utility: the thesis's curve and its conditions, weights that follow what can be met."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.plan.labels import LABELS, Label
from jaxmodel.plan.utility import LEAST, THESIS, Utility, preference

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
    np.testing.assert_allclose(THESIS(shares, quality), expected, rtol=1e-5)
    np.testing.assert_allclose(THESIS(shares, quality, random.random((20, LABELS))), expected, rtol=1e-5)


def test_what_is_unseen_counts_by_its_promise_and_what_is_known_little() -> None:
    random = np.random.default_rng(1)
    shares, quality, promise = random.dirichlet(np.ones(LABELS), 20), *random.random((2, 20, LABELS))
    ours, theirs = (np.asarray(of.terms(shares, quality, promise)) for of in (Utility(), THESIS))
    for label in (Label.UNKNOWN, Label.OCCLUSION_PLANE):
        K = quality[:, label] if label == Label.OCCLUSION_PLANE else 1.0
        np.testing.assert_allclose(ours[:, label] * K, theirs[:, label] * (1 + promise[:, label]) / 2, rtol=1e-5)
    for label in (Label.OCCUPIED, Label.BORDER):
        np.testing.assert_allclose(ours[:, label], 0.1 * theirs[:, label], rtol=1e-5)
    assert (ours[:, [Label.EMPTY, Label.OCCLUDED]] == 0).all()


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
    fixed = np.asarray(THESIS.attainable(shares).terms(shares, shares))[:, Label.UNKNOWN]
    scheduled = np.asarray(Utility().attainable(shares).terms(shares, shares))[:, Label.UNKNOWN]
    assert np.ptp(fixed) < 0.003
    # f at a third and at two thirds of the way to the peak, by eq. 4.4 by hand
    np.testing.assert_allclose(scheduled, [7 / 27, 20 / 27], atol=1e-4)


def test_a_schedule_rises_with_what_is_unseen_and_keeps_the_thesis_s_shares_of_what_is_known() -> None:
    random = np.random.default_rng(2)
    shares = random.dirichlet(np.ones(LABELS), 50)
    found = Utility().attainable(shares)
    assert found.unknown == found.occlusion_plane
    most = (shares[:, Label.UNKNOWN] + shares[:, Label.OCCLUSION_PLANE]).max()
    assert found.unknown == pytest.approx(min(1.5 * most, 1 - LEAST))
    assert (found.occupied, found.border) == (0.2, 0.05)
    assert THESIS.attainable(shares) is THESIS
    more = shares.copy()
    more[:, Label.UNKNOWN] += 0.5 * more[:, Label.EMPTY]
    assert (np.asarray(found.terms(shares, shares)) <= np.asarray(found.terms(more, shares)) + 1e-6)[:, Label.UNKNOWN][
        more[:, Label.UNKNOWN] <= found.unknown
    ].all()
    nothing = Utility().attainable(np.zeros((3, LABELS)))
    assert np.isfinite(nothing(np.zeros(LABELS), np.zeros(LABELS)))


@pytest.mark.parametrize("value", [0.0, 1.0, -0.2, 1.5, float("nan")])
def test_a_nominal_share_must_lie_between_0_and_1(value: float) -> None:
    with pytest.raises(InputError, match=r"utility\.unknown: expected a share between 0 and 1"):
        Utility(unknown=value)


@pytest.mark.parametrize("name", ["known", "repeat", "promise", "room"])
def test_a_weight_is_zero_or_more(name: str) -> None:
    with pytest.raises(InputError, match=rf"utility\.{name}: expected a weight of zero or more"):
        Utility(**{name: -0.1})  # pyright: ignore[reportArgumentType]
