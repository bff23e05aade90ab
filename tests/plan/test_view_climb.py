"""Residuals of a climb, and that they lead to better views of the soft utility."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.plan.labels import LABELS, Label
from jaxmodel.plan.ray_march import ready
from jaxmodel.plan.utility import Utility
from jaxmodel.plan.view_climb import Shortfall, climbed
from jaxmodel.plan.view_scores import Scorer, leaders

ONE = jnp.ones(LABELS)


def test_nothing_is_lacking_at_the_nominal_shares_and_the_overlap() -> None:
    weights = Utility(unknown=0.4, occlusion_plane=0.3)
    shares = jnp.zeros(LABELS).at[Label.UNKNOWN].set(0.4).at[Label.OCCLUSION_PLANE].set(0.3).at[Label.OCCUPIED].set(0.3)
    residuals = np.asarray(Shortfall(weights, ONE, jnp.float32(0.25))(shares, ONE))
    np.testing.assert_allclose(residuals, [1e-3, 1e-3, 0.0], atol=1e-6)
    lacking = np.asarray(Shortfall(weights, ONE, jnp.float32(0.5))(shares, ONE))
    assert lacking[2] == pytest.approx(3.0 * 0.2, rel=1e-4) and (lacking[:2] == residuals[:2]).all()


def test_residuals_and_their_slopes_are_finite_where_nothing_is_met() -> None:
    law = Shortfall(Utility(), ONE, jnp.float32(0.3))
    for shares in (jnp.zeros(LABELS), jnp.ones(LABELS) / LABELS, jnp.zeros(LABELS).at[Label.UNKNOWN].set(1.0)):
        assert np.isfinite(law(shares, ONE)).all()
        assert np.isfinite(jax.jacfwd(lambda s: law(s, ONE))(shares)).all()


@pytest.mark.slow
def test_climbs_end_at_better_views_more_often_than_at_worse(valve: Any) -> None:
    """From views that are not the best of their surroundings, by exact scores of the thesis's terms."""
    map = valve.maps[2]
    scorer = Scorer(map, ready(map), valve.sensor, valve.sphere, Utility(repeat=0.0, likely=False), 0.0, None, ())
    found = scorer(valve.sphere.spread(400, 3))
    weights = scorer.weights.attainable(found.seen.shares)
    found = scorer._replace(weights=weights).scored(found.parameters, found.poses, found.seen)
    middling = found.take(np.argsort(-found.value)[100:300])
    starts = middling.take(leaders(middling, 16, valve.sphere.spacing(400), 0.0))
    ends = climbed(scorer._replace(weights=weights), starts, 0.0)
    assert len(ends.value) == len(starts.value) >= 8
    assert np.mean(ends.value > starts.value) > 0.5 and ends.value.mean() > starts.value.mean()
