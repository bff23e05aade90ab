"""The experiment ``hand_eye_count`` (RR-3507 §3.5.2, Figs 3.5, 3.6): from 2 to 15 small rotations of the robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.calibrate import simulation
from jaxmodel.io.results import RunDir
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.methods import OURS, PUBLISHED, SENTENCE, Stopwatch, all_solved
from jaxmodel.run.hand_eye.report import (
    ERRORS,
    TIME,
    check_draws,
    chosen_table,
    draw_hand_eye,
    error_cells,
    error_panels,
    times_table,
)
from jaxmodel.run.hand_eye.study import Cell, HandEyeStudy, Measured
from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

METHODS = (*PUBLISHED, *OURS)
MOST = 16


@dataclass(frozen=True, kw_only=True)
class Config:
    """The YAML of the experiment.

    ``angle`` (rad) and ``length``: standard deviations of the hand's angles and translations; the report has pure
    rotations (length 0). ``timed``: the numbers of motions whose computing time is taken.
    """

    experiment: Literal["hand_eye_count"] = "hand_eye_count"
    seed: int = 0
    draws: int = 10_000
    report_draws: int = 100
    chunk: int = 2500
    counts: tuple[int, ...] = tuple(range(2, 16))
    timed: tuple[int, ...] = (2, 8, 15)
    noise: float = 0.01
    angle: float = 0.05
    length: float = 0.0
    resamples: int = 400

    def __post_init__(self) -> None:
        check_draws(self)
        if not self.counts or min(self.counts) < 2 or max(self.counts) > MOST:
            raise ValueError(f"counts must be numbers of motions from 2 to {MOST}, and at least one of them")
        if not (self.noise > 0 and self.angle > 0 and self.length >= 0):
            raise ValueError("noise and angle must be above 0, and length not below it")


def prepare(config: Config) -> HandEyeStudy:
    """A cell for each number of motions; fewer motions are the first of the same draw."""
    clock, cells = Stopwatch(), []
    for motions in config.counts:

        def measure(first: int, count: int, n: int = motions) -> Measured:
            return _measure(config, n, first, count, clock)

        cells.append(Cell({"motions": motions}, config.draws, measure))
    return HandEyeStudy("hand_eye_count", config, cells, _summarise)


def _measure(config: Config, motions: int, first: int, count: int, clock: Stopwatch) -> Measured:
    drawn = simulation.normals(config.seed, 0, first, count, 6 + 12 * MOST)
    X = simulation.rigid(drawn[:, :6], 1.0, 1.0)
    rest = drawn[:, 6:].reshape(count, MOST, 2, 6)
    B = simulation.rigid(rest[:, :, 0], config.angle, config.length)
    A = simulation.with_report_noise(simulation.conjugate(X, B), config.noise, rest[:, :, 1])
    mask = np.broadcast_to(np.arange(MOST) < motions, (count, MOST))
    found = all_solved(METHODS, A, B, mask)
    seconds = {}
    if motions in config.timed:  # without the padding that lets one program serve all numbers
        timed = clock.run(METHODS, A[:, :motions], B[:, :motions])
        seconds = {method: taken for method, (_, taken) in timed.items()}
    return Measured(claims.error_columns({method: simulation.errors(of, X) for method, of in found.items()}), seconds)


def _claims() -> list[claims.Claim]:
    said = published_table("hand_eye")["claims"]
    keys = {claims.ROTATION: "count_rotation", claims.TRANSLATION: "count_translation"}
    return [
        claims.Claim(said[key], quantity, "linear", other)
        for quantity, key in keys.items()
        for other in PUBLISHED
        if other != "linear"
    ]


def _summarise(config: Config, rows: polars.DataFrame, seconds: list[dict[str, Any]]) -> dict[str, Any]:
    cells = {n: rows.filter(polars.col("motions") == n) for n in config.counts}
    tests = [
        claims.tested_twice(claim, list(cells.values()), config.report_draws, config.resamples, config.seed)
        for claim in _claims()
    ]
    curves = [
        {"motions": n, "draws": draws, "method": method, **claims.described(of, method)}
        for n, cell in cells.items()
        for draws in dict.fromkeys((config.report_draws, config.draws))
        for of in [cell.filter(polars.col("draw") < draws)]
        for method in METHODS
    ]
    chosen = (
        f"hand: angles of {config.angle:g} rad (standard deviation of each), translations {config.length:g}; "
        f"noise {config.noise:g}; X: 1 rad and 1; {SENTENCE}"
    )
    return {"chosen": chosen, "report_draws": config.report_draws, "all_draws": config.draws, "claims": tests,
            "curves": curves, "statements": _statements(seconds)}  # fmt: skip


def _statements(seconds: list[dict[str, Any]]) -> list[dict[str, str]]:
    """Whether the linear method's time is constant (within a tenth) and the shortest of the report's four."""
    timed = [of for of in seconds if of["seconds"]]
    if len(timed) < 2:
        return []
    said, first, last = published_table("hand_eye")["claims"], timed[0], timed[-1]
    ratio = {method: last["seconds"][method] / first["seconds"][method] for method in METHODS}
    fastest = min(PUBLISHED, key=last["seconds"].__getitem__)
    grown = ", ".join(f"{method} {of:.2f}" for method, of in ratio.items())
    words = f"time with {last['motions']} / with {first['motions']} motions: {grown}"
    shortest = f"{last['seconds'][fastest] * 1e6:.0f} microseconds with {last['motions']} motions: {fastest}"
    found = [
        claims.Statement(said["count_time"], words, 0.9 <= ratio["linear"] <= 1.1),
        claims.Statement(said["count_short"], f"the shortest of the report's four, {shortest}", fastest == "linear"),
    ]
    return [one.row for one in found]


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Errors with few, some and most motions, times, and the claims."""
    counts = sorted({of["motions"] for of in summary["curves"]})
    picked = dict.fromkeys((counts[0], counts[len(counts) // 2], counts[-1]))
    rows = [
        (f"{of['motions']} motions", of["method"], *error_cells(of))
        for of in summary["curves"]
        if of["motions"] in picked and of["draws"] == summary["all_draws"]
    ]
    found = [
        Table("Small rotations (Fig. 3.5 is a curve without numbers)", ("motions", "method", *ERRORS), rows),
        times_table(summary, "Fig. 3.6", ("motions",)),
    ]
    return [*found, claims.claims_table(summary["claims"], command),
            claims.statements_table(summary["statements"], command), chosen_table(summary)]  # fmt: skip


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Fig. 3.5 with the report's draws and with all of them, and Fig. 3.6."""
    drawn = []
    for draws in dict.fromkeys((summary["report_draws"], summary["all_draws"])):
        curves = [of for of in summary["curves"] if of["draws"] == draws]
        title = f"Fig. 3.5, small rotations, {draws} draws"
        panels = error_panels(curves, "motions", "number of motions", METHODS, title)
        drawn.append(Chart(f"figure-3.5-{draws}-draws", title, panels))
    timed = [of for of in summary["times"] if of["seconds"]]
    if timed:
        places = [of["motions"] for of in timed]
        series = [Series(m, places, [1e6 * of["seconds"][m] for of in timed]) for m in METHODS]
        panel = Panel("Fig. 3.6, small rotations", "number of motions", TIME, series, log_y=True)
        drawn.append(Chart("figure-3.6-times", "Fig. 3.6: time", [panel]))
    return drawn


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye: number of motions (RR-3507 §3.5.2)", tables, charts)
