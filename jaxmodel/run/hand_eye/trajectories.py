"""The experiment ``hand_eye_trajectories`` (RR-3507 §3.6, Figs 3.8 to 3.11, Table 3.3), on simulated robots.

Trajectory 1 has 33 positions far from each other and makes the reference; trajectory 2 has two large motions and then
60 that decay exponentially, calibrated as a whole, without the large motions (expo), and with them alone (init).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.calibrate import simulated_robot as robot
from jaxmodel.calibrate import simulation
from jaxmodel.calibrate.errors import quaternion_error, quaternion_error_angle_deg
from jaxmodel.io.results import RunDir
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.methods import FROM_IDENTITY, PUBLISHED, SENTENCE, UNIT_AXES, all_solved
from jaxmodel.run.hand_eye.protocol import (
    MOST,
    Bench,
    Realisation,
    agreement,
    deviations,
    padded,
    padded_length,
    references,
    shown,
    spread,
)
from jaxmodel.run.hand_eye.report import chosen_table, draw_hand_eye, marks_panel
from jaxmodel.run.hand_eye.study import Cell, HandEyeStudy, Measured
from jaxmodel.run.hand_eye.weights import Weights, measured, summarised, weights_table
from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart
from jaxmodel.view.table import Table

METHODS = (*PUBLISHED, UNIT_AXES, FROM_IDENTITY, "nonlinear on the group")
FAR = "trajectory 1"
RUNS = {FAR: "3.8", "complete": "3.9", "expo": "3.10", "init": "3.11"}
NAMES = ("axis / angle", "dual quat.", "nonlinear", "linear", "unit axes", "nonl. from identity", "nonl. on group")
RESIDUALS = {
    "rotation": "mean of 2 - 2 cos(angle / 2)",
    "translation": "mean of |t_AX - t_XB| / |t_XB|",
}


@dataclass(frozen=True, kw_only=True)
class Config:
    """The YAML of the experiment.

    ``turn_deg``: the large motions; ``small_deg``: all 60 small ones together. ``weights``: those the nonlinear method
    is tried with.
    """

    experiment: Literal["hand_eye_trajectories"] = "hand_eye_trajectories"
    seed: int = 0
    draws: int = 100
    chunk: int = 50
    bench: Bench = field(default_factory=Bench)
    turn_deg: float = 50.0
    small_deg: float = 20.0
    steps: int = 60
    decay: float = 0.1
    weights: tuple[Weights, ...] = (Weights(),)
    resamples: int = 2000

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("draws", 2), ("chunk", 1), ("resamples", 100), ("steps", 2)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {least} or more")
        if self.steps > MOST - 2 or not (self.turn_deg > 0 and self.small_deg > 0 and self.decay > 0):
            raise ValueError(f"expected at most {MOST - 2} steps, and turn_deg, small_deg and decay above 0")


def prepare(config: Config) -> HandEyeStudy:
    """One cell: each draw is a robot that drives both trajectories."""
    cell = Cell({"protocol": "trajectories"}, config.draws, lambda first, count: _measure(config, first, count))
    return HandEyeStudy("hand_eye_trajectories", config, [cell], _summarise)


def _measure(config: Config, first: int, count: int) -> Measured:
    far, whole, X = [], [], []
    for draw in range(first, first + count):
        one = Realisation(config.bench, config.seed, draw)
        X.append(one.X)
        hand = one.far(config.bench.positions)
        far.append((one.measured_hand(hand), one.by_target(hand)))
        turn, small = np.radians(config.turn_deg), np.radians(config.small_deg)
        hand = robot.exponential_positions(one.T_hand_camera, turn, small, config.steps, config.decay)
        whole.append((one.measured_hand(hand), one.by_target(hand)))
    truth, reference = np.stack(X), references(config.bench, far, config.seed, first)
    parts = {
        FAR: far,
        "complete": whole,
        "expo": [(hand[2:], camera[2:]) for hand, camera in whole],
        "init": [(hand[:3], camera[:3]) for hand, camera in whole],
    }
    errors, columns = {"reference, truth": simulation.errors(reference, truth)}, {}
    most = padded_length(max(config.bench.positions - 1, config.steps + 2))
    for run, poses in parts.items():
        motions = padded(poses, most)
        columns |= measured(run, motions, reference, config.weights)
        for method, found in all_solved(METHODS, *motions).items():
            errors[f"{run}, {method}"] = simulation.errors(found, reference)
            errors[f"{run}, {method}, truth"] = simulation.errors(found, truth)
            for what, values in zip(RESIDUALS, deviations(motions, found), strict=True):
                columns[f"{run}, {method}: {what} residual"] = values
    return Measured({**claims.error_columns(errors), **columns})


def _claims() -> list[claims.Claim]:
    said = published_table("hand_eye")["claims"]

    def both(key: str, run: str, better: str, worse: str) -> list[claims.Claim]:
        names = f"{run}, {better}", f"{run}, {worse}"
        return [claims.Claim(said[key], quantity, *names) for quantity in (claims.ROTATION, claims.TRANSLATION)]

    found = []
    for nonlinear in ("nonlinear", FROM_IDENTITY):
        found += both("few", "init", "linear", nonlinear)
        found += both("many", "expo", nonlinear, "axis/angle")
    for run in ("init", "expo"):
        found += both("both", run, "linear", "axis/angle") + both("both", run, "linear", "dual quaternions")
    for lost in ("axis/angle", UNIT_AXES, "dual quaternions"):
        found += both("lost", "expo", "linear", lost) + both("whole", "complete", "linear", lost)
    for run in RUNS:
        for other in PUBLISHED[:3]:
            turn, shift = both("rotation", run, "linear", other)
            found += [turn] if run == FAR else []
            found.append(shift._replace(says=said["translation"], margin=claims.NO_WORSE))
    return found


def _statements(runs: list[dict[str, Any]]) -> list[dict[str, str]]:
    """What the captions of Figs 3.9 and 3.11 say of the residuals in rotation."""
    said = published_table("hand_eye")["claims"]
    of = {(one["run"], one["method"]): one["residuals"]["rotation"]["value"] for one in runs}
    least = min(of["complete", method] for method in PUBLISHED if method != "linear")
    small = of["complete", "linear"] / least
    found = [claims.Statement(said["drawn"], f"linear / best of the others: {small:.2g}", small < 0.1)]
    large = {method: of["init", method] / of["init", "linear"] for method in ("nonlinear", FROM_IDENTITY)}
    ours = ", ".join(f"{method} / linear: {ratio:.2g}" for method, ratio in large.items())
    return [one.row for one in (*found, claims.Statement(said["thousand"], ours, max(large.values()) > 100))]


def _summarise(config: Config, rows: polars.DataFrame, seconds: list[dict[str, Any]]) -> dict[str, Any]:
    def errors(name: str) -> dict[str, Any]:
        angle = rows[claims.column(name, claims.ROTATION)].to_numpy()
        shift = rows[claims.column(name, claims.TRANSLATION)].to_numpy()
        return {"rotation": spread(quaternion_error(angle)), "angle_deg": spread(angle), "translation": spread(shift)}

    runs = [
        {
            "run": run,
            "method": method,
            **errors(f"{run}, {method}"),
            "truth": errors(f"{run}, {method}, truth"),
            "residuals": {what: spread(rows[f"{run}, {method}: {what} residual"].to_numpy()) for what in RESIDUALS},
        }
        for run in RUNS
        for method in METHODS
    ]
    tests = [claims.tested(claim, [rows], config.resamples, config.seed) for claim in _claims()]
    weights = summarised(rows, list(RUNS), config.weights)
    chosen = (
        f"{config.bench.sentence}; trajectory 2: two motions of {config.turn_deg:g}°, then {config.steps} of "
        f"{config.small_deg:g}° in all, decaying as exp(-{config.decay:g} k) in every joint; {SENTENCE}"
    )
    return {"chosen": chosen, "reference": errors("reference, truth"), "runs": runs, "claims": tests,
            "statements": _statements(runs), "weights": weights}  # fmt: skip


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Residuals of the four figures, the reference, Table 3.3 as *published | ours*, and the claims."""
    residuals = [
        (f"{of['run']} (Fig. {RUNS[of['run']]})", of["method"], *(shown(of["residuals"][what]) for what in RESIDUALS))
        for of in summary["runs"]
    ]
    lines = []
    for of in summary["runs"]:
        turn, shift = (_published(of["run"], of["method"], what) for what in RESIDUALS)
        lines.append((of["run"], of["method"], *agreement(turn, of["rotation"]), *agreement(shift, of["translation"]),
                      shown(of["truth"]["rotation"]), shown(of["truth"]["translation"])))  # fmt: skip
    columns = ("run", "method", "rotation: published", "ours", "published is", "translation: published", "ours",
               "published is", "rotation, to the truth", "translation, to the truth")  # fmt: skip
    reference = summary["reference"]
    row = (shown(reference["angle_deg"]) + "°", shown(reference["translation"]))
    return [
        Table("How far AX is from XB (Figs 3.8 to 3.11): median and 90 % of the robots", ("run", "method", *RESIDUALS),
              residuals),
        Table("The reference's own error", ("rotation", "translation"), [row]),
        weights_table(summary["weights"]),
        Table(f"Published | ours, Table 3.3: errors to the reference, median and 90 % of the robots | {command}",
              columns, lines),
        claims.claims_table(summary["claims"], command),
        claims.statements_table(summary["statements"], command),
        chosen_table(summary),
    ]  # fmt: skip


def _published(run: str, method: str, what: str) -> float | None:
    """The value of Table 3.3, where it has one."""
    of = published_table("hand_eye")["table_3_3"].get(run)
    return None if of is None or method not in PUBLISHED else of[what][PUBLISHED.index(method)]


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Figs 3.8 to 3.11 as medians and ranges, and Table 3.3."""
    runs = {run: [of for of in summary["runs"] if of["run"] == run] for run in RUNS}
    drawn = []
    for run, figure in RUNS.items():
        panels = [
            marks_panel(
                f"Fig. {figure}, {run}: AX against XB", label, NAMES, [of["residuals"][what] for of in runs[run]]
            )
            for what, label in RESIDUALS.items()
        ]
        drawn.append(Chart(f"figure-{figure}-{run.replace(' ', '-')}", f"Fig. {figure}: {run}", panels))
    panels = []
    for key, what, label in (
        ("angle_deg", "rotation", "error to the reference (°)"),
        ("translation", "translation", "|t - t*| / |t*| to the reference"),
    ):
        for run in ("complete", "expo", "init"):
            theirs = [_published(run, method, what) for method in METHODS]
            if key == "angle_deg":
                theirs = [None if of is None else float(quaternion_error_angle_deg(np.array(of))) for of in theirs]
            panels.append(marks_panel(f"{run}: {what}", label, NAMES, [of[key] for of in runs[run]], theirs))
    return [*drawn, Chart("table-3.3", "Table 3.3: errors to the reference", panels)]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye: trajectories (RR-3507 §3.6)", tables, charts)
