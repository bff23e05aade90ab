"""The experiment ``hand_eye_averaging`` (RR-3507 §3.3, 3.4, Table 3.2, Fig. 3.1): error measures, mean transforms."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
import polars
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import averaging, simulation
from jaxmodel.calibrate.errors import quaternion_error, quaternion_error_angle_deg
from jaxmodel.geometry import se3
from jaxmodel.io.results import RunDir
from jaxmodel.run.hand_eye_protocol import shown, spread
from jaxmodel.run.hand_eye_report import chosen_table, draw_hand_eye
from jaxmodel.run.hand_eye_study import Cell, HandEyeStudy, Measured
from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

REPRESENTATIONS = ("roll_pitch_yaw", "axis_angle", "group")
LOCATIONS = ("mean", "median", "huber_residuals", "huber_weights")
CASES = {"near 0": 0.05, "ordinary": 1.0, "near pi": np.pi}


@dataclass(frozen=True, kw_only=True)
class Config:
    """The YAML: ``estimates`` of one transform with errors of ``sigma`` (rad, length), a share of them gross ones."""

    experiment: Literal["hand_eye_averaging"] = "hand_eye_averaging"
    seed: int = 0
    draws: int = 100
    chunk: int = 50
    estimates: int = 30
    sigma: float = 0.02
    outliers: tuple[float, ...] = (0.0, 0.2)

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("draws", 2), ("chunk", 1), ("estimates", 3)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {least} or more")
        if not self.sigma > 0 or not self.outliers or not 0 <= min(self.outliers) <= max(self.outliers) < 0.5:
            raise ValueError("expected sigma above 0 and outliers from 0 to below 0.5")


def prepare(config: Config) -> HandEyeStudy:
    """A cell for each angle of the true rotation and each share of outliers."""
    cells = []
    for stream, case in enumerate(CASES):
        for share in config.outliers:

            def measure(first: int, count: int, s: int = stream, c: str = case, o: float = share) -> Measured:
                return _measure(config, s, CASES[c], o, first, count)

            cells.append(Cell({"rotation": case, "outliers": share}, config.draws, measure))
    return HandEyeStudy("hand_eye_averaging", config, cells, _summarise)


def _measure(config: Config, stream: int, angle: float, share: float, first: int, count: int) -> Measured:
    n = config.estimates
    drawn = simulation.normals(config.seed, stream, first, count, 6 + 6 * n)
    columns: dict[str, list[float]] = {}
    for row in drawn:
        axis = row[:3] / np.linalg.norm(row[:3])
        true = se3.compose(Rotation.from_rotvec(angle * axis).as_matrix(), row[3:6])
        error = config.sigma * row[6:].reshape(n, 6)
        error[: round(share * n)] *= 20
        wrong = Rotation.from_rotvec(error[:, :3]).as_matrix()
        found = se3.compose(wrong @ true[:3, :3], true[:3, 3] + error[:, 3:])
        for representation in REPRESENTATIONS:
            for location in LOCATIONS:
                mean = averaging.average(found, cast(Any, representation), cast(Any, location))
                turn, shift = simulation.errors(mean, true)
                columns.setdefault(f"{representation}, {location}: rotation_deg", []).append(float(turn))
                columns.setdefault(f"{representation}, {location}: translation", []).append(float(shift))
    return Measured({name: np.array(values) for name, values in columns.items()})


def _summarise(config: Config, rows: polars.DataFrame, seconds: list[dict[str, Any]]) -> dict[str, Any]:
    data = published_table("hand_eye")["table_3_2"]
    means = []
    for (case, share), of in rows.group_by("rotation", "outliers", maintain_order=True):
        for representation in REPRESENTATIONS:
            for location in LOCATIONS:
                column = of[f"{representation}, {location}: rotation_deg"].to_numpy()
                means.append({"rotation": case, "outliers": share, "representation": representation,
                              "location": location, "error_deg": spread(column)})  # fmt: skip
    centred = np.linspace(-0.3, 0.3, 61)  # Fig. 3.1: angles spread about 0
    wide = np.mod(centred, 2 * np.pi)
    return {
        "chosen": f"{config.estimates} estimates with errors of {config.sigma:g} rad and length in each coordinate, "
        "outliers 20 times as far off",
        "angles_of_errors_deg": quaternion_error_angle_deg(np.array(data["errors"])),
        "errors_of_angles": quaternion_error(np.array(data["angles_deg"], float)),
        "figure_3_1": {"m": float(np.mean(centred)), "m'": float(np.mean(wide)),
                       "chosen": averaging.average_angle(wide)},
        "means": means,
    }  # fmt: skip


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Table 3.2 as *published | ours*, Fig. 3.1, Tables 3.3 and 4.1 in degrees, and the means."""
    data = published_table("hand_eye")
    published = data["table_3_2"]
    table = [
        (f"error {error:g}", f"{theirs:.4f}°", f"{ours:.4f}°", _same(theirs, ours, 5e-5))
        for error, theirs, ours in zip(
            published["errors"], published["angles_of_errors_deg"], summary["angles_of_errors_deg"], strict=True
        )
    ] + [
        (
            f"angle {angle:g}°",
            f"{theirs:.4e}",
            f"{ours:.4e}",
            _same(theirs, ours, 5e-5 * 10 ** np.floor(np.log10(ours))),
        )
        for angle, theirs, ours in zip(
            published["angles_deg"], published["errors_of_angles"], summary["errors_of_angles"], strict=True
        )
    ]
    in_degrees = [
        (name, str(place + 1), f"{error:.3g}", f"{float(quaternion_error_angle_deg(np.array(error))):.3g}°")
        for key in ("table_3_3", "table_4_1")
        for name, of in data[key].items()
        for place, error in enumerate(of["rotation"])
    ]
    said = data["self_calibration_33"]
    ours = float(quaternion_error_angle_deg(np.array(said["rotation"])))
    in_degrees.append(("33 positions", "5", f"{said['rotation']:g}, said to be {said['said_deg']:g}°", f"{ours:.3g}°"))
    figure = summary["figure_3_1"]
    means = [
        (f"{of['rotation']}, {100 * of['outliers']:g} % outliers", of["representation"].replace("_", " "),
         of["location"].replace("_", " by "), shown(of["error_deg"]) + "°")
        for of in summary["means"]
    ]  # fmt: skip
    row = tuple(f"{figure[key]:.4f}" for key in ("m", "m'", "chosen"))
    return [
        Table("Fig. 3.1: mean of angles spread about 0 (rad)",
              ("m, on ]-pi, pi]", "m', on [0, 2 pi[", "the method of §3.3.1"), [row]),
        Table("Means of many estimates: rotation error, median and 90 % of the draws",
              ("true rotation", "representation", "location", "error"), means),
        Table("The report's rotation errors as angles (Tables 3.3, 4.1, §4.3)",
              ("run", "method", "published", "as an angle"), in_degrees),
        Table(f"Published | ours, Table 3.2 | {command}", ("of", "published", "ours", "verdict"), table),
        chosen_table(summary),
    ]  # fmt: skip


def _same(theirs: float, ours: float, half_a_digit: float) -> str:
    return "the same digits" if abs(theirs - ours) <= 1.0001 * half_a_digit else "differs in the last digits"


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Error of every mean, a panel for each case."""
    panels = []
    for case, share in dict.fromkeys((of["rotation"], of["outliers"]) for of in summary["means"]):
        series = []
        for representation in REPRESENTATIONS:
            of = [
                one["error_deg"]
                for one in summary["means"]
                if (one["rotation"], one["outliers"], one["representation"]) == (case, share, representation)
            ]
            names = ["mean", "median", "Huber, res.", "Huber, wts."]
            bounds = [[one[key] for one in of] for key in ("value", "low", "high")]
            series.append(Series(representation.replace("_", " "), names, bounds[0], bounds[1], bounds[2], "bars"))
        panels.append(Panel(f"{case}, {100 * share:g} % outliers", "", "rotation error (°)", series))
    return [Chart("means", "Mean transforms (§3.3)", panels)]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye: error measures and means (RR-3507 §3.3, 3.4)", tables, charts)
