"""The figures of a hand-eye calibration: residuals and influence of each pose, motions, and how methods disagree."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Shaped
from matplotlib.figure import Figure

from jaxmodel.view.charts import Chart, Panel, Series
from jaxmodel.view.figures import png_bytes


def residual_chart(
    method: str,
    pose: Shaped[np.ndarray, " n"],
    rotation_deg: Float[np.ndarray, " n"],
    translation_mm: Float[np.ndarray, " n"],
    outlier: Bool[np.ndarray, " n"],
) -> Chart:
    """How far each pose is from the one that the answer predicts; named outliers in a colour of their own."""
    panels = []
    for values, what, unit in ((rotation_deg, "rotation", "degree"), (translation_mm, "translation", "mm")):
        series = [Series("agrees", pose[~outlier].tolist(), values[~outlier].tolist(), style="marks")]
        if outlier.any():
            series.append(Series("outlier", pose[outlier].tolist(), values[outlier].tolist(), style="marks"))
        panels.append(Panel(f"{what} of each pose, {method}", "pose", f"{what} residual ({unit})", series))
    return Chart("residuals", "Residuals of each pose", panels)


def motion_chart(
    method: str,
    angle_deg: Float[np.ndarray, " m"],
    rotation_deg: Float[np.ndarray, " m"],
    translation_mm: Float[np.ndarray, " m"],
) -> Chart:
    """Residuals of A X - X B of each pair of poses against the angle between them."""
    panels = [
        Panel(f"{what} of each motion, {method}", "angle of the motion (degree)", f"{what} residual ({unit})",
              [Series("motions", angle_deg.tolist(), values.tolist(), style="marks")])
        for values, what, unit in ((rotation_deg, "rotation", "degree"), (translation_mm, "translation", "mm"))
    ]  # fmt: skip
    return Chart("motions", "Residuals of each pair of poses", panels)


def influence_chart(
    pose: Shaped[np.ndarray, " n"], angle_deg: Float[np.ndarray, " n"], distance_mm: Float[np.ndarray, " n"]
) -> Chart:
    """How far the answer moves when a pose is left out."""
    panels = [
        Panel(f"{what} without the pose", "pose left out", f"change of the {what} ({unit})",
              [Series("change", pose.tolist(), values.tolist(), style="marks")])
        for values, what, unit in ((angle_deg, "rotation", "degree"), (distance_mm, "translation", "mm"))
    ]  # fmt: skip
    return Chart("influence", "What each pose does to the answer", panels)


def disagreement_png(
    methods: Sequence[str], angle_deg: Float[np.ndarray, "k k"], distance_mm: Float[np.ndarray, "k k"]
) -> bytes:
    """Every two methods' difference in rotation and in translation, as numbers on their shade."""
    k = len(methods)
    cell = 0.62
    side = max(cell * k, 2.4)
    figure = Figure(figsize=(2 * side + 3.6, side + 2.2))
    width, height = figure.get_size_inches()
    for number, (values, what) in enumerate(((angle_deg, "rotation (degree)"), (distance_mm, "translation (mm)"))):
        left = 1.75 + number * (side + 0.45)
        axes: Any = figure.add_axes((left / width, 1.5 / height, side / width, side / height))
        most = float(np.nanmax(values, initial=0.0))
        axes.imshow(values, cmap="Blues", vmin=0, vmax=1.6 * most or 1.0)
        for i in range(k):
            for j in range(k):
                if i != j:
                    axes.text(j, i, f"{values[i, j]:.3g}" if most > 0 else "0", ha="center", va="center", fontsize=7.5)
        axes.set_xticks(range(k), methods, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
        axes.set_yticks(range(k), methods if number == 0 else [""] * k, fontsize=8)
        axes.set_title(f"difference of {what}", fontsize=10)
    return png_bytes(figure)
