"""What an arm reaches around an object: by the sphere's radius, by where the object is, along circles (Fig. 4.13)."""

from typing import Any

import numpy as np
import polars

from jaxmodel.geometry import se3
from jaxmodel.plan.arm_lines import joint_lines
from jaxmodel.plan.arm_path import path_along_circle
from jaxmodel.plan.reach_map import reach_map
from jaxmodel.plan.viewpoints import Circle, ObservationSphere
from jaxmodel.run.planning.arm_scene import ArmScene

RADII = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0)
"""Of the spheres tried, in parts of the scene's own."""
CLEAR = 0.1
"""Room around the arm's own foot, in the arm's size."""
UP = np.array([0.0, 0.0, 1.0])


def reach_by_radius(scene: ArmScene, views: int) -> polars.DataFrame:
    """Share of the views of the whole sphere, and of its upper half, that the arm takes from where it stands."""
    rows = []
    for part in RADII:
        sphere = scene.object.sphere
        whole = reach_map(scene.arm, ObservationSphere(sphere.centre, part * sphere.radius, -90.0), views, scene.method)
        above = whole.T_world_sensor[:, 2, 3] >= float(sphere.origin[2])
        reached = np.asarray(whole.reached)
        rows.append({"radius": part * sphere.radius, "whole": reached.mean(), "upper": reached[above].mean()})
    return polars.DataFrame(rows)


def reach_by_place(scene: ArmScene, views: int, steps: int) -> polars.DataFrame:
    """Share of the whole sphere that is reached with the object ``ahead`` of the base and ``above`` its foot.

    NaN where the object would stand in the arm's own foot: within ``CLEAR`` of the line from there to the shoulder.
    """
    sphere, rows = scene.object.sphere, []
    size = scene.arm.size
    shoulder = max(0.0, float(joint_lines(scene.arm).points[:2, 2].max()))
    for ahead in np.linspace(0.0, size, steps):
        for above in np.linspace(-0.5 * size, 1.5 * size, steps):
            off = above - np.clip(above, 0.0, shoulder)
            share = np.nan
            if np.hypot(ahead, off) >= scene.object.size / 2 + CLEAR * size:
                middle = se3.apply(scene.arm.T_world_base, np.array([ahead, 0.0, above]))
                around = ObservationSphere(middle, sphere.radius, -90.0)
                share = reach_map(scene.arm, around, views, scene.method).share
            rows.append({"ahead": float(ahead), "above": float(above), "share": share})
    return polars.DataFrame(rows)


def reach_along_circles(scene: ArmScene, elevations: tuple[float, ...], views: int) -> tuple[Any, polars.DataFrame]:
    """Each circle of one elevation: what part is reached, in how many stretches; and the joints along all of them."""
    rows, joints = [], []
    sphere = scene.object.sphere
    for elevation in elevations:
        circle = Circle(sphere.centre, sphere.radius, UP, 90.0 - elevation)
        path = path_along_circle(scene.arm, circle, views)
        on = path.stretch[path.stretch >= 0]
        lengths = np.bincount(on) if len(on) else np.zeros(1, int)
        reasons = sorted({of.reason.name.lower().replace("_", " ") for of in path.breaks})
        rows.append(
            {
                "elevation_deg": float(elevation),
                "reached": float(np.mean(path.stretch >= 0)),
                "stretches": int(len(lengths) if len(on) else 0),
                "longest_deg": float(360.0 * max(lengths.max() - 1, 0) / views),
                "breaks": ", ".join(reasons),
            }
        )
        for view, (q, stretch) in enumerate(zip(path.joints, path.stretch, strict=True)):
            row = {"elevation_deg": float(elevation), "azimuth_deg": 360.0 * view / views, "stretch": int(stretch)}
            joints.append(row | {f"q{k + 1}": float(value) for k, value in enumerate(q)})
    return rows, polars.DataFrame(joints)
