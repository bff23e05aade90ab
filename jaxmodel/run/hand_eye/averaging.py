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
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.protocol import shown, spread
from jaxmodel.run.hand_eye.report import chosen_table, draw_hand_eye
from jaxmodel.run.hand_eye.study import Cell, HandEyeStudy, Measured
from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

REPRESENTATIONS = ("roll_pitch_yaw", "axis_angle", "group")
LOCATIONS = ("mean", "median", "huber_residuals", "huber_weights")
SPREAD = 0.6
"""Standard deviation of the angles of Fig. 3.1 (rad), which has no numbers."""
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
    resamples: int = 2000

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("draws", 2), ("chunk", 1), ("estimates", 3), ("resamples", 100)):
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
    figure = _figure_3_1(config.seed)
    errors, angles = quaternion_error_angle_deg(np.array(data["errors"])), np.array(data["angles_deg"], float)
    return {
        "chosen": f"{config.estimates} estimates with errors of {config.sigma:g} rad and length in each coordinate, "
        "outliers 20 times as far off",
        "angles_of_errors_deg": errors,
        "errors_of_angles": quaternion_error(angles),
        "figure_3_1": figure,
        "means": means,
        "claims": [
            claims.tested(claim, [rows.filter(polars.col("outliers") == share)], config.resamples, config.seed)
            for claim, share in _claims(config.outliers)
        ],
        "statements": _statements(figure, errors, quaternion_error(angles)),
    }


def _figure_3_1(seed: int) -> dict[str, Any]:
    """Angles spread about 0: their counts and means on both intervals, and the mean of §3.3.1."""
    narrow = SPREAD * simulation.normals(seed, len(CASES), 0, 1, 20_000)[0].clip(-5, 5)
    wide, edges = np.mod(narrow, 2 * np.pi), np.linspace(-np.pi, 2 * np.pi, 73)
    return {
        "m": float(np.mean(narrow)),
        "m'": float(np.mean(wide)),
        "chosen": averaging.average_angle(wide),
        "angle": (edges[:-1] + edges[1:]) / 2,
        "narrow": np.histogram(narrow, edges)[0] / len(narrow),
        "wide": np.histogram(wide, edges)[0] / len(wide),
    }


def _claims(outliers: tuple[float, ...]) -> list[tuple[claims.Claim, float]]:
    """Claims, each with the share of outliers that it is tested at, over all true rotations."""
    said = published_table("hand_eye")["claims"]
    pairs = [
        ("means", "roll_pitch_yaw, mean", "group, mean", claims.NO_WORSE),
        ("axis_means", "axis_angle, mean", "group, mean", claims.NO_WORSE),
        ("robust", "roll_pitch_yaw, huber_weights", "roll_pitch_yaw, mean", 1.0),
    ]
    return [
        (claims.Claim(f"{said[key]}, {100 * share:g} % outliers", claims.ROTATION, better, worse, margin), share)
        for share in outliers
        for key, better, worse, margin in pairs
        if share > 0 or key != "robust"
    ]


def _statements(figure: dict[str, Any], angles_deg: np.ndarray, errors: np.ndarray) -> list[dict[str, str]]:
    data = published_table("hand_eye")
    said, table = data["claims"], data["table_3_2"]
    same = [
        abs(a - b) <= _half_a_digit(False, b) for a, b in zip(table["angles_of_errors_deg"], angles_deg, strict=True)
    ]
    same += [abs(a - b) <= _half_a_digit(True, b) for a, b in zip(table["errors_of_angles"], errors, strict=True)]
    other = figure["m'"]
    found = [
        claims.Statement(said["measure"], f"{sum(same)} of {len(same)} values have the same digits", all(same)),
        claims.Statement(
            said["wrap"],
            f"means {figure['m']:.3f} and {other:.3f} rad, taken {figure['chosen']:.3f}",
            abs(figure["chosen"] - figure["m"]) < 1e-9 < abs(other) - abs(figure["m"]),
        ),
    ]
    return [one.row for one in found]


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Table 3.2 as *published | ours*, Fig. 3.1, Tables 3.3 and 4.1 in degrees, and the means."""
    data = published_table("hand_eye")
    published = data["table_3_2"]
    table = []
    for of, sign, key, form in (
        ("errors", "error {:g}", "angles_of_errors_deg", "{:.4f}°"),
        ("angles_deg", "angle {:g}°", "errors_of_angles", "{:.4e}"),
    ):
        for given, theirs, ours in zip(published[of], published[key], summary[key], strict=True):
            same = abs(theirs - ours) <= _half_a_digit(key == "errors_of_angles", ours)
            verdict = "the same digits" if same else "differs in the last digits"
            table.append((sign.format(given), form.format(theirs), form.format(ours), verdict))  # fmt: skip
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
        claims.claims_table(summary["claims"], command),
        claims.statements_table(summary["statements"], command),
        chosen_table(summary),
    ]  # fmt: skip


def _half_a_digit(as_error: bool, value: float) -> float:
    """Half of the last digit that Table 3.2 prints of a value."""
    return 1.0001 * 5e-5 * (10 ** np.floor(np.log10(value)) if as_error else 1.0)


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Fig. 3.1, and the error of every mean, a panel for each case."""
    panels = []
    for case, share in dict.fromkeys((of["rotation"], of["outliers"]) for of in summary["means"]):
        series = []
        for representation in REPRESENTATIONS:
            of = [
                one["error_deg"]
                for one in summary["means"]
                if (one["rotation"], one["outliers"], one["representation"]) == (case, share, representation)
            ]
            names = ["mean", "median", "Huber by residuals", "Huber by weights"]
            bounds = [[one[key] for one in of] for key in ("value", "low", "high")]
            series.append(Series(representation.replace("_", " "), names, bounds[0], bounds[1], bounds[2], "bars"))
        panels.append(Panel(f"{case}, {100 * share:g} % outliers", "", "rotation error (°)", series))
    return [_figure(summary["figure_3_1"]), Chart("means", "Mean transforms (§3.3)", panels)]


def _figure(of: Mapping[str, Any]) -> Chart:
    """Fig. 3.1."""
    series = [
        Series("angles on ]-pi, pi]", of["angle"], of["narrow"]),
        Series("angles on [0, 2 pi[", of["angle"], of["wide"]),
        *(
            Series(f"{name} = {of[key]:.2f} rad", [of[key]] * 2, [0.0, height * max(of["narrow"])])
            for name, key, height in (("m", "m", 0.3), ("m'", "m'", 0.3), ("mean of §3.3.1", "chosen", 0.15))
        ),
    ]
    panel = Panel("Fig. 3.1: the mean of angles about 0", "angle (rad)", "share of the angles", series)
    return Chart("figure-3.1", "Fig. 3.1: two means of the same angles", [panel])


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye: error measures and means (RR-3507 §3.3, 3.4)", tables, charts)
