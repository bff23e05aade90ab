"""Tables and charts of the experiment ``resolution``."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars

from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

_RESOLUTION = "resolution "
_COMBINED = ("H-H", "L-L", "H-L")


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """The combinations, the two steps, and Table 2.1 as *published | ours*."""
    return [_combined(summary), _two_steps(summary, command), _table_2_1(summary, command)]


def _combined(summary: Mapping[str, Any]) -> Table:
    lines = [
        (of["variant"], of["kind"], f"{of['points']['target']} and {of['points']['source']}", *_found(of))
        for of in summary["variants"]
        if of["variant"] in _COMBINED
    ]
    columns = ("target-source", "kind", "points", "right", "iterations", "paired points", "ICP error", "true rotation")
    return Table("High and low resolution combined (Fig. 2.40); of the right ones", columns, lines)


def _found(of: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        _shown(of["rate"]["value"], ".0f", 100, " %"),
        _shown(of["iterations"]["value"], ".0f"),
        _shown(of["matched"]["value"], ".0f", 100, " %"),
        _shown(of["error"]["value"], ".3g"),
        _shown(of["rotation_error_deg"]["value"], ".3f", 1, "°"),
    )


def _shown(value: float | None, form: str, scale: float | int = 1.0, unit: str = "") -> str:
    return "none" if value is None else format(scale * value, form) + unit


def _two_steps(summary: Mapping[str, Any], command: str) -> Table:
    published = published_table("resolution")["two_steps_faster"]
    lines = []
    for of in summary["two_steps"]:
        rates = {variant: _shown(rate["value"], ".0f", 100, " %") for variant, rate in of["rates"].items()}
        lines.append(
            (
                of["kind"],
                f"{published} x",
                _shown(of["faster"], ".2f", 1, " x"),
                _shown(of["faster_with_tables"], ".2f", 1, " x"),
                _shown(of["faster_if_quadratic"], ".2f", 1, " x"),
                ", ".join(f"{variant} {steps:.0f}" for variant, steps in of["steps"].items()),
                f"{rates['fine alone']} and {rates['coarse, then fine']}",
            )
        )
    columns = (
        "kind", "published", "ours, registrations", "ours, with voxel tables", "if pairing were quadratic",
        "iterations", "right: fine alone, two steps",
    )  # fmt: skip
    return Table(f"Published | ours: coarse then fine against fine alone, times faster | {command}", columns, lines)


def _table_2_1(summary: Mapping[str, Any], command: str) -> Table:
    published = published_table("resolution")
    variants = [of for of in summary["variants"] if of["variant"].startswith(_RESOLUTION)]
    lines = []
    for place, variant in enumerate(dict.fromkeys(of["variant"] for of in variants)):
        ours = {of["kind"]: of for of in variants if of["variant"] == variant}
        inside, asked = place < len(published["points"]["target"]), variant.removeprefix(_RESOLUTION)
        for kind, of in ours.items():
            theirs = _published(published, kind, place) if inside and kind in published else "not in the thesis"
            early = _shown(of["early_error"], ".3g")
            lines.append((f"{asked}, {kind}", theirs, f"{of['points']['target']}, {of['points']['source']}",
                          *_found(of)[:3], f"{early}, {_found(of)[3]}", _found(of)[4]))  # fmt: skip
        lines.append((f"{asked}, better", _better_published(published, place) if inside else "", "", *_better(ours)))
    columns = (
        "asked", "published (DRAGON): points, iterations, paired, ICP error", "ours: points", "right",
        "iterations", "paired points", "ICP error when the vertices end, at its own end", "true rotation",
    )  # fmt: skip
    title = f"Published | ours, Table 2.1, means over {', '.join(summary['pairs'])} | {command}"
    return Table(title, columns, lines)


def _published(published: Mapping[str, Any], kind: str, place: int) -> str:
    of, points = published[kind], [published["points"][view][place] for view in ("target", "source")]
    errors = [of[key][place] for key in ("early_error", "error") if key in of]
    shown = " then ".join(f"{error:.2g}" for error in errors)
    return f"{points[0]} and {points[1]}, {of['iterations'][place]}, {of['matched_percent'][place]} %, {shown}"


def _better_published(published: Mapping[str, Any], place: int) -> str:
    kinds = ("contours", "vertices")
    fewest, finest = (min(kinds, key=lambda kind, of=of: published[kind][of][place]) for of in ("iterations", "error"))
    return f"iterations {fewest}, error {finest}"


def _better(ours: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    def best(key: str, most: bool = False) -> str:
        known = {kind: of[key]["value"] for kind, of in ours.items() if of[key]["value"] is not None}
        return "" if not known else (max if most else min)(known, key=lambda kind: known[kind])

    return best("rate", True), best("iterations"), best("matched", True), best("error"), best("rotation_error_deg")


def charts(summary: Mapping[str, Any], rows: polars.DataFrame, iterations: polars.DataFrame) -> list[Chart]:
    """Every column of Table 2.1 against the number of points, and the error along the iterations of Fig. 2.40."""
    of_table = [of for of in summary["variants"] if of["variant"].startswith(_RESOLUTION)]
    wanted = (
        ("rate", "right (%)", 100.0),
        ("iterations", "iterations", 1.0),
        ("matched", "paired points (%)", 100.0),
        ("error", "ICP error (unit of the data)", 1.0),
        ("rotation_error_deg", "true rotation error (°)", 1.0),
    )
    panels = [
        Panel(label, "control points of each view", label, _curves(summary, of_table, key, scale), log_x=True)
        for key, label, scale in wanted
    ]
    return [
        Chart("resolution", "Resolution (Table 2.1)", panels),
        Chart("combinations", "High and low resolution combined (Fig. 2.40)", _along(summary, iterations)),
    ]


def _curves(summary: Mapping[str, Any], variants: list[Any], key: str, scale: float) -> list[Series]:
    drawn = []
    for kind in summary["kinds"]:
        of = sorted((v for v in variants if v["kind"] == kind), key=lambda v: v["points"]["source"])
        value, low, high = (
            [np.nan if v[key][end] is None else scale * v[key][end] for v in of] for end in ("value", "low", "high")
        )
        drawn.append(Series(kind, [v["points"]["source"] for v in of], value, low, high))
    return drawn


def _along(summary: Mapping[str, Any], iterations: polars.DataFrame) -> list[Panel]:
    """The first pair's first start: ICP error and true error, a curve for each combination."""
    first = iterations.filter(polars.col("pair") == summary["pairs"][0])
    panels = []
    for column, label in (("error", "ICP error (unit of the data)"), ("rotation_error_deg", "true rotation error (°)")):
        for kind in summary["kinds"]:
            of_kind = first.filter(polars.col("control_points") == kind)
            curves = []
            for variant in _COMBINED:
                of = of_kind.filter(polars.col("variant") == variant).sort("iteration")
                curves.append(Series(variant, of["iteration"].to_list(), of[column].to_list()))
            panels.append(Panel(f"{kind}, {summary['pairs'][0]}", "iteration", label, curves))
    return panels
