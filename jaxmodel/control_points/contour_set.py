"""What contour extraction gives: ordered chains of measured edge pixels (thesis §2.4.1)."""

from enum import Enum

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int


class Contour(eqx.Module):
    """One chain of edge pixels, in order along the edge.

    ``pixels (n, 2)`` row and column; ``points (n, 3)`` what was measured there, sensor frame, unit of the data;
    ``kind (n,)`` the :class:`jaxmodel.control_points.edges.EdgeKind` of each; ``closed`` when the last is followed
    by the first, which is not repeated. Chains that meet at a junction each hold its pixel as their end.
    """

    pixels: Int[np.ndarray, "n 2"]
    points: Float[np.ndarray, "n 3"]
    kind: Int[np.ndarray, " n"]
    closed: bool

    def __len__(self) -> int:
        return self.pixels.shape[0]


class ContourOutcome(Enum):
    """How the extraction ended; each value has a ``sentence``."""

    FOUND = "contours were found"
    NO_READING = "the image has no valid pixel"
    NO_EDGE = "the image has no edge of the kinds asked for, as on a single smooth surface"
    TOO_SMALL = "every group of edge pixels is smaller than the least size of a contour"

    @property
    def sentence(self) -> str:
        return self.value


class ContourSet(eqx.Module):
    """The chains of one range image, longest (most pixels) first, none unless ``outcome`` is FOUND."""

    chains: tuple[Contour, ...]
    outcome: ContourOutcome
