"""The experiment ``hand_eye_noise`` (RR-3507 §3.5.1, Figs 3.2 to 3.4): two motions under growing noise."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import polars

from jaxmodel.calibrate import simulation
from jaxmodel.io.results import RunDir
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.methods import OURS, PUBLISHED, SENTENCE, Stopwatch
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
MOTIONS = 2
NOISE = "noise (share of each angle and of the length)"


@dataclass(frozen=True)
class Amplitude:
    """Standard deviations of the hand's roll, pitch and yaw (rad) and of its translations' coordinates."""

    angle: float
    length: float

    def __post_init__(self) -> None:
        if not (self.angle > 0 and self.length >= 0):
            raise ValueError(f"angle is {self.angle} and length {self.length}, expected angle > 0 and length >= 0")


@dataclass(frozen=True, kw_only=True)
class Config:
    """The YAML of the experiment. ``report_draws``: the first so many draws are the report's own protocol."""

    experiment: Literal["hand_eye_noise"] = "hand_eye_noise"
    seed: int = 0
    draws: int = 10_000
    report_draws: int = 100
    chunk: int = 2500
    noise: tuple[float, ...] = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18, 0.2)
    large: Amplitude = Amplitude(1.0, 1.0)
    small: Amplitude = Amplitude(0.05, 0.05)
    resamples: int = 400

    def __post_init__(self) -> None:
        check_draws(self)
        if not self.noise or min(self.noise) < 0 or max(self.noise) == 0:
            raise ValueError("noise holds nothing above 0, expected levels >= 0, at least one of them above 0")


def prepare(config: Config) -> HandEyeStudy:
    """The cells: both amplitudes at every noise level, the same draws at all of them."""
    clock, cells = Stopwatch(), []
    for stream, name in enumerate(("large", "small")):
        amplitude: Amplitude = getattr(config, name)
        for noise in config.noise:

            def measure(
                first: int, count: int, s: int = stream, a: Amplitude = amplitude, x: float = noise
            ) -> Measured:
                return _measure(config.seed, s, a, x, first, count, clock)

            cells.append(Cell({"motions": name, "noise": noise}, config.draws, measure))
    return HandEyeStudy("hand_eye_noise", config, cells, _summarise)


def _measure(
    seed: int, stream: int, amplitude: Amplitude, noise: float, first: int, count: int, clock: Stopwatch
) -> Measured:
    drawn = simulation.normals(seed, stream, first, count, 6 + 12 * MOTIONS)
    X = simulation.rigid(drawn[:, :6], 1.0, 1.0)
    rest = drawn[:, 6:].reshape(count, 2, MOTIONS, 6)
    B = simulation.rigid(rest[:, 0], amplitude.angle, amplitude.length)
    A = simulation.with_report_noise(simulation.conjugate(X, B), noise, rest[:, 1])
    found = clock.run(METHODS, A, B)
    errors = {method: simulation.errors(of, X) for method, (of, _) in found.items()}
    return Measured(claims.error_columns(errors), {method: seconds for method, (_, seconds) in found.items()})


def _claims() -> list[tuple[str, claims.Claim]]:
    said = published_table("hand_eye")["claims"]
    complex_ones, linear_ones = ("dual quaternions", "nonlinear"), ("linear", "axis/angle")
    found = []
    for linear in linear_ones:
        for other in complex_ones:
            found.append(("large", claims.Claim(said["noise_large_rotation"], claims.ROTATION, linear, other)))
    for linear in linear_ones:
        for other in complex_ones:
            found.append(("large", claims.Claim(said["noise_large_translation"], claims.TRANSLATION, other, linear)))
    for quantity in (claims.ROTATION, claims.TRANSLATION):
        for other in complex_ones:
            found.append(("small", claims.Claim(said["noise_small_complex"], quantity, "linear", other)))
        found.append(("small", claims.Claim(said["noise_small_axis"], quantity, "linear", "axis/angle")))
    for motions in ("large", "small"):
        for other in ("axis/angle", *complex_ones):
            names = "linear", other
            found.append((motions, claims.Claim(said["translation"], claims.TRANSLATION, *names, claims.NO_WORSE)))
    return found


def _summarise(config: Config, rows: polars.DataFrame, seconds: list[dict[str, Any]]) -> dict[str, Any]:
    levels = [noise for noise in config.noise if noise > 0]
    tests = []
    for motions, claim in _claims():
        of = rows.filter(polars.col("motions") == motions)
        cells = [of.filter(polars.col("noise") == noise) for noise in levels]
        tests.append(claims.tested_twice(claim, cells, config.report_draws, config.resamples, config.seed))
    curves = [
        {"motions": motions, "noise": noise, "draws": draws, "method": method, **claims.described(cell, method)}
        for motions in ("large", "small")
        for noise in config.noise
        for cell_all in [rows.filter((polars.col("motions") == motions) & (polars.col("noise") == noise))]
        for draws in dict.fromkeys((config.report_draws, config.draws))
        for cell in [cell_all.filter(polars.col("draw") < draws)]
        for method in METHODS
    ]
    chosen = (
        f"large motions {config.large.angle:g} rad and length {config.large.length:g}, small ones "
        f"{config.small.angle:g} rad and {config.small.length:g} (standard deviations of each angle and coordinate; "
        f"X: 1 rad and 1); {SENTENCE}"
    )
    return {"chosen": chosen, "report_draws": config.report_draws, "all_draws": config.draws, "claims": tests,
            "curves": curves}  # fmt: skip


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Errors at the middle noise and at the largest, times, and the claims."""
    levels = sorted({of["noise"] for of in summary["curves"]})
    picked = list(dict.fromkeys((levels[len(levels) // 2], levels[-1])))
    rows = [
        (f"{of['motions']}, noise {of['noise']:g}", str(of["draws"]), of["method"], *error_cells(of))
        for of in summary["curves"]
        if of["noise"] in picked and of["draws"] == summary["all_draws"]
    ]
    errors = Table(
        "Two motions (Figs 3.2 and 3.4 are curves without numbers)", ("motions", "draws", "method", *ERRORS), rows
    )
    return [errors, times_table(summary, "Fig. 3.3", ("motions",)), claims.claims_table(summary["claims"], command),
            chosen_table(summary)]  # fmt: skip


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Figs 3.2 and 3.4 with the report's draws and with all of them, and Fig. 3.3."""
    drawn = []
    for figure, motions in (("3.2", "large"), ("3.4", "small")):
        for draws in dict.fromkeys((summary["report_draws"], summary["all_draws"])):
            curves = [of for of in summary["curves"] if of["motions"] == motions and of["draws"] == draws]
            title = f"Fig. {figure}, two {motions} motions, {draws} draws"
            panels = error_panels(curves, "noise", NOISE, METHODS, title)
            drawn.append(Chart(f"figure-{figure}-{draws}-draws", title, panels))
    panels = []
    for motions in ("large", "small"):
        of = [one for one in summary["times"] if one["motions"] == motions and one["seconds"]]
        series = [Series(m, [one["noise"] for one in of], [1e6 * one["seconds"][m] for one in of]) for m in METHODS]
        if of:  # a resumed run has the times of its own part alone
            panels.append(Panel(f"Fig. 3.3, two {motions} motions", NOISE, TIME, series, log_y=True))
    return [*drawn, *([Chart("figure-3.3-times", "Fig. 3.3: time", panels)] if panels else [])]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye: noise (RR-3507 §3.5.1)", tables, charts)
