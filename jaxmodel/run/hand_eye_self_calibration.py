"""The experiment ``hand_eye_self_calibration`` (RR-3507 ch. 4, Figs 4.1, 4.4, Table 4.1), on simulated robots.

With 33 positions the self-calibration sees the target's own points without their model; with 4 far and 9 near positions
the same way is driven once more before an unknown scene. Further: the bias of a classic method where the scale is
unknown, scale and translation from 30 motions, and pure rotations of the robot.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.calibrate import Outcome, Scales, self_calibrate, simulation, solve
from jaxmodel.calibrate import simulated_robot as robot
from jaxmodel.calibrate.errors import quaternion_error
from jaxmodel.io.results import RunDir
from jaxmodel.run import hand_eye_claims as claims
from jaxmodel.run.hand_eye_methods import PUBLISHED, SENTENCE, Stopwatch, solved
from jaxmodel.run.hand_eye_protocol import MOST, Bench, Realisation, padded, references, shown, spread
from jaxmodel.run.hand_eye_report import chosen_table, draw_hand_eye
from jaxmodel.run.hand_eye_study import Cell, HandEyeStudy, Measured
from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table

SELF = "self-calibration"
METHODS = (*PUBLISHED, SELF)
RUNS = {"33 positions": "4.1", "4 positions": "4.4", "9 positions": "4.4"}
_UNKNOWN = 2.7
"""The factor by which every reconstruction is too small; the answer does not depend on it."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """The YAML of the experiment.

    ``near_deg``: between the 9 near positions. ``scene``: unknown points. ``angles_deg``: range of the 30 motions that
    the scale is found from, at relative noise ``noise``. ``pure``: sets of pure rotations, exact and noisy.
    """

    experiment: Literal["hand_eye_self_calibration"] = "hand_eye_self_calibration"
    seed: int = 0
    draws: int = 100
    chunk: int = 50
    bench: Bench = field(default_factory=Bench)
    near_deg: float = 6.0
    scene: int = 60
    scales: tuple[float, ...] = (0.5, 0.8, 1.0, 1.25, 2.0)
    angles_deg: tuple[tuple[float, float], ...] = ((15.0, 30.0), (1.5, 3.0))
    motions: int = 30
    noise: float = 0.01
    pure: int = 20
    resamples: int = 2000

    def __post_init__(self) -> None:
        least = {"seed": 0, "draws": 2, "chunk": 1, "scene": 8, "motions": 2, "pure": 1, "resamples": 100}
        for name, smallest in least.items():
            if getattr(self, name) < smallest:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {smallest} or more")
        if self.motions > MOST or not self.scales or min(self.scales) <= 0 or not self.angles_deg:
            raise ValueError(f"expected at most {MOST} motions, scales above 0, and at least one range of angles_deg")


def prepare(config: Config) -> HandEyeStudy:
    """Cells of unlike columns, each a question: the protocol, the bias, the scale, the pure rotations."""
    clock = Stopwatch()
    cells = [Cell({"question": "protocol"}, config.draws, lambda first, n: _protocol(config, first, n, clock))]
    for scale in config.scales:
        cells.append(
            Cell({"question": f"bias {scale:g}"}, config.draws, lambda first, n, s=scale: _bias(config, s, first, n))
        )
    for number, angles in enumerate(config.angles_deg):
        cells.append(
            Cell(
                {"question": f"scale {number}"},
                config.draws,
                lambda first, n, a=angles, k=number: _scale(config, a, k, first, n),
            )
        )
    for noise in (0.0, config.noise):
        cells.append(
            Cell({"question": f"pure {noise:g}"}, config.pure, lambda first, n, x=noise: _pure(config, x, first, n))
        )
    return HandEyeStudy("hand_eye_self_calibration", config, cells, _summarise)


def _protocol(config: Config, first: int, count: int, clock: Stopwatch) -> Measured:
    """Errors to the reference of methods 1 to 4 with the target, and of self-calibration without it."""
    target: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {run: [] for run in RUNS}
    free: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {run: [] for run in RUNS}
    X = []
    for draw in range(first, first + count):
        one = Realisation(config.bench, config.seed, draw)
        X.append(one.X)
        near = robot.near_positions(one.uniforms(9), np.radians(config.near_deg), one.T_hand_camera)
        ways = {"33 positions": one.far(config.bench.positions), "4 positions": one.far(4), "9 positions": near}
        for run, hand in ways.items():
            measured, camera = one.measured_hand(hand), one.by_target(hand)
            target[run].append((measured, camera))
            if run == "33 positions":
                free[run].append((measured, one.by_reconstruction(hand)))
            else:
                scene = 0.12 * one.normals(3 * config.scene).reshape(-1, 3).clip(-2, 2)
                free[run].append((one.measured_hand(hand), one.by_reconstruction(hand, scene)))
    reference = references(config.bench, target["33 positions"], config.seed, first)
    errors = {"reference, truth": simulation.errors(reference, np.stack(X))}
    for run in RUNS:
        for method, (found, _) in clock.run(PUBLISHED, *padded(target[run])).items():
            errors[f"{run}, {method}"] = simulation.errors(found, reference)
        A, B, mask = padded(free[run])
        A[:, :, :3, 3] /= _UNKNOWN
        found, _ = solved("linear", A, B, mask, unknown_scale=True)
        errors[f"{run}, {SELF}"] = simulation.errors(found, reference)
    return Measured(claims.error_columns(errors))


def _motions(
    config: Config, stream: int, first: int, count: int, angles_deg: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """X, A, B of random motions whose angles fill a range, and normals for their noise."""
    n = config.motions
    drawn = simulation.normals(config.seed, stream, first, count, 6 + 13 * n)
    X, rest = simulation.rigid(drawn[:, :6], 1.0, 1.0), drawn[:, 6:].reshape(count, n, 13)
    axis = rest[..., :3] / np.linalg.norm(rest[..., :3], axis=-1, keepdims=True)
    low, high = np.radians(angles_deg)
    share = np.mod(rest[..., 6:7], 1.0)
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(((low + (high - low) * share) * axis).reshape(-1, 3)).as_matrix()
    B = np.tile(np.eye(4), (count, n, 1, 1))
    B[..., :3, :3], B[..., :3, 3] = turn.reshape(count, n, 3, 3), rest[..., 3:6]
    return X, simulation.conjugate(X, B), B, rest[..., 7:]


def _bias(config: Config, scale: float, first: int, count: int) -> Measured:
    """Exact motions whose camera translations are too small by ``scale``: the classic linear answer and §4.1's bias."""
    X, A, B, _ = _motions(config, 20, first, count, config.angles_deg[0])
    given = A.copy()
    given[..., :3, 3] /= scale
    classic, _ = solved("linear", given, B)
    own, found = solved("linear", given, B, unknown_scale=True)
    left = (A[..., :3, :3] - np.eye(3)).reshape(count, -1, 3)
    wrong = ((1 - 1 / scale) * A[..., :3, 3]).reshape(count, -1)
    predicted = np.stack([np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(left, wrong, strict=True)])
    bias = classic[:, :3, 3] - X[:, :3, 3]
    size = np.linalg.norm(X[:, :3, 3], axis=1)
    return Measured(
        {
            "bias": np.linalg.norm(bias, axis=1) / size,
            "unpredicted": np.linalg.norm(bias - predicted, axis=1) / size,
            "classic rotation (deg)": simulation.errors(classic, X)[0],
            "self translation": simulation.errors(own, X)[1],
            "scale error": np.abs(found / scale - 1),
        }
    )


def _scale(config: Config, angles_deg: tuple[float, float], number: int, first: int, count: int) -> Measured:
    """Scale and X from ``motions`` motions at the report's noise: the linear method, and refined on the group."""
    X, A, B, drawn = _motions(config, 30 + number, first, count, angles_deg)
    A = simulation.with_report_noise(A, config.noise, drawn)
    A[..., :3, 3] /= _UNKNOWN
    columns = {}
    for method in ("linear", "nonlinear on the group"):
        found, scale = solved(method, A, B, unknown_scale=True)
        angle, shift = simulation.errors(found, X)
        columns |= {f"{method} scale error": np.abs(scale / _UNKNOWN - 1), f"{method} translation": shift,
                    f"{method} rotation (deg)": angle}  # fmt: skip
    return Measured(columns)


def _pure(config: Config, noise: float, first: int, count: int) -> Measured:
    """Pure rotations of the robot: told by self-calibration, enough for calibration with the target."""
    X, A, B, drawn = _motions(config, 40, first, count, config.angles_deg[0])
    B[..., :3, 3] = 0.0
    A = simulation.with_report_noise(simulation.conjugate(X, B), noise, drawn)
    tied, whole = [], []
    for a, b in zip(A, B, strict=True):
        whole.append(solve(a, b).outcome is Outcome.SOLVED)
        small = a.copy()
        small[:, :3, 3] /= _UNKNOWN
        tied.append(self_calibrate(small, b, Scales.COMMON).outcome is Outcome.SCALE_TIED)
    return Measured({"tied": np.array(tied, float), "solved with the target": np.array(whole, float)})


def _claims() -> list[claims.Claim]:
    said = published_table("hand_eye")["claims"]
    return [
        claims.Claim(said[key], quantity, f"{run}, {better}", f"{run}, {worse}")
        for key, run, better, worse in (
            ("self", "33 positions", "linear", SELF),
            ("self", "4 positions", "linear", SELF),
            ("self", "9 positions", "linear", SELF),
            ("rotation", "4 positions", "linear", "axis/angle"),
            ("rotation", "9 positions", "linear", "axis/angle"),
            ("rotation", "9 positions", "linear", "dual quaternions"),
            ("rotation", "9 positions", "linear", "nonlinear"),
        )
        for quantity in ((claims.ROTATION,) if key == "rotation" else (claims.ROTATION, claims.TRANSLATION))
    ]


def _summarise(config: Config, rows: polars.DataFrame, seconds: list[dict[str, Any]]) -> dict[str, Any]:
    def of(question: str) -> polars.DataFrame:
        return rows.filter(polars.col("question") == question)

    def spreads(question: str) -> dict[str, Any]:
        part = of(question).drop("question", "draw")
        return {name: spread(part[name].to_numpy()) for name in part.columns if part[name].null_count() == 0}

    protocol = of("protocol")

    def errors(name: str) -> dict[str, Any]:
        angle = protocol[claims.column(name, claims.ROTATION)].to_numpy()
        shift = protocol[claims.column(name, claims.TRANSLATION)].to_numpy()
        return {"rotation": spread(quaternion_error(angle)), "angle_deg": spread(angle), "translation": spread(shift)}

    chosen = (
        f"{config.bench.sentence}; 9 positions {config.near_deg:g}° apart; unknown scene of {config.scene} points; "
        f"the scale's {config.motions} motions at the report's noise {config.noise:g}; {SENTENCE}"
    )
    return {
        "chosen": chosen,
        "reference": errors("reference, truth"),
        "runs": [{"run": r, "method": m, **errors(f"{r}, {m}")} for r in RUNS for m in METHODS],
        "bias": [{"scale": scale, **spreads(f"bias {scale:g}")} for scale in config.scales],
        "scales": [{"angles_deg": a, **spreads(f"scale {k}")} for k, a in enumerate(config.angles_deg)],
        "pure": [
            {"noise": noise, "sets": config.pure,
             **{name: int(of(f"pure {noise:g}")[name].sum()) for name in ("tied", "solved with the target")}}
            for noise in (0.0, config.noise)
        ],
        "claims": [claims.tested(claim, [protocol], config.resamples, config.seed) for claim in _claims()],
    }  # fmt: skip


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Table 4.1 and §4.3 as *published | ours*, the bias, the scale, the pure rotations, the claims."""
    data = published_table("hand_eye")
    lines = []
    for of in summary["runs"]:
        said = ["curve only"] * 2
        if of["run"] in data["table_4_1"]:
            place = METHODS.index(of["method"])
            said = [f"{data['table_4_1'][of['run']][what][place]:.2g}" for what in ("rotation", "translation")]
        elif of["method"] == SELF:
            said = [f"{data['self_calibration_33'][what]:.2g}" for what in ("rotation", "translation")]
        lines.append((f"{of['run']} (Fig. {RUNS[of['run']]})", of["method"], said[0], shown(of["rotation"]),
                      shown(of["angle_deg"]) + "°", said[1], shown(of["translation"])))  # fmt: skip
    columns = ("run", "method", "rotation: published", "ours", "ours, angle", "translation: published", "ours")
    bias = [
        (f"{of['scale']:g}", *(shown(of[k]) for k in ("bias", "unpredicted", "classic rotation (deg)",
                                                       "self translation", "scale error")))
        for of in summary["bias"]
    ]  # fmt: skip
    scales = [
        (f"{of['angles_deg'][0]:g} to {of['angles_deg'][1]:g}°", method,
         *(shown(of[f"{method} {what}"]) for what in ("scale error", "translation", "rotation (deg)")))
        for of in summary["scales"]
        for method in ("linear", "nonlinear on the group")
    ]  # fmt: skip
    pure = [
        (f"{of['noise']:g}", f"{of['tied']} of {of['sets']}", f"{of['solved with the target']} of {of['sets']}")
        for of in summary["pure"]
    ]
    said = data["claims"]
    return [
        Table(f"Published | ours, Table 4.1 and §4.3: errors to the reference, median and 90 % | {command}",
              columns, lines),
        Table(f"Published: {said['bias']} | ours, exact motions",
              ("scale", "classic: bias of t", "not predicted by §4.1", "classic: rotation (°)", "self: t",
               "self: scale"), bias),
        Table("Scale and translation from motions of unknown scale (not in the report)",
              ("motions turn by", "method", "scale", "translation", "rotation (°)"), scales),
        Table(f"Published: {said['tied']} | ours",
              ("noise", "named as tied by self-calibration", "solved with the target"), pure),
        claims.claims_table(summary["claims"], command),
        chosen_table(summary),
    ]  # fmt: skip


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Figs 4.1 and 4.4 and the bias against the scale."""
    names = ["axis/angle", "dual quat.", "nonlinear", "linear", "self"]
    drawn = []
    for figure in ("4.1", "4.4"):
        panels = []
        for run in (run for run in RUNS if RUNS[run] == figure):
            for what, label in (("angle_deg", "rotation error (°)"), ("translation", "|t - t*| / |t*|")):
                values = [of[what] for of in summary["runs"] if of["run"] == run]
                bounds = [[of[key] for of in values] for key in ("value", "low", "high")]
                marks = Series("median, 90 %", names, bounds[0], bounds[1], bounds[2], style="marks")
                panels.append(Panel(f"{run}: {label}", "", "", [marks], log_y=True))
        drawn.append(Chart(f"figure-{figure}", f"Fig. {figure}: errors to the reference", panels))
    series = [
        Series(name, [of["scale"] for of in summary["bias"]], [of[key]["value"] for of in summary["bias"]])
        for name, key in (("classic linear method", "bias"), ("self-calibration", "self translation"))
    ]
    panel = Panel("Bias under an unknown scale (§4.1)", "scale", "median of |t - t*| / |t*|", series)
    return [*drawn, Chart("bias", "Bias of a classic method", [panel])]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye self-calibration (RR-3507 ch. 4)", tables, charts)
