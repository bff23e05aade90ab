"""What RR-3507 §2.2.3 leaves to its user, tried on the trajectories: weights and start of the nonlinear method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars
from jaxtyping import Float

from jaxmodel.calibrate import simulation
from jaxmodel.calibrate.nonlinear import QuaternionWeights
from jaxmodel.run.hand_eye.methods import WEIGHTS, solved_by_penalty
from jaxmodel.run.hand_eye.protocol import Motions, shown, spread
from jaxmodel.view.table import Table

STARTS = ("linear", "identity")


@dataclass(frozen=True)
class Weights:
    """lambda_1, lambda_2 and lambda of §2.2.3; lengths in metres."""

    axes: float = float(WEIGHTS.axes)
    translations: float = float(WEIGHTS.translations)
    penalty: float = float(WEIGHTS.penalty)

    def __post_init__(self) -> None:
        for name in ("axes", "translations", "penalty"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, expected above 0")

    @property
    def label(self) -> str:
        return f"{self.axes:g}, {self.translations:g}, {self.penalty:g}"


def measured(
    run: str, motions: Motions, reference: Float[np.ndarray, "b 4 4"], weights: Sequence[Weights]
) -> dict[str, np.ndarray]:
    """Columns of the errors to the reference, for every choice of weights and either start."""
    columns = {}
    for chosen in weights:
        given = QuaternionWeights(chosen.axes, chosen.translations, chosen.penalty)
        for start in STARTS:
            X = solved_by_penalty(*motions, given, start == "identity")
            turn, shift = simulation.errors(X, reference)
            columns |= {_column(run, chosen, start, "turn"): turn, _column(run, chosen, start, "shift"): shift}
    return columns


def _column(run: str, chosen: Weights, start: str, what: str) -> str:
    return f"{run}, weights {chosen.label}, from {start}: {what}"


def summarised(rows: polars.DataFrame, runs: Sequence[str], weights: Sequence[Weights]) -> list[dict[str, Any]]:
    """Median and range of both errors for each choice."""
    return [
        {
            "run": run,
            "weights": chosen.label,
            "start": start,
            **{what: spread(rows[_column(run, chosen, start, what)].to_numpy()) for what in ("turn", "shift")},
        }
        for run in runs
        for chosen in weights
        for start in STARTS
    ]


def weights_table(found: Sequence[Mapping[str, Any]]) -> Table:
    """A row for each choice, a pair of columns for each run."""
    runs = list(dict.fromkeys(of["run"] for of in found))
    rows = []
    for weights, start in dict.fromkeys((of["weights"], of["start"]) for of in found):
        row = [weights, start]
        for run in runs:
            (of,) = [one for one in found if (one["run"], one["weights"], one["start"]) == (run, weights, start)]
            row += [shown(of["turn"]) + "°", shown(of["shift"])]
        rows.append(tuple(row))
    columns = ("lambda_1, lambda_2, lambda", "start", *(f"{run}: {of}" for run in runs for of in ("R", "t")))
    return Table("The nonlinear method of §2.2.3 by its weights and start: errors to the reference", columns, rows)
