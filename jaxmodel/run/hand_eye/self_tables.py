"""The tables and figures of ``hand_eye_self_calibration``, from a finished run's summary."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars

from jaxmodel.calibrate.errors import quaternion_error_angle_deg
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.protocol import agreement, shown
from jaxmodel.run.hand_eye.report import chosen_table, marks_panel
from jaxmodel.run.hand_eye.self_draws import COMPARED, METHODS, RUNS, SELF
from jaxmodel.run.published import published_table
from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.table import Table


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    """Table 4.1 and §4.3 as *published | ours*, the bias, the scale, the pure rotations, the claims."""
    lines = []
    for of in summary["runs"]:
        turn, shift = (_published(of["run"], of["method"], what) for what in ("rotation", "translation"))
        lines.append((f"{of['run']} (Fig. {RUNS[of['run']]})", of["method"], *agreement(turn, of["rotation"]),
                      shown(of["angle_deg"]) + "°", *agreement(shift, of["translation"])))  # fmt: skip
    columns = ("run", "method", "rotation: published", "ours", "published is", "ours, angle",
               "translation: published", "ours", "published is")  # fmt: skip
    bias = [
        (f"{of['scale']:g}", *(shown(of[k]) for k in ("bias", "unpredicted", "classic rotation (deg)",
                                                       "self translation", "scale error")))
        for of in summary["bias"]
    ]  # fmt: skip
    scales = [
        (f"{of['angles_deg'][0]:g} to {of['angles_deg'][1]:g}°", method,
         *(shown(of[f"{method} {what}"]) for what in ("scale error", "translation", "rotation (deg)")))
        for of in summary["scales"]
        for method in ("linear", "refined")
    ]  # fmt: skip
    pure = [
        (f"{of['noise']:g}", f"{of['tied']} of {of['sets']}", f"{of['solved with the target']} of {of['sets']}")
        for of in summary["pure"]
    ]
    said = published_table("hand_eye")["claims"]
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
        claims.statements_table(summary["statements"], command),
        chosen_table(summary),
    ]  # fmt: skip


def _published(run: str, method: str, what: str) -> float | None:
    """The value of Table 4.1 or of §4.3, where there is one."""
    data = published_table("hand_eye")
    if run in data["table_4_1"] and method in METHODS:
        return data["table_4_1"][run][what][METHODS.index(method)]
    return data["self_calibration_33"][what] if method == SELF else None


def charts(summary: Mapping[str, Any], rows: polars.DataFrame) -> list[Chart]:
    """Figs 4.1 and 4.4 and the bias against the scale."""
    names = ["axis / angle", "dual quat.", "nonlinear", "linear", "self", "self, target"]
    drawn = []
    for figure in dict.fromkeys(RUNS.values()):
        panels = []
        for run in (run for run in RUNS if RUNS[run] == figure):
            values = [of for of in summary["runs"] if of["run"] == run]
            for what, key, label in (
                ("rotation", "angle_deg", "error to the reference (°)"),
                ("translation", "translation", "|t - t*| / |t*| to the reference"),
            ):
                theirs = [_published(run, method, what) for method in COMPARED[run]]
                if key == "angle_deg":
                    theirs = [None if of is None else float(quaternion_error_angle_deg(np.array(of))) for of in theirs]
                title = f"Fig. {figure}, {run}: {what}"
                panels.append(marks_panel(title, label, names[: len(values)], [of[key] for of in values], theirs))
        drawn.append(Chart(f"figure-{figure}", f"Fig. {figure}: errors to the reference", panels))
    series = [
        Series(name, [of["scale"] for of in summary["bias"]], [of[key]["value"] for of in summary["bias"]])
        for name, key in (("classic linear method", "bias"), ("self-calibration", "self translation"))
    ]
    label = "metric / given length of the camera's translations"
    panel = Panel("Bias under an unknown scale (§4.1)", label, "median of |t - t*| / |t*|", series)
    return [*drawn, Chart("bias", "Bias of a classic method", [panel])]
