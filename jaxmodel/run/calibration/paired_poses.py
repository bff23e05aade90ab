"""Both streams of a hand-eye calibration, paired."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.calibrate.synchronise import Synchronised


@dataclass(frozen=True)
class PairedPoses:
    """Poses of both streams row by row, in metres, each with its place in the file (``line 7``).

    ``groups``: poses of one group share the scale of their camera translations. ``notes``: sentences about what was
    left out or assumed.
    """

    hand: Float[np.ndarray, "n 4 4"]
    camera: Float[np.ndarray, "n 4 4"]
    places: tuple[str, ...]
    files: tuple[Path, ...]
    groups: tuple[str, ...] | None = None
    synchronised: Synchronised | None = None
    notes: tuple[str, ...] = ()

    def rows(self, kept: Int[np.ndarray, " k"]) -> "PairedPoses":
        """Only the rows ``kept`` (indices)."""
        return replace(
            self,
            hand=self.hand[kept],
            camera=self.camera[kept],
            places=tuple(self.places[k] for k in kept),
            groups=None if self.groups is None else tuple(self.groups[k] for k in kept),
        )
