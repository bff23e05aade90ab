"""The experiment ``hand_eye_self_calibration`` (RR-3507 ch. 4, Figs 4.1, 4.4, Table 4.1), on simulated robots.

With 33 positions the self-calibration sees the target's own points without their model; with 4 far and 9 near positions
the same way is driven once more before an unknown scene. Further: the bias of a classic method where the scale is
unknown, scale and translation from 30 motions, and pure rotations of the robot.
"""

from collections.abc import Mapping
from typing import Any

import polars

from jaxmodel.calibrate.errors import quaternion_error
from jaxmodel.io.results import RunDir
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.methods import PUBLISHED, SENTENCE
from jaxmodel.run.hand_eye.protocol import shown, spread
from jaxmodel.run.hand_eye.report import draw_hand_eye
from jaxmodel.run.hand_eye.self_draws import (
    COMPARED,
    FAR,
    OWN,
    RUNS,
    SELF,
    Config,
    bias,
    protocol,
    pure_rotations,
    scale_error,
)
from jaxmodel.run.hand_eye.self_tables import charts, tables
from jaxmodel.run.hand_eye.study import Cell, HandEyeStudy
from jaxmodel.run.published import published_table

__all__ = ["Config", "draw", "prepare", "tables"]


def prepare(config: Config) -> HandEyeStudy:
    """Cells of unlike columns, each a question: the protocol, the bias, the scale, the pure rotations."""
    cells = [Cell({"question": "protocol"}, config.draws, lambda first, n: protocol(config, first, n))]
    for scale in config.scales:
        label = {"question": f"bias {scale:g}"}
        cells.append(Cell(label, config.draws, lambda first, n, s=scale: bias(config, s, first, n)))
    for number, angles in enumerate(config.angles_deg):
        label = {"question": f"scale {number}"}
        cells.append(
            Cell(label, config.draws, lambda first, n, a=angles, k=number: scale_error(config, a, k, first, n))
        )
    for noise in (0.0, config.noise):
        label = {"question": f"pure {noise:g}"}
        cells.append(Cell(label, config.pure, lambda first, n, x=noise: pure_rotations(config, x, first, n)))
    return HandEyeStudy("hand_eye_self_calibration", config, cells, _summarise)


def _claims() -> list[claims.Claim]:
    said = published_table("hand_eye")["claims"]
    both = (claims.ROTATION, claims.TRANSLATION)
    found = [
        claims.Claim(said["self" if run == FAR else "scene"], quantity, f"{run}, linear", f"{run}, {SELF}")
        for run in RUNS
        for quantity in both
    ]
    found += [
        claims.Claim(said["self"], quantity, f"{run}, linear", f"{run}, {OWN}")
        for run in RUNS
        if run != FAR
        for quantity in both
    ]
    for run in RUNS:
        for other in PUBLISHED[:3]:
            names = f"{run}, linear", f"{run}, {other}"
            if run != FAR:  # of the first trajectory hand_eye_trajectories says it
                found += [claims.Claim(said["efficient"], of, *names, margin=claims.NO_WORSE) for of in both]
                found.append(claims.Claim(said["rotation"], claims.ROTATION, *names))
    return found


def _statements(summary: Mapping[str, Any]) -> list[dict[str, str]]:
    """What chapter 4 says that is no ratio of two errors."""
    data = published_table("hand_eye")
    said, number = data["claims"], data["self_calibration_33"]
    (own,) = [of for of in summary["runs"] if (of["run"], of["method"]) == (FAR, SELF)]
    inside = [own[what]["low"] <= number[what] <= own[what]["high"] for what in ("rotation", "translation")]
    wrong = [of for of in summary["bias"] if of["scale"] != 1]
    found = [
        claims.Statement(
            f"{said['own']}: {number['rotation']:g} in rotation, {100 * number['translation']:g} % in translation",
            f"{shown(own['rotation'])}, {shown(own['translation'])} (median and 90 % of the robots)",
            all(inside),
        ),
        claims.Statement(
            said["bias"],
            ", ".join(f"scale {of['scale']:g}: {of['bias']['value']:.2g} |t|" for of in wrong)
            + f"; at most {max(of['unpredicted']['high'] for of in summary['bias']):.0e} not predicted by §4.1",
            all(of["bias"]["low"] > 1e-6 > of["unpredicted"]["high"] for of in wrong),
        ),
        claims.Statement(
            said["tied"],
            ", ".join(f"noise {of['noise']:g}: named in {of['tied']} of {of['sets']} sets" for of in summary["pure"]),
            all(of["tied"] == of["sets"] for of in summary["pure"]),
        ),
        claims.Statement(
            said["rotations"],
            ", ".join(f"noise {of['noise']:g}: {of['solved with the target']} of {of['sets']} sets solved"
                      for of in summary["pure"]),
            all(of["solved with the target"] == of["sets"] for of in summary["pure"]),
        ),
    ]  # fmt: skip
    return [one.row for one in found]


def _summarise(config: Config, rows: polars.DataFrame, seconds: list[dict[str, Any]]) -> dict[str, Any]:
    def of(question: str) -> polars.DataFrame:
        return rows.filter(polars.col("question") == question)

    def spreads(question: str) -> dict[str, Any]:
        part = of(question).drop("question", "draw")
        return {name: spread(part[name].to_numpy()) for name in part.columns if part[name].null_count() == 0}

    drawn = of("protocol")

    def errors(name: str) -> dict[str, Any]:
        angle = drawn[claims.column(name, claims.ROTATION)].to_numpy()
        shift = drawn[claims.column(name, claims.TRANSLATION)].to_numpy()
        return {"rotation": spread(quaternion_error(angle)), "angle_deg": spread(angle), "translation": spread(shift)}

    chosen = (
        f"{config.bench.sentence}; 9 positions {config.near_deg:g}° apart; unknown scene of {config.scene} points, "
        f"{config.scene_size:g} m of standard deviation in each coordinate (the target: 0.06 m in two); "
        f"the scale's {config.motions} motions at the report's noise {config.noise:g}; {SENTENCE}"
    )
    summary = {
        "chosen": chosen,
        "reference": errors("reference, truth"),
        "runs": [{"run": r, "method": m, **errors(f"{r}, {m}")} for r in RUNS for m in COMPARED[r]],
        "bias": [{"scale": scale, **spreads(f"bias {scale:g}")} for scale in config.scales],
        "scales": [{"angles_deg": a, **spreads(f"scale {k}")} for k, a in enumerate(config.angles_deg)],
        "pure": [
            {"noise": noise, "sets": config.pure,
             **{name: int(of(f"pure {noise:g}")[name].sum()) for name in ("tied", "solved with the target")}}
            for noise in (0.0, config.noise)
        ],
        "claims": [claims.tested(claim, [drawn], config.resamples, config.seed) for claim in _claims()],
    }  # fmt: skip
    return {**summary, "statements": _statements(summary)}


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Figures and report from the folder alone."""
    return draw_hand_eye(folder, summary, "Hand-eye self-calibration (RR-3507 ch. 4)", tables, charts)
