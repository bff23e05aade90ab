"""Tables of the experiment ``mesh_quality``: Table 3.2 *published | ours*, its ranking, the passes, the statements."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxmodel.mesh.quality import BINS
from jaxmodel.run.meshing.criteria_tables import known_shapes, synthetic_part_table
from jaxmodel.run.published import published_table
from jaxmodel.view.table import Table

LABELS = {
    "ball": "ball pivoting, all points",
    "ball_thinned": "ball pivoting, thinned to the thesis's vertices",
    "deformable_5": "deformable surface, order 5",
    "deformable_6": "deformable surface, order 6",
    "marching_cubes": "marching cubes",
    "poisson": "Poisson",
}
LOW = 0.3
"""A triangle of lower Q_equ is called degenerate here."""
_OF = {"ball": "ball", "ball_thinned": "ball", "deformable_5": "deformable_5", "deformable_6": "deformable_6"}
"""Method -> the published column it is compared to."""


class Criterion(NamedTuple):
    """``sign`` +1 where more is better."""

    key: str
    name: str
    sign: int
    digits: str


CRITERIA = (
    Criterion("Q_equ", "Q_equ", 1, ".4f"),
    Criterion("Q_nor", "Q_nor", 1, ".4f"),
    Criterion("seconds", "processor time (s)", -1, ".3g"),
)


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """All tables of a finished run, *published | ours* last."""
    return [
        known_shapes(),
        synthetic_part_table(),
        *([_registered(summary)] if summary.get("registered") else []),
        _nearness(summary),
        *([_sweep(summary)] if summary["sweep"] else []),
        *(_passes(name, summary, command) for name in summary["passes"]),
        _statements(summary),
        *_ranking(summary),
        _main(summary, command),
    ]


def _main(summary: Mapping[str, Any], command: str) -> Table:
    columns = ("object", "method", "vertices", "triangles", "Q_equ", "Q_nor", "seconds of the processor")
    known = published_table("mesh_quality")["objects"]
    rows = []
    for row in summary["rows"]:
        stands_for = summary["stands_for"][row["object"]]
        published = known.get(stands_for, {}).get(_OF.get(row["method"], ""), {})
        rows.append(
            (
                _object(summary, row["object"]),
                LABELS.get(row["method"], row["method"]),
                *(_beside(published.get(key), row.get(key), "d") for key in ("vertices", "triangles")),
                *(_beside(published.get(key), row.get(key), ".4f") for key in ("Q_equ", "Q_nor")),
                _beside(published.get("seconds"), row.get("seconds"), ".3g"),
            )
        )
    return Table(f"Table 3.2, published | ours (Pentium 4 | this machine) | {command}", columns, rows)


def _registered(summary: Mapping[str, Any]) -> Table:
    columns = ("object", "scan", "start off by", "after registration", "degrees")
    rows = []
    for name, scans in summary["registered"].items():
        spacing = summary["clouds"][name]["spacing"]
        for scan, of in list(scans.items())[1:]:
            shifts = (f"{of[key] / spacing:.2f} spacings" for key in ("start_shift", "error_shift"))
            rows.append((name, scan, *shifts, f"{of['start_deg']:.2f}, then {of['error_deg']:.2f}"))
    return Table("Scans registered one onto those before it (thesis method): errors against the truth", columns, rows)


def _nearness(summary: Mapping[str, Any]) -> Table:
    columns = (
        "object",
        "method",
        "points to mesh: mean (95 %)",
        "to the true mesh, from it",
        "border: length (loops)",
        "parts",
        "Euler number",
        "how it ended",
    )
    rows = []
    for row in summary["rows"]:
        if row.get("triangles") is None:
            rows.append((row["object"], LABELS[row["method"]], *[""] * 5, row["sentence"]))
            continue
        apart = [_number(row[key], ".3f") for key in ("truth_there", "truth_back")]
        rows.append(
            (
                row["object"],
                LABELS.get(row["method"], row["method"]),
                f"{row['points_mean']:.3f} ({row['points_95']:.3f})",
                ", ".join(apart) if all(apart) else "",
                f"{row['border_length']:.4g} ({row['border_loops']})",
                f"{row['components']}",
                f"{row['euler']}",
                row["sentence"],
            )
        )
    return Table("What Table 3.2 leaves out: nearness, border, parts; lengths in spacings of the cloud", columns, rows)


def _ranking(summary: Mapping[str, Any]) -> list[Table]:
    """Which of both methods is better by each criterion, row by row of Table 3.2, then counted."""
    columns = ("criterion", "object", "better: published", "ours, thinned as published", "ours, all points")
    rows, counts = [], []
    for criterion in CRITERIA:
        agree: dict[str, list[bool]] = {"ball_thinned": [], "ball": []}
        published_wins, ours_wins = [], {"ball_thinned": 0, "ball": 0}
        for name, order in _published_rows(summary):
            published = published_table("mesh_quality")["objects"][summary["stands_for"][name]]
            printed = _better(published["ball"], published[f"deformable_{order}"], criterion)
            cells = []
            published_wins.append(printed.ball)
            for method in ("ball_thinned", "ball"):
                ball, surface = _find(summary, name, method), _find(summary, name, f"deformable_{order}")
                ours = _better(ball, surface, criterion)
                if ours.known:
                    agree[method].append(ours.ball == printed.ball)
                    ours_wins[method] += ours.ball
                    ours = ours._replace(text=f"{ours.text}: {_verdict(ours.ball == printed.ball)}")
                cells.append(ours.text)
            rows.append((criterion.name, f"{_object(summary, name)}, order {order}", printed.text, *cells))
        if published_wins:
            counted = [
                f"{ours_wins[of]} of {len(seen)}; {sum(seen)} of {len(seen)} rows as published" if seen else "not run"
                for of, seen in agree.items()
            ]
            counts.append((criterion.name, f"{sum(published_wins)} of {len(published_wins)}", *counted))
    if not counts:
        return []
    totals = ("ball pivoting better by", "published", "ours, thinned as published", "ours, all points")
    return [
        Table("The ranking of Table 3.2, row by row: ball pivoting against the deformable surface", columns, rows),
        Table("The ranking of Table 3.2, counted", totals, counts),
    ]


class _Better(NamedTuple):
    """``ball``: whether ball pivoting is better."""

    ball: bool
    known: bool
    text: str


def _better(ball: Mapping[str, Any] | None, surface: Mapping[str, Any] | None, criterion: Criterion) -> _Better:
    first, second = (None if one is None else one.get(criterion.key) for one in (ball, surface))
    if first is None or second is None:
        return _Better(False, False, "not run")
    wins = criterion.sign * (first - second) > 0
    return _Better(
        wins, True, f"{'ball' if wins else 'deformable'} ({first:{criterion.digits}}, {second:{criterion.digits}})"
    )


def _published_rows(summary: Mapping[str, Any]) -> list[tuple[str, int]]:
    """Rows of Table 3.2 that were run: the object here, and the order of the sphere."""
    known = published_table("mesh_quality")["objects"]
    return [
        (name, order)
        for name, stands_for in summary["stands_for"].items()
        for order in (5, 6)
        if f"deformable_{order}" in known.get(stands_for, {})
    ]


def _statements(summary: Mapping[str, Any]) -> Table:
    """What the text says beside the table, each with its number."""
    rows = []
    for name, stands_for in summary["stands_for"].items():
        ball = _find(summary, name, "ball_thinned") or _find(summary, name, "ball")
        plain, surface = _find(summary, name, "ball"), _find(summary, name, "deformable_5")
        if stands_for == "club" and ball and surface:
            low, high = _degenerate(ball), _degenerate(surface)
            text = f"Q_equ below {LOW}: deformable {100 * high:.1f} %, ball {100 * low:.1f} %"
            rows.append((name, "the deformable surface gathers poor triangles", text, _verdict(high > low)))
        if stands_for == "mech" and plain and surface:
            text = f"Euler number: ball {plain['euler']}, deformable {surface['euler']}"
            rows.append((name, "it does not enter the holes", text, _verdict(surface["euler"] == 2)))
            far = f"{surface['points_mean']:.3f} spacings, ball {plain['points_mean']:.3f}"
            worse = surface["points_mean"] > 2 * plain["points_mean"]
            rows.append((name, "so it stays away from the points", far, _verdict(worse)))
            text = f"border of {plain['border_loops']} loops, {plain['border_length']:.4g} spacings"
            rows.append((name, "the ball leaves open regions", text, _verdict(plain["border_loops"] > 0)))
        if stands_for == "teapot" and plain:
            counts = np.array(plain["Q_equ_counts"])
            peak = int(np.argmax(counts))
            right = published_table("mesh_quality")["right_isosceles_Q_equ"]
            text = f"most from {peak / BINS:.2f} to {(peak + 1) / BINS:.2f}: {counts[peak] / counts.sum():.0%}"
            said = f"most triangles are right ones, Q_equ {right}"
            rows.append((name, said, text, _verdict(peak == int(right * BINS))))
        if surface and stands_for:
            text = f"border {surface['border_length']:.4g}, {surface['components']} part"
            good = surface["border_length"] == 0 and surface["components"] == 1
            rows.append((name, "the deformable surface is one and closed", text, _verdict(good)))
    return Table("Statements of thesis §3.5.3 and Table 3.1", ("object", "published", "ours", "verdict"), rows)


def _passes(name: str, summary: Mapping[str, Any], command: str) -> Table:
    printed = published_table("mesh_quality")["passes"][summary["stands_for"][name]]
    columns = ("ball / first ball", "seconds, published", "triangles, published")
    both: dict[bool, list[Mapping[str, Any]]] = {False: [], True: []}
    for row in summary["passes"][name]:
        both[row["thinned"]].append(row)
    for thinned, of in both.items():
        word = "one sheet" if thinned else "as it is"
        columns += (f"{word}, {of[0]['points']} points: seconds", "triangles", "points used", "border / spacing")
    rows = []
    for i, radius in enumerate(printed["radius"]):
        cells = [f"{radius / printed['radius'][0]:.2f} ({radius})"]
        cells += [f"{printed['seconds'][i]:.2f}", f"{printed['triangles'][i]} ({_share(printed['triangles'], i)})"]
        for of in both.values():
            mine = [row["triangles"] for row in of]
            cells += [f"{of[i]['seconds']:.2f}", f"{mine[i]} ({_share(mine, i)})"]
            cells += [f"{of[i]['used']:.1%}", f"{of[i]['border_length']:.4g}"]
        rows.append(tuple(cells))
    total = ["sum", f"{sum(printed['seconds']):.2f}", f"{sum(printed['triangles'])}"]
    for of in both.values():
        total += [f"{sum(row['seconds'] for row in of):.2f}", f"{sum(row['triangles'] for row in of)}", "", ""]
    stands_for = summary["stands_for"][name]
    return Table(f"Passes of the ball: {stands_for}, published | {name}, ours | {command}", columns, [*rows, total])


def _share(counts: Sequence[int], i: int) -> str:
    return f"{counts[i] / max(sum(counts), 1):.0%}"


def _sweep(summary: Mapping[str, Any]) -> Table:
    columns = ("object", "radius / spacing", "triangles", "points used", "Q_equ", "Q_nor", "holes", "parts", "seconds")
    rows = [
        (
            name,
            f"{row['radius']:g}",
            f"{row['triangles']}",
            f"{row['used']:.1%}",
            _number(row["Q_equ"], ".4f"),
            _number(row["Q_nor"], ".4f"),
            f"{row['holes']}",
            f"{row['components']}",
            f"{row['seconds']:.2f}",
        )
        for name, of in summary["sweep"].items()
        for row in of
    ]
    return Table("One pass of one ball, no hole closed, on the cloud made one sheet", columns, rows)


def _find(summary: Mapping[str, Any], name: str, method: str) -> Mapping[str, Any] | None:
    for row in summary["rows"]:
        if row["object"] == name and row["method"] == method and row.get("triangles") is not None:
            return row
    return None


def _degenerate(row: Mapping[str, Any]) -> float:
    counts = np.array(row["Q_equ_counts"])
    return float(counts[: round(LOW * BINS)].sum() / counts.sum())


def _object(summary: Mapping[str, Any], name: str) -> str:
    stands_for = summary["stands_for"][name]
    return f"{name} for {stands_for}" if stands_for and stands_for != name else name


def _verdict(holds: bool) -> str:
    return "reproduced" if holds else "contradicted"


def _beside(published: float | int | None, ours: float | int | None, digits: str) -> str:
    mine = _number(ours, digits)
    return mine if published is None else f"{published:{digits}} | {mine or 'none'}"


def _number(value: float | int | None, digits: str) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:{digits}}"
