"""How well two divisions of the same triangles agree."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment


class Agreement(NamedTuple):
    """Shares of the area. ``matched``: in pairs of one segment with one true face, each used once, paired for the
    largest sum: every cut too many and every cut missing counts. ``purity``: in the true face that holds most of the
    triangle's segment: cuts too many do not count. ``coverage``: in the segment that holds most of the true face.
    """

    matched: float
    purity: float
    coverage: float


def agreement(labels: Int[np.ndarray, " m"], truth: Int[np.ndarray, " m"], areas: Float[np.ndarray, " m"]) -> Agreement:
    """Agreement of ``labels`` with ``truth``, triangle by triangle, weighted by area."""
    rows, columns = labels.max() + 1, truth.max() + 1
    shared = np.bincount(labels * columns + truth, areas, rows * columns).reshape(rows, columns)
    row, column = linear_sum_assignment(shared, maximize=True)
    return Agreement(
        matched=float(shared[row, column].sum() / areas.sum()),
        purity=float(shared.max(axis=1).sum() / areas.sum()),
        coverage=float(shared.max(axis=0).sum() / areas.sum()),
    )
