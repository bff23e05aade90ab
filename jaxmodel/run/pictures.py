"""Of a finished convergence run: its tables, and from its folder alone ``figures/*.png`` and ``report.html``."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import polars

from jaxmodel.errors import InputError
from jaxmodel.io.results import RunDir
from jaxmodel.run.faults import fault_tables
from jaxmodel.run.provenance import facts
from jaxmodel.run.published import COLUMNS, published_lines
from jaxmodel.run.scene import read_scene
from jaxmodel.view.table import Table

_DRAWN = polars.selectors.by_name(
    "pair", "control_points", "error", "rotation_error_deg", "right", "plateau", require_all=False
)


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """The sweeps, the two claims where they were tested, and *published | ours* where there is something beside it."""
    found = [Table(f"Convergence of {summary['method']}", CASE_COLUMNS, [case_line(c) for c in summary["cases"]])]
    claims = claim_lines(summary)
    if claims:
        found.append(Table("Two claims of thesis §2.9.2", CLAIM_COLUMNS, claims))
    if any(row["ours"] for row in summary["published"]):
        found.append(Table("Published | ours | command", COLUMNS, published_lines(summary["published"], command)))
    return found


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Draw every figure and the report from what the folder holds; the list of figures, relative to it."""
    path = folder.path / "results.parquet"
    try:
        table = polars.scan_parquet(path).select(_DRAWN).collect()
    except (OSError, polars.exceptions.PolarsError) as error:
        raise InputError(f"{path}: not readable as a table ({error})") from None
    manifest, scene = folder.read_json("manifest.json"), read_scene(folder.path / "scene.npz")
    from jaxmodel.view import figures
    from jaxmodel.view.report import render_report

    views, written = [], []
    for number, pair in enumerate(scene["pairs"].tolist()):
        view = _pair_view(number, pair, table, summary, scene)
        if view is None:
            continue
        views.append(view)
        stem = re.sub(r"[^\w.-]+", "_", pair)
        drawn = {
            "sorted-error": figures.sorted_error(pair, view.curves),
            "sphere": figures.start_sphere(pair, view.directions, view.curves),
            "iterations": figures.iterations(pair, view.traces),
        }
        if any(curve.rotation_error_deg is not None for curve in view.curves):
            drawn["error-and-truth"] = figures.error_beside_truth(pair, view.curves)
        for name, picture in drawn.items():
            folder.write(f"figures/{stem}-{name}.png", picture)
            written.append(f"figures/{stem}-{name}.png")
    pairs = len({case["pair"] for case in summary["cases"]})
    note = f"The first {len(views)} of {pairs} pairs are drawn." if len(views) < pairs else ""
    shown = [*tables(summary, manifest["command"]), *fault_tables(summary)]
    page = render_report(f"Convergence of {summary['method']}", _facts(summary, manifest), shown, views, note)
    folder.write("report.html", page.encode())
    return written


CASE_COLUMNS = ("pair", "points", "starts", "right", "95 % interval", "best start", "plateau", "starts/s")
CLAIM_COLUMNS = (
    "pair",
    "points",
    "the initial translation does not matter",
    "converging starts form no coherent set",
)


def case_line(case: Mapping[str, Any]) -> tuple[str, ...]:
    """One sweep as a row of text under ``CASE_COLUMNS``."""
    success, best = case.get("success"), case["best"]
    verdict = "" if "right" not in best else ", right" if best["right"] else ", wrong"
    return (
        case["pair"],
        f"{case['control_points']}, {case['points']['target']} and {case['points']['source']}",
        f"{case['starts']} ({case['distinct_starts']} distinct)",
        f"{success['count']} ({100 * success['rate']:.1f} %)" if success else "truth unknown",
        f"{100 * success['low']:.1f} to {100 * success['high']:.1f} %" if success else "",
        f"{best['start']}: error {best['error']:.3g}{verdict}",
        _plateau(case["plateau"]),
        f"{case['starts_per_second']:.0f}" if (case.get("starts_per_second") or 0) >= 1 else "",
    )


def _plateau(plateau: Mapping[str, Any]) -> str:
    gap = plateau["gap"]
    following = f", next basin at {gap:.2f} x" if gap is not None and np.isfinite(gap) else ""
    return f"{plateau['members']} starts{following}" if plateau["found"] else f"none{following}"


def claim_lines(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The two claims put to the test, a row for each sweep with a truth and one for all, under ``CLAIM_COLUMNS``."""
    lines = []
    for case in summary["cases"]:
        if not case.get("claims"):
            continue
        moved, together = case["claims"]["translation"], case["claims"]["coherence"]
        lines.append((case["pair"], case["control_points"], _translation(moved), _coherence(together)))
    if len(lines) > 1:
        lines.append(("all together", "", _translation(summary.get("translation_claim")), ""))
    return lines


def _translation(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return "not tested"
    verdict = "it matters" if found["p_value"] < 0.05 else "no effect seen"
    total = found["both"] + found["only_without"] + found["only_with"] + found["neither"]
    return (
        f"{verdict}: right without an offset {100 * found['rate_without']:.1f} %, with one "
        f"{100 * found['rate_with']:.1f} % of {total} (McNemar p = {found['p_value']:.2g})"
    )


def _coherence(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return "too few starts to tell"
    verdict = "they do lie together" if found["p_value"] < 0.05 else "no coherence seen"
    return (
        f"{verdict}: nearest neighbours converge too in {100 * found['neighbour_rate']:.0f} %, at random "
        f"{100 * found['random_rate']:.0f} % (p = {found['p_value']:.2g})"
    )


def _facts(summary: Mapping[str, Any], manifest: Mapping[str, Any]) -> dict[str, str]:
    means = [case["right_means"] for case in summary["cases"] if "right_means" in case]
    right = "the truth is unknown"
    if means:
        within = sorted({f"{mean['translation']:.3g}" for mean in means}, key=float)
        by_pair = f" to {within[-1]}, by pair" if len(within) > 1 else ""
        right = (
            f"rotation within {means[0]['rotation_deg']:g} degrees, source's centroid within {within[0]}{by_pair} "
            "(unit of the data)"
        )
    return {
        **facts(manifest),
        "method": summary["method"],
        "right means": right,
        "converged means": "right, or in the plateau where the truth is unknown",
    }


def _pair_view(
    number: int, pair: str, table: polars.DataFrame, summary: Mapping[str, Any], scene: Mapping[str, np.ndarray]
) -> Any:
    from jaxmodel.view.figures import IterationCurve, SweepCurve
    from jaxmodel.view.report_plots import PairView

    curves, traces = [], []
    cases = [case for case in summary["cases"] if case["pair"] == pair]
    for kind_number, kind in enumerate(scene["kinds"].tolist()):
        rows = table.filter((polars.col("pair") == pair) & (polars.col("control_points") == kind))
        key = f"p{number}k{kind_number}"
        if not len(rows) or f"{key}_error" not in scene:
            continue
        known = "right" in rows.columns and rows["right"].null_count() == 0
        curves.append(
            SweepCurve(
                kind,
                rows["error"].to_numpy(),
                rows["right" if known else "plateau"].to_numpy(),
                rows["rotation_error_deg"].to_numpy() if known else None,
            )
        )
        trace = (scene[f"{key}_{name}"] for name in ("error", "shared_rate", "strategy"))
        traces.append(IterationCurve(kind, *trace))
    if not curves:
        return None
    best = min(cases, key=_preference)
    key = f"p{number}k{scene['kinds'].tolist().index(best['control_points'])}"
    source = scene[f"p{number}_source"].astype(np.float64)
    before, after = (
        source @ scene[f"{key}_{name}"][:3, :3].T + scene[f"{key}_{name}"][:3, 3] for name in ("before", "after")
    )
    return PairView(
        name=pair,
        target=scene[f"p{number}_target"],
        before=before,
        after=after,
        directions=scene[f"p{number}_directions"],
        curves=curves,
        traces=traces,
        best=best["control_points"],
    )


def _preference(case: Mapping[str, Any]) -> tuple[bool, float]:
    """Right registrations first, then those with a plateau, then the larger matched fraction."""
    return (not case["best"].get("right", case["plateau"]["found"]), -case["best"]["matched_fraction"])
