"""Any method on pairs under a robust loss: motions weighed anew by what the last answer leaves of each."""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.loss import Loss, loss_weights, robust_variance
from jaxmodel.calibrate.pairs import Pairs
from jaxmodel.calibrate.refine import residuals

ROUNDS = 15
ROUNDING = 1e-18


def reweighted(method: Callable[[Pairs], Estimate], pairs: Pairs, loss: Loss) -> tuple[Estimate, Pairs]:
    """The method's estimate and the pairs with the weights that it ends with.

    Residuals are normalised by scales from their medians, rotation and translation apart. Huber's loss limits the pull
    of a wrong motion; Tukey's, which removes it, needs a start that is right already and so begins where Huber's ends.
    """
    estimate = method(pairs)
    if loss == "none":
        return estimate, pairs
    used = pairs.weight > 0
    reach = jnp.max(jnp.sum(pairs.t_A**2 + pairs.t_B**2, axis=1)) + 1e-300

    def weighed(estimate: Estimate, kind: Loss) -> Pairs:
        angle, distance = residuals(pairs, estimate)
        squares = angle**2 / (robust_variance(angle, used, 3) + ROUNDING)
        squares += distance**2 / (robust_variance(distance, used, 3) + ROUNDING * reach)
        weight = pairs.weight * loss_weights(jnp.sqrt(squares / 6), kind)
        return Pairs(pairs.R_A, pairs.t_A, pairs.R_B, pairs.t_B, weight)

    estimate = jax.lax.fori_loop(0, ROUNDS, lambda _, found: method(weighed(found, "huber")), estimate)
    if loss == "tukey":
        estimate = jax.lax.fori_loop(0, ROUNDS, lambda _, found: method(weighed(found, "tukey")), estimate)
    return estimate, weighed(estimate, loss)
