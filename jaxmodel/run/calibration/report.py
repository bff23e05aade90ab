"""Of a finished calibration: its tables, and from its folder alone ``figures/*.png`` and ``report.html``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.run.provenance import facts
from jaxmodel.run.study_report import read_table
from jaxmodel.view.table import Table

_SHOWN = 8


def tables(summary: Mapping[str, Any]) -> list[Table]:
    """All methods side by side, what the motions determine, the recommended answer, and the poses to look at."""
    found = [_methods(summary), _verdict(summary), _recommended(summary)]
    if summary["outliers"]:
        rows = [
            (one["place"], f"{one['score']:.0f}", f"{one['rotation_residual_deg']:.2f}",
             f"{1e3 * one['translation_residual_m']:.1f}")
            for one in summary["outliers"]
        ]  # fmt: skip
        columns = ("pose", "score (22 is the limit)", "rotation off (deg)", "translation off (mm)")
        found.append(Table("Poses that contradict the others", columns, rows))
    if summary["influence"]:
        rows = [
            (one["place"], f"{one['angle_deg']:.3f}", f"{1e3 * one['distance_m']:.2f}",
             "" if one["influence"] is None else f"{one['influence']:.2f}")
            for one in summary["influence"][:_SHOWN]
        ]  # fmt: skip
        columns = ("pose", "rotation changes (deg)", "translation changes (mm)", "in standard deviations")
        found.append(Table("Poses that matter most: the answer without each", columns, rows))
    if summary["notes"]:
        found.append(Table("Notes", ("note",), [(note,) for note in summary["notes"]]))
    return found


def _methods(summary: Mapping[str, Any]) -> Table:
    name, scaled = summary["transform"], summary["scales"] == "one"
    rows = []
    for one in summary["methods"]:
        pairs, away = one["pairs"], one["from_recommended"]
        rows.append(
            (
                one["method"],
                _numbers(one["translation"], "{:.4f}"),
                _numbers(np.degrees(np.array(one["rotation_vector"], float)), "{:.1f}"),
                *([_scale(one["scale"][0])] if scaled else []),
                f"{pairs['median_rotation_deg']:.3f} deg, {1e3 * pairs['median_translation_m']:.2f} mm",
                f"{away['angle_deg']:.2f} deg, {1e3 * away['distance_m']:.1f} mm",
                one["outcome"].replace("_", " "),
            )
        )
    columns = ("method", f"{name} (m)", "turn vector (deg)", *(["scale"] if scaled else []), "left over",
               "off the recommended", "outcome")  # fmt: skip
    counted = f"{summary['poses']} poses, {summary['motions']} motions; left over: medians of A X - X B"
    return Table(f"Methods side by side ({counted})", columns, rows)


def _verdict(summary: Mapping[str, Any]) -> Table:
    seen, excited = summary["observability"], summary["excitation"]
    frame = frame_of(summary)
    rows = [("set-up", summary["setup_sentence"]), ("verdict", seen["sentence"])]
    for key, words in (("free_direction", "translation free along"), ("free_axis", "rotation free about")):
        if seen.get(key) is not None:
            rows.append((words, f"{_numbers(seen[key], '{:.4f}')} in {frame}"))
    if seen.get("alternatives"):
        others = [_numbers(np.array(other)[:3, 3], "{:.4f}") for other in seen["alternatives"]]
        rows.append(("other answers", f"{len(others)} fit as well, with the translations {'; '.join(others)} (m)"))
    low, middle, high = excited["angle_deg"]
    rows.append(("rotations", f"{low:.1f} to {high:.1f} degrees, median {middle:.1f}"))
    spread = excited["axis_spread"]
    rows.append(("spread of the axes", f"{spread:.2g} (0: all parallel, 1: even in all directions)"))
    if summary["synchronisation"] is not None:
        both = summary["synchronisation"]
        rows.append(
            ("time offset", f"{both['sentence']}; angles then agree within {both['angle_error_deg']:.2f} degrees")
        )
    return Table("What the motions determine", ("", ""), rows)


def _recommended(summary: Mapping[str, Any]) -> Table:
    chosen = summary["recommended"]
    rows = [("method", chosen["method"]), ("reason", chosen["reason"])]
    for name, forms in chosen["forms"].items():
        turn = _numbers(forms["quaternion_xyzw"], "{:.5f}")
        rows.append((name, f"x y z {_numbers(forms['translation'], '{:.5f}')} m, quaternion x y z w {turn}"))
    rows += _scale_rows(summary)
    deviation, expected = chosen["deviation"], chosen["expected_error"]
    if deviation is not None:
        wide = deviation["student_95"]
        turn, shift = np.array(deviation["rotation_deg"], float), 1e3 * np.array(deviation["translation_m"], float)
        rows.append(
            (
                "standard deviation",
                f"rotation {_numbers(turn, '{:.3f}')} deg, translation {_numbers(shift, '{:.2f}')} mm; times "
                f"{wide:.2f} for 95 % ({chosen['covariance']['freedom']:.0f} degrees of freedom)",
            )
        )
        worst = f"{1e3 * deviation['worst_m']:.2f} mm, along {_numbers(deviation['worst_direction'], '{:.2f}')}"
        rows.append(("translation known worst", f"{worst} in {frame_of(summary)}"))
        given = "as asked" if expected["given"] else "the median distance of the target"
        error = "not finite" if expected["rms_m"] is None else f"{1e3 * expected['rms_m']:.2f} mm (rms)"
        rows.append(("expected error", f"{error} of a point at {expected['working_distance_m']:.3f} m, {given}"))
    return Table("Recommended answer", ("", ""), rows)


def _scale_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    scale = summary["recommended"]["scale"]
    if summary["scales"] == "known":
        return []
    if not isinstance(scale, Mapping):
        deviation = summary["recommended"].get("scale_deviation")
        known = "" if deviation is None else f" (standard deviation {_scale(deviation)})"
        return [("scale", f"{_scale(scale)}{known} times the camera's lengths is metres")]
    shown = [f"{name}: {_scale(one['value'])}" for name, one in list(scale.items())[:_SHOWN]]
    more = f" and {len(scale) - _SHOWN} more, see calibration.json" if len(scale) > _SHOWN else ""
    return [("scales", "; ".join(shown) + more)]


def _scale(value: float | None) -> str:
    return "undetermined" if value is None else f"{value:.5g}"


def _numbers(values: Sequence[float] | np.ndarray, form: str) -> str:
    return " ".join("?" if value is None else form.format(value) for value in values)


def frame_of(summary: Mapping[str, Any]) -> str:
    """The frame that the camera's place is given in, in words."""
    return "the base's frame" if summary["transform"] == "T_base_camera" else "the hand's frame"


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    """Draw every figure and the report; the list of figures, relative to the folder."""
    method = polars.col("method") == summary["recommended"]["method"]
    poses = read_table(folder.path / "results.parquet").filter(method)
    motions = read_table(folder.path / "motions.parquet").filter(method)
    manifest = folder.read_json("manifest.json")
    from jaxmodel.view.axis_sphere import AxisSphere, sphere_png
    from jaxmodel.view.chart_drawing import chart_png
    from jaxmodel.view.charts import Picture
    from jaxmodel.view.report import render_report

    charts = _charts(summary["recommended"]["method"], poses, motions)
    pictures = {chart.name: chart_png(chart) for chart in charts}
    apart = summary["disagreement"]
    from jaxmodel.view.hand_eye_figures import disagreement_png

    between = []
    if len(apart["methods"]) > 1:
        pictures["disagreement"] = disagreement_png(
            apart["methods"], np.array(apart["angle_deg"], float), 1e3 * np.array(apart["distance_m"], float)
        )
        between = [Picture("How far the methods disagree", pictures["disagreement"])]
    free = summary["observability"].get("free_direction") or summary["observability"].get("free_axis")
    axes = np.stack([motions[f"axis_{letter}"].to_numpy() for letter in "xyz"], axis=1)
    # axes of the hand's motions in the hand's own frame, or in the base's where the camera is fixed
    sphere = AxisSphere("Rotation axes of the hand's motions", frame_of(summary), axes, motions["angle_deg"].to_numpy(),
                        None if free is None else np.array(free, float))  # fmt: skip
    pictures["axes"] = sphere_png(sphere)
    for name, picture in pictures.items():
        folder.write(f"figures/{name}.png", picture)
    sections = [*charts, *between, sphere]
    about = {**facts(manifest), "set-up": summary["setup_sentence"], "lengths": "metre"}
    page = render_report("Hand-eye calibration", about, tables(summary), sections)
    folder.write("report.html", page.encode())
    return [f"figures/{name}.png" for name in pictures]


def _charts(method: str, poses: polars.DataFrame, motions: polars.DataFrame) -> list[Any]:
    from jaxmodel.view import hand_eye_figures as figures

    drawn = []
    pose, outlier = poses["pose"].to_numpy(), poses["outlier"].to_numpy()
    if poses["rotation_residual_deg"].null_count() < len(poses):
        residuals = _floats(poses, "rotation_residual_deg"), 1e3 * _floats(poses, "translation_residual_m")
        drawn.append(figures.residual_chart(method, pose, *residuals, outlier))
    if poses["left_out_distance_m"].null_count() < len(poses):
        changes = _floats(poses, "left_out_angle_deg"), 1e3 * _floats(poses, "left_out_distance_m")
        drawn.append(figures.influence_chart(pose, *changes))
    residuals = _floats(motions, "rotation_residual_deg"), 1e3 * _floats(motions, "translation_residual_m")
    drawn.append(figures.motion_chart(method, _floats(motions, "angle_deg"), *residuals))
    return drawn


def _floats(table: polars.DataFrame, name: str) -> np.ndarray:
    return table[name].cast(polars.Float64).fill_null(float("nan")).to_numpy()
