"""The best few views improved along the gradient of the soft utility, and scored exactly again (thesis §4.3.2)."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmodel.plan.labels import Label
from jaxmodel.plan.soft_utility import levenberg_marquardt
from jaxmodel.plan.utility import UNSEEN, Utility
from jaxmodel.plan.view_scores import Scorer, Scores, planning_sensor

RAYS = 256
"""Rays of a soft view: its gradient costs a hundred exact ones."""
STRAIN = 3.0
"""Residual of a view without any overlap, where the least one is asked for."""


class Shortfall(eqx.Module):
    """Residuals of a view: the root of what each term of the utility lacks to its most, and lacking overlap.

    The terms of what is known count little and pull elsewhere: only those of the unseen are climbed. Their promise is
    held at that of the starts, which misleads where it changes quickly: climbs of the thesis's terms end at better
    views far more often.
    """

    weights: Utility
    promise: Float[Array, "6"]
    least_overlap: Float[Array, ""]

    def __call__(self, shares: Float[Array, "6"], quality: Float[Array, "6"]) -> Float[Array, "3"]:
        """From soft shares and qualities by label."""
        terms = self.weights.terms(shares, quality, self.promise)[jnp.asarray([int(label) for label in UNSEEN])]
        known = shares[Label.OCCUPIED] + shares[Label.BORDER]
        lacking = jax.nn.relu(self.least_overlap - known / (jnp.sum(shares) + 1e-6))
        return jnp.concatenate([jnp.sqrt(jnp.maximum(1 - terms, 0) + 1e-6), STRAIN * lacking[None]])


def climbed(scorer: Scorer, few: Scores, least_overlap: float, max_steps: int = 8) -> Scores:
    """Exact scores of the views that climbs from ``few`` end at, as many, as far as the view space allows them."""
    met = few.seen.counts.sum(axis=0)
    promise = np.where(met > 0, few.seen.promise.sum(axis=0) / np.maximum(met, 1), 1.0)
    found = levenberg_marquardt(
        scorer.map,
        planning_sensor(scorer.sensor, RAYS),
        scorer.views.pose,
        Shortfall(scorer.weights, jnp.asarray(promise, jnp.float32), jnp.float32(least_overlap)),
        few.parameters,
        scorer.views.origin,
        max_steps=max_steps,
    )
    return scorer(found.parameter)
