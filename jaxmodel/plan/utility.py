"""How much a view is worth: the thesis's utility of the labels it meets (thesis §4.3.2, eqs. 4.1-4.9).

Works on NumPy and jax arrays alike; the weights are traced leaves.
"""

from dataclasses import replace
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


UNSEEN = (Label.UNKNOWN, Label.OCCLUSION_PLANE)


class Utility(eqx.Module):
    """Nominal shares α of a view's rays for four labels (the thesis's values), and what this project adds to them.

    ``known``: weight of the terms of occupied and border voxels. The thesis's is 1: it trades greed for overlap there;
    where a least overlap is asked of every view anyway, little is left for them to do. ``repeat``: utility lost for a
    view as one already taken. ``likely``: terms of what is unseen are weighed by what its rays promise (:class:`Seen`
    in ``seen``), where the thesis weighs those of occlusion planes by their angle; ``promise`` is the weight that a ray
    without any loses. ``scheduled``: α follows what views can still meet (:meth:`attainable`), ``room`` times the most
    of it: at the peak itself more would count no more. :data:`THESIS` has none of it. Raises :class:`InputError` for a
    share that is not between 0 and 1 or a negative weight.
    """

    occupied: Float[Array, ""] | float = 0.20
    occlusion_plane: Float[Array, ""] | float = 0.375
    unknown: Float[Array, ""] | float = 0.375
    border: Float[Array, ""] | float = 0.05
    known: Float[Array, ""] | float = 0.1
    repeat: Float[Array, ""] | float = 0.3
    promise: Float[Array, ""] | float = 0.5
    room: Float[Array, ""] | float = 1.5
    likely: bool = eqx.field(static=True, default=True)
    scheduled: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        for name in ("occupied", "occlusion_plane", "unknown", "border"):
            value = getattr(self, name)
            if isinstance(value, int | float) and not 0 < value < 1:
                raise InputError(f"utility.{name}: expected a share between 0 and 1, not {value}.")
        for name in ("known", "repeat", "promise", "room"):
            value = getattr(self, name)
            if isinstance(value, int | float) and not 0 <= value < np.inf:
                raise InputError(f"utility.{name}: expected a weight of zero or more, not {value}.")

    @property
    def alpha(self) -> Float[Array, "6"]:
        """α by label; 0.5, without use, for labels that count for nothing."""
        alpha = [jnp.asarray(0.5)] * LABELS
        alpha[Label.OCCUPIED] = jnp.asarray(self.occupied)
        alpha[Label.OCCLUSION_PLANE] = jnp.asarray(self.occlusion_plane)
        alpha[Label.UNKNOWN] = jnp.asarray(self.unknown)
        alpha[Label.BORDER] = jnp.asarray(self.border)
        return jnp.clip(jnp.stack(alpha).astype(jnp.float32), LEAST, 1 - LEAST)

    def terms(self, shares: Any, quality: Any, promise: Any = 1.0) -> Any:
        """K f(x) of each label ``(..., 6)``; the utility, minus eq. 4.9, is their sum.

        ``shares`` of all rays, ``quality`` mean cosine, ``promise`` mean promise, each ``(..., 6)``.
        """
        unseen = jnp.asarray(_among(UNSEEN))
        angle = jnp.where(jnp.asarray(_among(WEIGHED)), quality, 1.0)
        K = 1 - self.promise * (1 - promise) if self.likely else angle
        K = jnp.where(unseen, K, self.known * angle)
        return jnp.asarray(_among((*WEIGHED, Label.UNKNOWN))) * K * preference(shares, self.alpha)

    def __call__(self, shares: Any, quality: Any, promise: Any = 1.0) -> Any:
        """Utility of views that meet ``shares`` with ``quality`` and ``promise``."""
        return jnp.sum(self.terms(shares, quality, promise), axis=-1)

    def attainable(self, shares: Float[np.ndarray, "v 6"]) -> "Utility":
        """The same with nominal shares that follow what the best of views with ``shares`` meet now.

        The thesis keeps α fixed: once little is unknown, every view is on the flat foot of the curve and none is better
        than another (ERRATA). Here the nominal share of both unseen labels is the largest part of its rays that any
        view has on them, so that more is always better and the best has a term near 1 however little is left; for
        labels of what is known it is the thesis's, or the most that can be met where that is less.
        """
        if not self.scheduled:
            return self
        unseen = self._nominal(shares)
        limit = lambda nominal, label: float(  # noqa: E731
            np.clip(min(float(nominal), float(shares[:, label].max(initial=0.0))), LEAST, 1 - LEAST)
        )
        return replace(
            self,
            occupied=limit(self.occupied, Label.OCCUPIED),
            occlusion_plane=unseen,
            unknown=unseen,
            border=limit(self.border, Label.BORDER),
        )

    def raised(self, shares: Float[np.ndarray, "v 6"]) -> "Utility":
        """The same with the nominal shares of what is unseen no lower than any of these views has them."""
        unseen = self._nominal(shares)
        if not self.scheduled or unseen <= float(self.unknown):
            return self
        return replace(self, occlusion_plane=unseen, unknown=unseen)

    def _nominal(self, shares: Float[np.ndarray, "v 6"]) -> float:
        """Nominal share of what is unseen, for views with these shares."""
        most = float(shares[:, list(UNSEEN)].sum(axis=1).max(initial=0.0))
        return float(np.clip(float(self.room) * most, LEAST, 1 - LEAST))


THESIS = Utility(known=1.0, repeat=0.0, likely=False, scheduled=False)
"""The utility of eqs 4.1 to 4.9 with the thesis's fixed nominal shares."""


def _among(labels: tuple[Label, ...]) -> np.ndarray:
    return np.isin(np.arange(LABELS), labels)
