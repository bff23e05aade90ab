"""The ranks that RR-3507 derives (§3.2.2, 4.2), counted: of the systems for X, and of those with unknown scales."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars
from jaxtyping import Float

from jaxmodel.calibrate import simulation
from jaxmodel.calibrate.observability import linear_ranks
from jaxmodel.calibrate.self_calibration import scale_system
from jaxmodel.run.published import published_table
from jaxmodel.view.table import Table

SETS = {
    "one translation": ("translation",),
    "three translations": ("translation",) * 3,
    "one rotation": ("rotation",),
    "one rotation by pi": ("half turn",),
    "one general motion": ("general",),
    "two rotations": ("rotation",) * 2,
    "rotation and general motion": ("rotation", "general"),
    "two rotations and a translation": ("rotation", "rotation", "translation"),
    "two general motions": ("general",) * 2,
    "three general motions": ("general",) * 3,
}
SYSTEMS = {
    "rotation": "R_X, eq. 3.13",
    "whole": "X, eq. 3.12",
    "scale": "t_X and a scale, eq. 4.3",
    "scales": "t_X and a scale for each motion, eq. 4.4",
}


def ranks(X: Float[np.ndarray, "4 4"], B: Float[np.ndarray, "n 4 4"]) -> dict[str, float]:
    """Rank of each system for exact motions of the hand."""
    A = simulation.conjugate(X, B)
    rotation, whole = linear_ranks(A, B)
    found = {"rotation": rotation, "whole": whole}
    for name, group in (("scale", np.zeros(len(B), int)), ("scales", np.arange(len(B)))):
        system = scale_system(A, B, X[:3, :3], group)[0]
        found[name] = int(np.linalg.matrix_rank(system, tol=1e-9 * np.linalg.norm(system)))
    return {f"rank_{name}": float(value) for name, value in found.items()}


def unknowns(system: str, motions: int) -> int:
    """Unknowns of a system."""
    return {"rotation": 9, "whole": 12, "scale": 4, "scales": 3 + motions}[system]


def counted(name: str, rows: polars.DataFrame) -> dict[str, Any]:
    """All ranks that the draws of a set gave."""
    return {"motions": name, **{of: sorted({int(rank) for rank in rows[f"rank_{of}"].to_list()}) for of in SYSTEMS}}


def ranks_table(found: Sequence[Mapping[str, Any]], command: str) -> Table:
    """Published | ours, every system of every set."""
    data = published_table("hand_eye")["ranks"]
    rows = []
    for of in found:
        for system, what in SYSTEMS.items():
            ours = " or ".join(str(rank) for rank in of[system])
            said = data[of["motions"]].get(system)
            verdict = "" if said is None else "confirmed" if ours == str(said) else "contradicted"
            of_all = unknowns(system, len(SETS[of["motions"]]))
            rows.append((of["motions"], what, str(of_all), "" if said is None else str(said), ours, verdict))
    columns = ("motions", "system for", "unknowns", "published", "ours", "verdict")
    return Table(f"Published | ours, ranks (§3.2.2, 4.2) | {command}", columns, rows)


def rank_statement(found: Sequence[Mapping[str, Any]]) -> tuple[str, bool]:
    """How many of the published ranks ours are, and whether all."""
    data = published_table("hand_eye")["ranks"]
    both = [
        (f"{of['motions']}, {SYSTEMS[system]}: {said} published, {' or '.join(map(str, of[system]))} counted",
         of[system] == [said])
        for of in found
        for system, said in data[of["motions"]].items()
    ]  # fmt: skip
    wrong = [sentence for sentence, same in both if not same]
    words = f"{len(both) - len(wrong)} of {len(both)}" + (f"; not: {'; '.join(wrong)}" if wrong else "")
    return words, not wrong
