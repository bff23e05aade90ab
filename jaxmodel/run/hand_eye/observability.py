"""The experiment ``hand_eye_observability`` (RR-3507 §3.2.2, Table 3.1): what each pair of motions determines.

Every cell of the table on random motions, exact and noisy, with the ranks that the text derives; and pure rotations of
the camera, which by exchanging the roles of A and B become the decoupled case.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import Outcome, simulation, solve
from jaxmodel.geometry import se3
from jaxmodel.io.results import RunDir
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.ranks import SETS, counted, rank_statement, ranks, ranks_table
from jaxmodel.run.hand_eye.report import chosen_table, draw_hand_eye
from jaxmodel.run.hand_eye.study import Cell, HandEyeStudy, Measured
from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

KINDS = ("translation", "rotation", "general")
EXPECTED = {
    frozenset(("translation",)): Outcome.ROTATION_ONLY,
    frozenset(("translation", "rotation")): Outcome.TRANSLATION_ALONG_AXIS,
    frozenset(("translation", "general")): Outcome.TRANSLATION_ALONG_AXIS,
}
"""What Table 3.1 says of two kinds; all others determine the whole of X."""
_IN_TABLE = {
    Outcome.SOLVED: "R, t",
    Outcome.TRANSLATION_ALONG_AXIS: "R, t(alpha)",
    Outcome.ROTATION_ONLY: "R",
}


@dataclass(frozen=True, kw_only=True)
class Config:
    """The YAML: ``draws`` of every cell, exact and with ``noise`` (rad and relative length) in the camera."""

    experiment: Literal["hand_eye_observability"] = "hand_eye_observability"
    seed: int = 0
    draws: int = 20
    chunk: int = 20
    noise: float = 1e-3

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("draws", 1), ("chunk", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {least} or more")
        if not self.noise > 0:
            raise ValueError(f"noise is {self.noise}, expected above 0")


def prepare(config: Config) -> HandEyeStudy:
    """Cells: the table's nine exact and noisy, the text's ranks, the camera's pure rotations."""
    cells = []
    for row in KINDS:
        for column in KINDS:
            for noise in (0.0, config.noise):
                label = {"motions": f"{row} + {column}", "noise": noise}
                cells.append(
                    Cell(label, config.draws, lambda f, n, k=(row, column), x=noise: _case(config, k, x, f, n))
                )
    for name, kinds in SETS.items():
        cells.append(Cell({"motions": name, "noise": 0.0}, config.draws, lambda f, n, k=kinds: _ranks(config, k, f, n)))
    label = {"motions": "camera rotations", "noise": config.noise}
    cells.append(Cell(label, config.draws, lambda f, n: _exchanged(config, f, n)))
    return HandEyeStudy("hand_eye_observability", config, cells, _summarise)


def _drawn(
    config: Config, kinds: tuple[str, ...], first: int, count: int
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """X, B and normals for the noise of each draw; rotations turn by 0.5 to 2.5 rad about axes 30 degrees apart."""
    found = []
    for row in simulation.normals(config.seed, 0, first, count, 6 + 13 * 3):
        X, rest, axes, B = simulation.rigid(row[:6], 1.0, 1.0), row[6:].reshape(3, 13), [], []
        for kind, one in zip(kinds, rest, strict=False):
            axis = one[:3] / np.linalg.norm(one[:3])
            if axes and abs(axis @ axes[0]) > np.cos(np.radians(30)):  # too close: turn it away, at right angles
                axis = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
                axis /= np.linalg.norm(axis)
            axes.append(axis)
            angle = {"translation": 0.0, "half turn": np.pi}.get(kind, 0.5 + 2 * np.mod(one[3], 1.0))
            shift = 0.0 if kind in ("rotation", "half turn") else 1.0
            # translations go along the axes, so that they too are independent
            along = axis if kind == "translation" else one[4:7]
            B.append(se3.compose(Rotation.from_rotvec(angle * axis).as_matrix(), shift * along))
        found.append((X, np.stack(B), rest[: len(kinds), 7:]))
    return found


def _noisy(A: np.ndarray, noise: float, drawn: np.ndarray) -> np.ndarray:
    turn = Rotation.from_rotvec(noise * drawn[:, :3]).as_matrix()
    return se3.compose(turn @ A[:, :3, :3], A[:, :3, 3] + noise * drawn[:, 3:])


def _case(config: Config, kinds: tuple[str, ...], noise: float, first: int, count: int) -> Measured:
    outcomes, angles, directions, moved = [], [], [], []
    for X, B, drawn in _drawn(config, kinds, first, count):
        A = simulation.conjugate(X, B)
        found = solve(_noisy(A, noise, drawn), B)
        outcomes.append(int(found.outcome))
        angles.append(float(simulation.errors(found.X, X)[0]))
        free, off = found.observability.free_direction, np.nan
        error = found.X[:3, 3] - X[:3, 3]
        if free is not None and found.outcome is Outcome.TRANSLATION_ALONG_AXIS:
            turning = A[np.argmax(se3.rotation_angle_deg(A[:, :3, :3])), :3, :3]
            axis = Rotation.from_matrix(turning).as_rotvec()
            off = float(
                np.degrees(np.arcsin(np.clip(np.linalg.norm(np.cross(free, axis / np.linalg.norm(axis))), 0, 1)))
            )
            error = error - free * (free @ error)
        directions.append(off)
        moved.append(float(np.linalg.norm(error)))
    return Measured(
        {
            "outcome": np.array(outcomes, float),
            "rotation_deg": np.array(angles),
            "direction_deg": np.array(directions),
            "translation": np.array(moved),
        }
    )


def _ranks(config: Config, kinds: tuple[str, ...], first: int, count: int) -> Measured:
    found = [ranks(X, B) for X, B, _ in _drawn(config, kinds, first, count)]
    return Measured({name: np.array([of[name] for of in found]) for name in found[0]})


def _exchanged(config: Config, first: int, count: int) -> Measured:
    """Pure rotations of the camera, as they are and with the roles of A and B exchanged."""
    apart, outcomes = [], []
    for X, A, drawn in _drawn(config, ("rotation", "rotation"), first, count):
        B = se3.inverse(X) @ _noisy(A, config.noise, drawn) @ X
        straight, exchanged = solve(A, B), solve(B, A)
        outcomes.append(float(straight.outcome is Outcome.SOLVED and exchanged.outcome is Outcome.SOLVED))
        apart.append(float(np.abs(se3.inverse(exchanged.X) - straight.X)[:3, :3].max()))
    return Measured({"both_solved": np.array(outcomes), "rotations_apart": np.array(apart)})


ENOUGH = 0.95
"""Share of noisy sets whose verdict has to be right; of exact sets all."""


def _summarise(config: Config, rows: polars.DataFrame, seconds: list[dict[str, Any]]) -> dict[str, Any]:
    def of(motions: str, noise: float) -> polars.DataFrame:
        return rows.filter((polars.col("motions") == motions) & (polars.col("noise") == noise))

    cases = []
    for row in KINDS:
        for column in KINDS:
            expected = EXPECTED.get(frozenset((row, column)), Outcome.SOLVED)
            for noise in (0.0, config.noise):
                part = of(f"{row} + {column}", noise)
                right = part.filter(polars.col("outcome") == int(expected))
                off = right["direction_deg"].fill_nan(None).drop_nulls()
                cases.append(
                    {
                        "row": row,
                        "column": column,
                        "noise": noise,
                        "expected": expected.name,
                        "right": len(right),
                        "draws": len(part),
                        "rotation_deg": None if right.is_empty() else float(right["rotation_deg"].to_numpy().max()),
                        "direction_deg": None if off.is_empty() else float(off.to_numpy().max()),
                        "translation": None if right.is_empty() else float(right["translation"].to_numpy().max()),
                    }
                )
    counts = [counted(name, of(name, 0.0)) for name in SETS]
    part = of("camera rotations", config.noise)
    exchanged = {
        "both_solved": int(part["both_solved"].sum()),
        "draws": len(part),
        "rotations_apart": float(part["rotations_apart"].to_numpy().max()),
    }
    return {
        "chosen": f"rotations by 0.5 to 2.5 rad about axes at least 30° apart; noise {config.noise:g} rad and length",
        "cases": cases,
        "ranks": counts,
        "exchanged": exchanged,
        "statements": _statements(cases, counts, exchanged),
    }


def _statements(
    cases: list[dict[str, Any]], counts: list[dict[str, Any]], exchanged: dict[str, Any]
) -> list[dict[str, str]]:
    said = published_table("hand_eye")["claims"]
    (exact, noisy), named = ([of for of in cases if bool(of["noise"]) == n] for n in (False, True)), []
    for some in (exact, noisy):
        named.append((sum(of["right"] for of in some), sum(of["draws"] for of in some)))
    as_said = named[0][0] == named[0][1] and named[1][0] >= ENOUGH * named[1][1]
    words = ", ".join(f"{right} of {n} {kind}" for (right, n), kind in zip(named, ("exact", "noisy"), strict=True))
    swapped = f"solved both ways in {exchanged['both_solved']} of {exchanged['draws']} sets"
    found = [
        claims.Statement(said["table"], f"{words} sets named so (asked here: all, 95 %)", as_said),
        claims.Statement(said["ranks"], *rank_statement(counts)),
        claims.Statement(said["swap"], swapped, exchanged["both_solved"] == exchanged["draws"]),
    ]
    return [one.row for one in found]


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Table 3.1 and the ranks as *published | ours*, and the exchanged roles."""
    data = published_table("hand_eye")
    table = data["table_3_1"]
    lines = []
    for of in summary["cases"]:
        said = table["determined"][table["rows"].index(of["row"])][table["rows"].index(of["column"])]
        parts = [f"R to {of['rotation_deg']:.1e}°"] if of["rotation_deg"] is not None else []
        if of["direction_deg"] is not None:
            parts.append(f"its free direction to {of['direction_deg']:.1e}°")
        if of["translation"] is not None and of["expected"] != Outcome.ROTATION_ONLY.name:
            parts.append(f"t to {of['translation']:.1e}")
        lines.append((f"{of['row']} + {of['column']}", "exact" if of["noise"] == 0 else f"noise {of['noise']:g}", said,
                      _IN_TABLE[Outcome[of["expected"]]], f"{of['right']} of {of['draws']}",
                      ", ".join(parts)))  # fmt: skip
    swap = summary["exchanged"]
    row = (f"{swap['both_solved']} of {swap['draws']}", f"{swap['rotations_apart']:.1e}")
    return [
        ranks_table(summary["ranks"], command),
        Table("Pure rotations of the camera: X as it is, and with the roles of A and B exchanged (remark of §3.2.2)",
              ("both solved", "largest difference of the rotation matrices"), [row]),
        Table(f"Published | ours, Table 3.1 | {command}",
              ("motions", "data", "published", "expected", "so named", "largest errors of those"), lines),
        claims.statements_table(summary["statements"], command),
        chosen_table(summary),
    ]  # fmt: skip


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Share of the sets that were named as Table 3.1 says."""
    names = [f"{row[0].upper()} + {column[0].upper()}" for row in KINDS for column in KINDS]
    series = []
    for noise in dict.fromkeys(of["noise"] for of in summary["cases"]):
        shares = [100 * of["right"] / of["draws"] for of in summary["cases"] if of["noise"] == noise]
        series.append(Series("exact" if noise == 0 else f"noise {noise:g}", names, shares, style="bars"))
    kinds = "two motions: T translation, R rotation, G general motion"
    panel = Panel("Table 3.1: what two motions determine", kinds, "sets named as the table says (%)", series)
    return [Chart("table-3.1", "Table 3.1: what two motions determine", [panel])]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye: what motions determine (RR-3507 §3.2.2)", tables, charts)
