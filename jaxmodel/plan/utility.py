"""How much a view is worth: the thesis's utility of the labels it meets (thesis §4.3.2, eqs. 4.1-4.9).

Works on NumPy and jax arrays alike; the weights are traced leaves.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmodel.errors import InputError
from jaxmodel.plan.labels import LABELS, Label

LEAST = 1e-3
"""Nearest that a nominal share comes to 0 or 1, where the curve would have no room."""
WEIGHED = (Label.OCCUPIED, Label.OCCLUSION_PLANE, Label.BORDER)
"""Labels with a normal, whose terms are weighed by quality (eq. 4.9)."""


def preference(x: Any, alpha: Any) -> Any:
    """f(x), eqs. 4.1-4.7: 0 at shares 0 and 1, 1 at the nominal share ``alpha``, no slope at any of them.

    Two cubics; the second branch has the factor 2 that eq. 4.7 lost. ``x`` and ``alpha`` broadcast.
    """
    x = jnp.clip(x, 0.0, 1.0)
    rising = jnp.minimum(x / alpha, 1.0)
    falling = jnp.minimum((1 - x) / (1 - alpha), 1.0)
    # the same cubic on both sides, in the part of the way to the peak: (3 - 2 s) s²
    part = jnp.where(x < alpha, rising, falling)
    return (3 - 2 * part) * part * part


class Utility(eqx.Module):
    """Nominal shares α of a view's rays for four labels; the thesis's values are the defaults.

    Raises :class:`InputError` for a share that is not between 0 and 1.
    """

    occupied: Float[Array, ""] | float = 0.20
    occlusion_plane: Float[Array, ""] | float = 0.375
    unknown: Float[Array, ""] | float = 0.375
    border: Float[Array, ""] | float = 0.05

    def __check_init__(self) -> None:
        for name in ("occupied", "occlusion_plane", "unknown", "border"):
            value = getattr(self, name)
            if isinstance(value, int | float) and not 0 < value < 1:
                raise InputError(f"utility.{name}: expected a share between 0 and 1, not {value}.")

    @property
    def alpha(self) -> Float[Array, "6"]:
        """α by label; 0.5, without use, for labels that count for nothing."""
        alpha = [jnp.asarray(0.5)] * LABELS
        alpha[Label.OCCUPIED] = jnp.asarray(self.occupied)
        alpha[Label.OCCLUSION_PLANE] = jnp.asarray(self.occlusion_plane)
        alpha[Label.UNKNOWN] = jnp.asarray(self.unknown)
        alpha[Label.BORDER] = jnp.asarray(self.border)
        return jnp.clip(jnp.stack(alpha).astype(jnp.float32), LEAST, 1 - LEAST)

    def terms(self, shares: Any, quality: Any) -> Any:
        """K f(x) of each label ``(..., 6)``; the utility, minus eq. 4.9, is their sum.

        ``shares`` of all rays, ``quality`` mean cosine K, both ``(..., 6)``.
        """
        weight = jnp.where(jnp.asarray(_weighed()), quality, 1.0)
        return jnp.asarray(_counted()) * weight * preference(shares, self.alpha)

    def __call__(self, shares: Any, quality: Any) -> Any:
        """Utility, from 0 to 4, of views that meet ``shares`` with ``quality``."""
        return jnp.sum(self.terms(shares, quality), axis=-1)

    def attainable(self, best: Float[np.ndarray, "6"]) -> "Utility":
        """The same with no nominal share above the ``best`` that any view can meet now.

        The thesis keeps α fixed: once little is unknown, every view is on the flat foot of the curve and none is better
        than another (ERRATA). With α at what the best view meets, that view has f = 1 however little is left.
        """
        limit = lambda nominal, label: float(np.clip(min(float(nominal), float(best[label])), LEAST, 1 - LEAST))  # noqa: E731
        return Utility(
            occupied=limit(self.occupied, Label.OCCUPIED),
            occlusion_plane=limit(self.occlusion_plane, Label.OCCLUSION_PLANE),
            unknown=limit(self.unknown, Label.UNKNOWN),
            border=limit(self.border, Label.BORDER),
        )


def _weighed() -> np.ndarray:
    return np.isin(np.arange(LABELS), WEIGHED)


def _counted() -> np.ndarray:
    return np.isin(np.arange(LABELS), (*WEIGHED, Label.UNKNOWN)).astype(np.float32)
