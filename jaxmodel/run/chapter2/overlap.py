"""The experiment ``overlap`` (thesis §2.9.4, Tables 2.2, 2.3): one view against views ever further round the turntable.

Each group is one object. The reference view is the target; sources are taken every step both ways. A kind of control
points fails at an angle when fewer than half of its starts come out right there; its range ends before the first
failure of each direction.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.register import basin
from jaxmodel.register.intervals import mean_over_units
from jaxmodel.run.chapter2.study import Study
from jaxmodel.run.chapter2.trials import StudyConfig, Trial, placed_pairs, starts_of
from jaxmodel.run.config import MeshScans, ObjectScans
from jaxmodel.run.convergence_table import poses
from jaxmodel.run.published import published_table
from jaxmodel.run.study_report import draw_study
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table


@dataclass(frozen=True, kw_only=True)
class Config(StudyConfig):
    """The YAML of the experiment.

    Sources are taken at plus and minus each of ``angles_deg`` from the first of the scans' ``views_deg``.
    """

    experiment: Literal["overlap"] = "overlap"
    angles_deg: tuple[float, ...] = (20.0, 40.0, 60.0, 80.0, 100.0, 120.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.angles_deg or not all(0 < angle < 180 for angle in self.angles_deg):
            raise ValueError("angles_deg: expected at least one angle, each above 0 and below 180")
        if not all(isinstance(group.scans, ObjectScans | MeshScans) for group in self.groups):
            raise ValueError("groups: a turntable is needed, expected scans of the kind objects or meshes")


def prepare(config: Config) -> Study:
    """Read and check everything ``config`` names."""
    trials = []
    for angle in sorted({*config.angles_deg, *(-angle for angle in config.angles_deg)}):
        for placed in placed_pairs(config, [_seen_from(group, angle) for group in config.groups]):
            for count in config.counts:
                trials.append(
                    Trial(
                        placed.pair,
                        placed.group.control_points,
                        (count, count),
                        starts_of(config, placed.pair, len(trials)),
                        placed.draw,
                        placed.group.stands_for,
                        f"{angle:g}",
                    )
                )
    return Study("overlap", config, trials, _summarise)


def _seen_from(group: Any, angle: float) -> Any:
    first = group.scans.views_deg[0]
    scans = dataclasses.replace(group.scans, views_deg=(first, first + angle))
    return dataclasses.replace(group, scans=scans)


def _summarise(
    config: Config,
    trials: list[Trial],
    rows: polars.DataFrame,
    iterations: polars.DataFrame,
    costs: list[dict[str, Any]],
) -> dict[str, Any]:
    views = [
        _view(trials, of, str(subject), float(str(variant)), str(kind), config)
        for (subject, variant, kind), of in rows.group_by("subject", "variant", "control_points", maintain_order=True)
    ]
    objects = []
    for subject, trial in {trial.pair.subject: trial for trial in trials}.items():
        of = [view for view in views if view["subject"] == subject]
        ranges = {kind: _range([view for view in of if view["kind"] == kind]) for kind in trial.labels}
        objects.append(
            {"subject": subject, "family": trial.pair.family, "stands_for": trial.stands_for, "ranges": ranges}
        )
    return {"views": views, "objects": objects}


def _view(
    trials: Sequence[Trial], rows: polars.DataFrame, subject: str, angle: float, kind: str, config: Config
) -> dict[str, Any]:
    """One object from one angle with one kind: all but the rate is of the registrations that came out right."""
    axis, turn = [], []
    for (number,), of in rows.group_by("trial", maintain_order=True):
        truth = trials[int(str(number))].pair.T_target_source
        assert truth is not None
        found = basin.axis_angle_errors(poses(of), truth)
        axis.append(found[0])
        turn.append(found[1])
    right = rows["right"].to_numpy()
    starts = rows.select(polars.concat_str(["trial", "start"], separator=" ")).to_series().to_numpy()

    def mean(values: np.ndarray) -> dict[str, Any]:
        return mean_over_units(values[right], starts[right], config.resamples, config.seed)._asdict()

    return {
        "subject": subject,
        "angle_deg": angle,
        "kind": kind,
        "tests": len(rows),
        "right": int(right.sum()),
        "points": int(rows["points_source"][0]),
        "iterations": mean(rows["steps"].to_numpy().astype(float)),
        "shared": mean(rows["shared_rate"].to_numpy()),
        "matched": mean(rows["matched_fraction"].to_numpy()),
        "error": mean(rows["error"].to_numpy()),
        "axis_error": mean(np.concatenate(axis)),
        "angle_error_deg": mean(np.concatenate(turn)),
        "rotation_error_deg": mean(rows["rotation_error_deg"].to_numpy()),
    }


def _range(views: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How far each way the views converge, and the smallest share of clusters at which they still do."""
    ends = {}
    for way, sign in (("forward", 1), ("backward", -1)):
        ends[way] = 0.0
        for view in sorted((v for v in views if v["angle_deg"] * sign > 0), key=lambda v: abs(v["angle_deg"])):
            if 2 * view["right"] < view["tests"]:
                break
            ends[way] = view["angle_deg"]
    inside = [v for v in views if ends["backward"] <= v["angle_deg"] <= ends["forward"] and v["right"]]
    return {**ends, "least_shared": min((v["shared"]["value"] for v in inside), default=float("nan"))}


_COLUMNS = (
    "angle", "kind, points", "right", "iterations", "shared clusters", "paired points", "ICP error", "axis error",
    "angle error",
)  # fmt: skip


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Every view of every object, published figures below ours, and the ranges."""
    published, found = published_table("overlap"), []
    for entry in summary["objects"]:
        theirs, lines = published["objects"].get(entry["stands_for"]), []
        for view in (view for view in summary["views"] if view["subject"] == entry["subject"]):
            lines.append(_ours(view))
            if theirs and view["kind"] in theirs and view["angle_deg"] in theirs["angles_deg"]:
                lines.append(_theirs(entry["stands_for"], theirs, view))
        title = f"{entry['subject']} ({entry['family'].replace('_', '-')})"
        beside = f", beside {entry['stands_for']} of Table {theirs['table']}" if theirs else ""
        found.append(Table(f"{title}{beside}; errors and iterations of the right ones", _COLUMNS, lines))
    lines = []
    for entry in summary["objects"]:
        theirs = published["objects"].get(entry["stands_for"])
        shown = f"{min(theirs['angles_deg'])} to {max(theirs['angles_deg'])}°" if theirs else "not in the thesis"
        for kind, of in entry["ranges"].items():
            least = "none" if of["least_shared"] is None else f"{100 * of['least_shared']:.1f} %"
            ours = f"{of['backward']:g} to {of['forward']:g}°"
            shared = "min. " + f"{min(theirs[kind]['shared'])} %" if theirs and kind in theirs else ""
            lines.append((entry["subject"], kind, shown, ours, shared, least))
    columns = (
        "object", "kind", "published range", "ours: at least half converge", "published shared clusters",
        "ours: least shared",
    )  # fmt: skip
    return [*found, Table(f"Published | ours: how far round the views still converge | {command}", columns, lines)]


def _ours(view: Mapping[str, Any]) -> tuple[str, ...]:
    def shown(key: str, form: str, scale: float | int = 1.0) -> str:
        value = view[key]["value"]
        return "" if value is None else format(scale * value, form)

    return (
        f"{view['angle_deg']:g}°",
        f"{view['kind']}, {view['points']}",
        f"{view['right']} of {view['tests']}",
        shown("iterations", ".0f"),
        shown("shared", ".1f", 100) + (" %" if view["right"] else ""),
        shown("matched", ".1f", 100) + (" %" if view["right"] else ""),
        shown("error", ".4g"),
        shown("axis_error", ".4f"),
        shown("angle_error_deg", ".3f") + ("°" if view["right"] else ""),
    )


def _theirs(name: str, table: Mapping[str, Any], view: Mapping[str, Any]) -> tuple[str, ...]:
    place, of = table["angles_deg"].index(view["angle_deg"]), table[view["kind"]]
    return (
        f"  {name}",
        f"{view['kind']}, {of['points'][place]}",
        "yes",
        f"{of['iterations'][place]}",
        f"{of['shared'][place]} %",
        f"{of['matched'][place]} %",
        f"{of['error'][place]}",
        f"{of['axis_error'][place]}",
        f"{of['angle_error_deg'][place]:.3f}°",
    )


def charts(summary: Mapping[str, Any], rows: polars.DataFrame, iterations: polars.DataFrame) -> list[Chart]:
    """For each object: rate, shared clusters, and errors of axis and angle against the angle between the views."""
    drawn = []
    for entry in summary["objects"]:
        views = [view for view in summary["views"] if view["subject"] == entry["subject"]]
        rate = [
            Series(kind, [v["angle_deg"] for v in of], [100 * v["right"] / v["tests"] for v in of])
            for kind, of in _by_kind(views).items()
        ]
        panels = [Panel("converged", "angle between the views (°)", "right (%)", rate)]
        for key, label, scale in (
            ("shared", "shared clusters (%)", 100.0),
            ("axis_error", "axis error", 1.0),
            ("angle_error_deg", "angle error (°)", 1.0),
        ):
            panels.append(Panel(label, "angle between the views (°)", label, _curves(views, key, scale)))
        drawn.append(Chart(f"{entry['subject']}-overlap", f"{entry['subject']}: overlap of the views", panels))
    return drawn


def _by_kind(views: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    kinds = dict.fromkeys(view["kind"] for view in views)
    return {kind: sorted((v for v in views if v["kind"] == kind), key=lambda v: v["angle_deg"]) for kind in kinds}


def _curves(views: Sequence[Mapping[str, Any]], key: str, scale: float) -> list[Series]:
    def ends(of: Sequence[Mapping[str, Any]], end: str) -> list[float]:
        return [np.nan if v[key][end] is None else scale * v[key][end] for v in of]

    return [
        Series(kind, [v["angle_deg"] for v in of], ends(of, "value"), ends(of, "low"), ends(of, "high"))
        for kind, of in _by_kind(views).items()
    ]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_study(folder, summary, "Overlap of the views (thesis §2.9.4)", tables, charts)
