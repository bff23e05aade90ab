"""The experiment ``next_view_arm``: an object modelled with the sensor on an arm (thesis §4.5, Figs 4.12, 4.13).

Every view is one that the arm reaches within its joint limits, checked without the solvers. ``jaxmodel plan MESH --arm
gt6a_like`` is this experiment on one mesh.
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.plan.explore import Ending, Loop
from jaxmodel.plan.next_view import Search, ViewOutcome
from jaxmodel.plan.reach_map import reach_map
from jaxmodel.run.console import Progress
from jaxmodel.run.planning.arm_pictures import keep_arm_run
from jaxmodel.run.planning.arm_reach import reach_along_circles, reach_by_place, reach_by_radius
from jaxmodel.run.planning.arm_report import draw, tables
from jaxmodel.run.planning.arm_run import BASES, ArmStep, Bases, arm_run
from jaxmodel.run.planning.arm_scene import ArmOptions, ArmScene, arm_scene
from jaxmodel.run.planning.object_scene import SceneOptions
from jaxmodel.run.planning.objects import object_files
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared

__all__ = ["ArmStudy", "Config", "draw", "prepare", "tables"]

NOWHERE = "the arm reaches no view of the sphere from any place of its base that may be taken"


@dataclass(frozen=True)
class ReachOptions:
    """How finely the reach is looked at: ``views`` of a sphere, ``places`` of the object along an edge (0: none),
    ``elevations`` of circles with ``circle_views`` each.
    """

    views: int = 500
    places: int = 9
    elevations: tuple[float, ...] = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)
    circle_views: int = 180

    def __post_init__(self) -> None:
        for key, least in (("views", 10), ("places", 0), ("circle_views", 3)):
            if getattr(self, key) < least:
                raise ValueError(f"{key} is {getattr(self, key)}, expected {least} or more")
        if not all(-90 < elevation < 90 for elevation in self.elevations):
            raise ValueError(f"elevations is {self.elevations}, expected degrees between -90 and 90")


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``object``: a built-in one, or the file of a mesh. ``bases``: free (any view of the sphere, no arm), fixed (the base
    stays), moving (it goes where most of the rest is reached). ``loop.worth``: part of a view's rays that must meet
    something new for the base to stay. ``noise`` in the object's longest side.
    """

    experiment: Literal["next_view_arm"] = "next_view_arm"
    seed: int = 0
    object: str = "valve"
    bases: tuple[Bases, ...] = BASES
    noise: float = 0.0
    arm: ArmOptions = field(default_factory=ArmOptions)
    scene: SceneOptions = field(default_factory=lambda: SceneOptions(lowest_deg=0.0))
    reach: ReachOptions = field(default_factory=ReachOptions)
    loop: Loop = field(default_factory=Loop)
    search: Search = field(default_factory=Search)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if not self.bases:
            raise ValueError("bases must name at least one")
        if not 0 <= self.noise < 0.1:
            raise ValueError(f"noise is {self.noise}, expected 0 or more and less than 0.1 of the object's size")


class ArmStudy(Prepared):
    """All runs; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.scene = arm_scene(config.object, config.arm, config.scene)
        self.inputs = hash_files([*object_files([config.object]), *self.scene.files])
        self.resolved = unstructure(config)
        self.bytes_needed = 30_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Make the runs that are not yet made, look at the reach, write tables, pictures and ``summary.json``."""
        begun, config, scene = time.perf_counter(), self.config, self.scene
        progress.begin("views", len(config.bases) * config.loop.views)
        parts = []
        for number, bases in enumerate(config.bases):
            key = f"bases{number:03d}"
            made = folder.read_parts(key)
            if 0 not in made:
                progress.describe(f"{scene.object.name}, base {bases}")
                made[0] = self._run(folder, progress, bases, number)
                folder.write_part(key, 0, made[0])
            progress.advance(config.loop.views - len(made[0]))
            parts.append(made[0])
        table = polars.concat(parts, how="vertical")
        folder.write_table("results.parquet", table.drop("seconds"))  # times are no result: same seed, same bytes
        progress.describe("reach")
        folder.write_table("reach_by_radius.parquet", reach_by_radius(scene, config.reach.views))
        best = None
        if config.reach.places:
            by_place = reach_by_place(scene, config.reach.views, config.reach.places)
            folder.write_table("reach_by_place.parquet", by_place)
            best = max(by_place.fill_nan(-1.0).iter_rows(named=True), key=lambda row: row["share"])
        circles, joints = reach_along_circles(scene, config.reach.elevations, config.reach.circle_views)
        folder.write_table("circles.parquet", joints)
        self._keep_reach(folder)
        summary: dict[str, Any] = {
            "experiment": "next_view_arm",
            "object": scene.object.name,
            "arm": config.arm.arm,
            "views": config.loop.views,
            "circles": circles,
            "best_place": best,
            "runs": [_summarised(table.filter(polars.col("bases") == bases), bases) for bases in config.bases],
        }
        if len(config.bases) == 1:
            _write_poses(folder, table)
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _run(self, folder: RunDir, progress: Progress, bases: Bases, number: int) -> polars.DataFrame:
        config, rows, steps, last = self.config, [], [], time.perf_counter()
        for one in arm_run(self.scene, bases, config.loop, config.search, config.noise, config.seed):
            now = time.perf_counter()
            rows.append({"bases": bases, **_row(one, self.scene), "seconds": now - last})
            steps.append(one)
            last = now
            progress.advance(1)
        if steps:
            keep_arm_run(folder, f"bases{number:03d}", self.scene, steps)
        return polars.DataFrame(rows, schema=_schema(self.scene.arm.count))

    def _keep_reach(self, folder: RunDir) -> None:
        """Each view of the sphere: whether it is reached from the first place, and how nimbly."""
        sphere = self.scene.object.sphere
        found = reach_map(self.scene.arm, sphere, 4 * self.config.reach.views, self.scene.method)
        x, y, z = ((found.T_world_sensor[:, :3, 3] - sphere.origin) / sphere.radius).T
        table = polars.DataFrame(
            {
                "azimuth_deg": np.rad2deg(np.arctan2(y, x)),
                "elevation_deg": np.rad2deg(np.arcsin(np.clip(z, -1, 1))),
                "dexterity": np.asarray(found.placements.dexterity),
                "outcome": [found.placements.outcome_of(k).name.lower() for k in range(len(x))],
            }
        )
        folder.write_table("reach.parquet", table)


def prepare(config: Config) -> ArmStudy:
    """Read and check everything ``config`` names."""
    return ArmStudy(config)


def _row(one: ArmStep, scene: ArmScene) -> dict[str, Any]:
    step, view, nan = one.step, one.step.planned, float("nan")
    base, check, views = one.arm.T_world_base, one.check, one.views
    joints = np.full(scene.arm.count, nan) if views is None else np.asarray(views.placements.joints[0])
    return {
        "view": step.number,
        "coverage": one.coverage,
        "gain": step.gain,
        "novelty": nan if view is None else view.novelty,
        "overlap": nan if view is None else view.overlap,
        "outcome": ViewOutcome.FOUND.name.lower() if view is None else view.outcome.name.lower(),
        "station": one.station,
        "base_x": float(base[0, 3]),
        "base_y": float(base[1, 3]),
        "base_yaw_deg": float(np.rad2deg(np.arctan2(base[1, 0], base[0, 0]))),
        "position_error": nan if check is None else float(check.position_error[0]),
        "rotation_error": nan if check is None else float(check.rotation_error[0]),
        "within_limits": check is None or bool(check.within_limits[0]),
        "limit_margin": nan if views is None else float(views.placements.limit_margin[0]),
        "dexterity": nan if views is None else float(views.placements.dexterity[0]),
        "ending": step.ending.name.lower(),
        **{f"q{k + 1}": float(value) for k, value in enumerate(joints)},
        **{f"T_{i}{j}": float(step.T_world_sensor[i, j]) for i in range(3) for j in range(4)},
    }


def _schema(joints: int) -> dict[str, Any]:
    """Columns of the table, also where a run has no view."""
    numbers = ["coverage", "gain", "novelty", "overlap"]
    arm = ["base_x", "base_y", "base_yaw_deg", "position_error", "rotation_error"]
    ends = ["limit_margin", "dexterity"]
    poses = [*(f"q{k + 1}" for k in range(joints)), *(f"T_{i}{j}" for i in range(3) for j in range(4)), "seconds"]
    real = lambda names: dict.fromkeys(names, polars.Float64)  # noqa: E731
    return {"bases": polars.String, "view": polars.Int64, **real(numbers), "outcome": polars.String,
            "station": polars.Int64, **real(arm), "within_limits": polars.Boolean, **real(ends),
            "ending": polars.String, **real(poses)}  # fmt: skip


def _summarised(rows: polars.DataFrame, bases: str) -> dict[str, Any]:
    """A run in numbers: the curve, the places of the base, and the worst of the independent check."""
    if len(rows) == 0:
        return {"bases": bases, "views": 0, "coverage": [], "stations": [], "ending": NOWHERE, "checked": 0,
                "position_error": None, "rotation_error": None, "within_limits": 0}  # fmt: skip
    checked = rows.filter(polars.col("position_error").is_finite())
    places = rows.unique("station", keep="first", maintain_order=True)
    return {
        "bases": bases,
        "views": len(rows),
        "coverage": rows["coverage"].to_list(),
        "stations": [list(of) for of in places.select("view", "base_x", "base_y", "base_yaw_deg").iter_rows()],
        "ending": Ending[rows["ending"][-1].upper()].value,
        "checked": len(checked),
        "position_error": _largest(checked["position_error"]),
        "rotation_error": _largest(checked["rotation_error"]),
        "within_limits": int(checked["within_limits"].sum()),
    }


def _largest(values: Iterable[Any]) -> float | None:
    found = list(values)
    return float(max(found)) if found else None


def _write_poses(folder: RunDir, table: polars.DataFrame) -> None:
    """Poses, joints and bases of a single run, view by view, for the robot."""
    names = [f"T_{i}{j}" for i in range(3) for j in range(4)]
    joints = [name for name in table.columns if name[0] == "q"]
    views = {}
    for row in table.iter_rows(named=True):
        views[f"view{row['view']:03d}"] = {
            "T_world_sensor": [*np.reshape([row[name] for name in names], (3, 4)).tolist(), [0.0, 0.0, 0.0, 1.0]],
            "joints": [row[name] for name in joints] if np.isfinite(row[joints[0]]) else None,
            "base_x_y_yaw_deg": [row["base_x"], row["base_y"], row["base_yaw_deg"]],
        }
    folder.write_json("poses.json", views)
