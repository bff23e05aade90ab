"""Views placed on the model: what is believed is the fit's to say, and the truth only measures it."""

import jax
import numpy as np
import pytest

from jaxmodel.register.onto_model import Fit, FitOutcome
from jaxmodel.run.planning import placing
from jaxmodel.run.planning.object_scene import SceneOptions, object_scene
from jaxmodel.run.planning.objects import planning_object
from jaxmodel.run.planning.placing import Placer

OPTIONS = SceneOptions(pixels=80, cells=16, samples=200, reaching=20)


@pytest.fixture(scope="module")
def scene():
    return object_scene("block_curved", planning_object("block_curved").mesh, OPTIONS)


def placer(scene, first: np.ndarray) -> Placer:
    made = Placer(2.0, 0.01, scene.size, np.random.default_rng(0))
    made.first(scene.scan(first, 0.0, jax.random.key(0)), first)
    return made


def two_views(scene) -> np.ndarray:
    return scene.sphere.poses(np.array([[0.2, 0.3], [0.8, 0.4]]))


def test_a_view_is_placed_from_where_it_was_put(scene) -> None:
    one, two = two_views(scene)
    placed = placer(scene, one)(scene.scan(two, 0.0, jax.random.key(1)), two)
    assert placed.sure and placed.report.right
    assert placed.report.start_deg == pytest.approx(2.0, abs=1e-6)
    assert placed.report.start_shift == pytest.approx(0.01, rel=1e-6)
    assert placed.report.error_deg < 0.5 and placed.report.error_shift < 0.005


@pytest.mark.parametrize(
    ("outcome", "turn_deg", "shift", "believed"),
    [
        (FitOutcome.FITTED, 1.9, 0.019, True),
        (FitOutcome.FITTED, 2.1, 0.019, False),
        (FitOutcome.FITTED, 1.9, 0.021, False),
        (FitOutcome.LITTLE_SHARED, 0.1, 0.001, False),
    ],
)
def test_the_fit_says_whether_it_is_believed(scene, monkeypatch, outcome, turn_deg, shift, believed) -> None:
    covariance = np.diag([np.deg2rad(turn_deg) ** 2] * 3 + [(shift * scene.size) ** 2] * 3)
    # far from the truth: that must not matter
    off = np.eye(4)
    off[0, 3] = scene.size
    monkeypatch.setattr(placing, "fit_onto", lambda *of: Fit(outcome, off, covariance, 0.9, 0.0))
    one, two = two_views(scene)
    placed = placer(scene, one)(scene.scan(two, 0.0, jax.random.key(1)), two)
    assert bool(placed.sure) is believed
    assert not placed.report.right


def test_a_view_of_nothing_is_not_believed(scene) -> None:
    one, two = two_views(scene)
    away = two.copy()
    away[:3, [0, 2]] *= -1
    placed = placer(scene, one)(scene.scan(away, 0.0, jax.random.key(1)), away)
    assert not placed.sure and np.isnan(placed.report.error_deg)
