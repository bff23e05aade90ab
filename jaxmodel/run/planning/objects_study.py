"""The experiment ``next_view_objects``: whole objects seen view by view, by several planners (thesis §4.5).

Each run scans an object from a first view, updates the label map, plans the next view, and so on; the share of the
reachable surface seen after each view is what planners are compared by. ``jaxmodel plan MESH`` is this experiment on
one mesh.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.plan.explore import Ending, Loop
from jaxmodel.plan.next_view import Search
from jaxmodel.run.console import Progress
from jaxmodel.run.planning.object_run import FREE, PLANNERS, Case, object_run, row_of
from jaxmodel.run.planning.object_scene import ObjectScene, SceneOptions, object_scene
from jaxmodel.run.planning.objects import PLANNING_OBJECTS, is_watertight, load_object, object_files
from jaxmodel.run.planning.objects_report import draw, tables
from jaxmodel.run.planning.pictures import keep_run
from jaxmodel.run.planning.summary import summarised
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared

__all__ = ["Config", "ObjectsStudy", "draw", "prepare", "tables"]


ENDINGS = {ending.name.lower(): ending.value for ending in Ending}


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``objects``: names of built-in ones, or files of meshes. ``planners``: utility, area_factor, uniform, random, each
    also as NAME_free, without a least overlap. ``starts``: how many first views. ``noises``: of the scanner, in the
    object's longest side. ``registered``: planners whose views are also placed by registration, from a pose off by
    ``off_deg`` and ``off_shift`` of the size, in runs of their own.
    """

    experiment: Literal["next_view_objects"] = "next_view_objects"
    seed: int = 0
    objects: tuple[str, ...] = PLANNING_OBJECTS
    planners: tuple[str, ...] = ("utility", "area_factor", "uniform", "random")
    starts: int = 1
    noises: tuple[float, ...] = (0.0,)
    registered: tuple[str, ...] = ()
    off_deg: float = 2.0
    off_shift: float = 0.01
    scene: SceneOptions = field(default_factory=SceneOptions)
    loop: Loop = field(default_factory=Loop)
    search: Search = field(default_factory=Search)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if not self.objects:
            raise ValueError("objects must name at least one")
        if not self.planners and not self.registered:
            raise ValueError("planners and registered must name at least one between them")
        known = (*PLANNERS, *(name + FREE for name in PLANNERS))
        for planner in (*self.planners, *self.registered):
            if planner not in known:
                raise ValueError(f"planners names {planner!r}, expected some of {', '.join(known)}")
        if not 1 <= self.starts <= 7:
            raise ValueError(f"starts is {self.starts}, expected 1 to 7")
        for noise in self.noises:
            if not 0 <= noise < 0.1:
                raise ValueError(f"noises names {noise}, expected 0 or more and less than 0.1 of the object's size")
        for key in ("off_deg", "off_shift"):
            if not getattr(self, key) >= 0:
                raise ValueError(f"{key} is {getattr(self, key)}, expected 0 or more")


class ObjectsStudy(Prepared):
    """All runs; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.scenes = {name: object_scene(name, load_object(name), config.scene) for name in config.objects}
        self.inputs = hash_files(object_files(config.objects))
        self.resolved = unstructure(config)
        self.bytes_needed = 50_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Make the runs that are not yet made, write the table, the pictures and ``summary.json``."""
        begun, config = time.perf_counter(), self.config
        cases = list(_cases(config))
        progress.begin("views", len(self.scenes) * len(cases) * config.loop.views)
        rows, reachable = [], {}
        for place, (name, scene) in enumerate(self.scenes.items()):
            reachable[name] = float(scene.samples.weights[scene.reachable].sum() / scene.samples.weights.sum())
            for number, case in enumerate(cases):
                key = f"object{place:03d}case{number:04d}"
                parts = folder.read_parts(key)
                if 0 not in parts:
                    parts[0] = self._run(folder, progress, place, scene, case, number == 0)
                    folder.write_part(key, 0, parts[0])
                progress.advance(config.loop.views - (len(parts[0]) if 0 in parts else 0))
                rows.append(parts[0])
        table = polars.concat(rows, how="vertical")
        folder.write_table("results.parquet", table.drop("seconds"))  # times are no result: same seed, same bytes
        summary: dict[str, Any] = {
            "experiment": "next_view_objects",
            "objects": {
                name: {
                    "watertight": is_watertight(scene.mesh),
                    "reachable": reachable[name],
                    "triangles": len(scene.mesh.faces),
                }
                for name, scene in self.scenes.items()
            },
            "views": config.loop.views,
            **summarised(table, config.loop.views),
        }
        if len(rows) == 1:
            summary |= _alone(folder, table, summary["runs"][0])
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _run(
        self, folder: RunDir, progress: Progress, place: int, scene: ObjectScene, case: Case, first: bool
    ) -> polars.DataFrame:
        progress.describe(f"{scene.name}, {case.planner}")
        rows, steps, last = [], [], time.perf_counter()
        for seen in object_run(scene, case, self.config.loop, self.config.search):
            now = time.perf_counter()
            rows.append({"object": scene.name, **_told(case), **row_of(seen), "seconds": now - last})
            steps.append(seen.step)
            last = now
            progress.advance(1)
        if first:
            keep_run(folder, f"object{place:03d}", scene, steps)
        return polars.DataFrame(rows)


def prepare(config: Config) -> ObjectsStudy:
    """Read and check everything ``config`` names."""
    return ObjectsStudy(config)


def _cases(config: Config) -> Iterator[Case]:
    for registered, planners in ((False, config.planners), (True, config.registered)):
        for planner in planners:
            for noise in config.noises:
                for start in range(config.starts):
                    yield Case(planner, start, noise, registered, config.off_deg, config.off_shift, config.seed)


def _alone(folder: RunDir, table: polars.DataFrame, run: dict[str, Any]) -> dict[str, Any]:
    """What a single run is asked for: its curve and how it ended in the summary, its poses in a file."""
    names = [f"T_{i}{j}" for i in range(3) for j in range(4)]
    poses = [[*np.reshape(row, (3, 4)).tolist(), [0.0, 0.0, 0.0, 1.0]] for row in table.select(names).iter_rows()]
    folder.write_json("poses.json", {f"view{number:03d}": T for number, T in enumerate(poses)})
    return {"coverage": run["coverage"], "ending": ENDINGS[run["ending"]], "placed": table["placed"].to_list()}


def _told(case: Case) -> dict[str, Any]:
    return {key: getattr(case, key) for key in ("planner", "start", "noise", "registered")}
