"""The experiment ``next_view_environment``: a cube from one point, two rooms explored (Figs 4.5-4.8, 4.10, 4.11).

The sensor starts knowing nothing. In the cube it pans and tilts, in the rooms it moves with five degrees of freedom
through what it has found empty, first with coarse voxels, then with finer ones.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.plan.coverage import CoverageCurve, visible
from jaxmodel.plan.explore import Chooser, Ending, Loop, Step, by_utility, explore, label_shares
from jaxmodel.plan.hill_climbing import hill_climbing
from jaxmodel.plan.map_update import update
from jaxmodel.plan.next_view import Search, ViewOutcome, utility_field
from jaxmodel.plan.utility import Utility
from jaxmodel.run.console import Progress
from jaxmodel.run.planning.environment_pictures import keep_environment
from jaxmodel.run.planning.environment_report import draw, tables
from jaxmodel.run.planning.environment_scene import EnvironmentScene, PlaceOptions, environment_scene
from jaxmodel.run.registry import Prepared
from jaxmodel.scan.rooms import TwoRooms

__all__ = ["Config", "EnvironmentStudy", "draw", "prepare", "tables"]


EARLY, FIELD_VIEWS = 6, 4000
"""Views after which the field of utility is drawn, and how finely."""
INDOORS = Utility(promise=1.0, room=1.0)
"""From within, most of what is unseen lies behind what is near: rays that end close by are to count for little."""
COMPLETE = [ending.name.lower() for ending in (Ending.NOTHING_NEW, Ending.LITTLE_NEW, Ending.LITTLE_GAIN)]
"""Endings of an exploration that left nothing worth a view."""


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``environment``: the cube of Fig. 4.5 or the two rooms of Fig. 4.10. ``planners``: utility, and hill_climbing, the
    earlier method. ``voxels``: their edge pass by pass, in the environment's unit (the cube's edge is 1, the rooms are
    in metres).
    """

    experiment: Literal["next_view_environment"] = "next_view_environment"
    seed: int = 0
    environment: Literal["cube", "two_rooms"] = "two_rooms"
    planners: tuple[Literal["utility", "hill_climbing"], ...] = ("utility",)
    voxels: tuple[float, ...] = (0.2, 0.1)
    place: PlaceOptions = field(default_factory=PlaceOptions)
    loop: Loop = field(default_factory=Loop)
    search: Search = field(default_factory=Search)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if not self.planners:
            raise ValueError("planners must name at least one")
        largest = 0.25 if self.environment == "cube" else 1.0
        if not self.voxels or not all(0 < voxel <= largest for voxel in self.voxels):
            raise ValueError(f"voxels is {self.voxels}, expected lengths above 0 and at most {largest}")


class Seen(NamedTuple):
    """A step, the pass it belongs to, and the share of the reachable surface seen so far."""

    number: int
    step: Step
    coverage: float


class EnvironmentStudy(Prepared):
    """All runs; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.scene = environment_scene(config.environment, config.place)
        self.inputs: dict[str, str] = {}
        self.resolved = unstructure(config)
        self.bytes_needed = 50_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Make the runs that are not yet made, write the table, the pictures and ``summary.json``."""
        begun, config = time.perf_counter(), self.config
        scene = self.scene
        progress.begin("views", len(config.planners) * len(config.voxels) * config.loop.views)
        parts, fields = [], []
        for number, planner in enumerate(config.planners):
            key = f"planner{number:03d}"
            made = folder.read_parts(key)
            if 0 not in made:
                progress.describe(planner)
                made[0], made[1] = self._run(folder, progress, scene, planner, number)
                folder.write_part(key, 1, made[1])
                folder.write_part(key, 0, made[0])
            parts.append(made[0])
            fields.append(made[1] if number == 0 else made[1].head(0))
        table = polars.concat(parts, how="vertical")
        folder.write_table("field.parquet", polars.concat(fields, how="vertical"))
        folder.write_table("results.parquet", table.drop("seconds"))  # times are no result: same seed, same bytes
        summary: dict[str, Any] = {
            "experiment": "next_view_environment",
            "environment": config.environment,
            "voxels": list(config.voxels),
            "reachable": float(scene.samples.weights[scene.reachable].sum() / scene.samples.weights.sum()),
            "runs": [_summarised(table.filter(polars.col("planner") == planner)) for planner in config.planners],
        }
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _run(
        self, folder: RunDir, progress: Progress, scene: EnvironmentScene, planner: str, number: int
    ) -> tuple[polars.DataFrame, polars.DataFrame]:
        rows, steps, last = [], [], time.perf_counter()
        for seen in environment_run(scene, planner, self.config):
            now = time.perf_counter()
            rows.append({"planner": planner, **_row(seen, scene, now - last)})
            steps.append(seen.step)
            last = now
            progress.advance(1)
        keep_environment(folder, f"planner{number:03d}", scene, steps)
        return polars.DataFrame(rows), _fields(scene, steps, self.config.search)


def prepare(config: Config) -> EnvironmentStudy:
    """Check everything ``config`` names."""
    return EnvironmentStudy(config)


def environment_run(scene: EnvironmentScene, planner: str, config: Config) -> Iterator[Seen]:
    """The steps of one exploration, pass by pass; a finer pass begins with all that was scanned before."""
    keys = jax.random.split(jax.random.key(config.seed), len(config.voxels) * config.loop.views)
    choose = _chooser(planner, scene)
    curve = CoverageCurve.start(scene.reachable, scene.samples.weights)
    taken: list[Step] = []
    T = scene.environment.T_world_start
    for number, voxel in enumerate(config.voxels):
        map = scene.map(voxel)
        for step in taken:
            map = update(map, step.image, step.T_world_sensor, scene.sensor)
        if taken:
            view = choose(map, scene.views_at(map, T), config.search, [step.T_world_sensor for step in taken])
            if view.outcome is not ViewOutcome.FOUND:
                continue
            T = view.T_world_sensor
        begun = len(taken)
        scan = lambda T, k, begun=begun: scene.scan(T, keys[begun + k])  # noqa: E731
        for step in explore(scan, map, scene.sensor, scene.views_at, T, config.loop, config.search, choose):
            pose = step.T_world_sensor[None]
            curve = curve.after(visible(scene.samples, scene.environment.mesh, pose, scene.sensor)[0])
            taken.append(step)
            T = step.T_world_sensor
            yield Seen(number, step, curve.shares[-1])


def _fields(scene: EnvironmentScene, steps: list[Step], search: Search) -> polars.DataFrame:
    """Where the sensor only turns: the utility of every pan and tilt after each of the first views (Fig. 4.7)."""
    rows = [_field(scene, step, search) for step in steps[:EARLY]] if scene.name == "cube" else []
    numbers = {"azimuth_deg": polars.Float64, "elevation_deg": polars.Float64, "utility": polars.Float32}
    return polars.concat([polars.DataFrame(schema={"view": polars.Int32, **numbers}), *rows], how="vertical")


def _field(scene: EnvironmentScene, step: Step, search: Search) -> polars.DataFrame:
    space = scene.views_at(step.map, step.T_world_sensor)
    found = utility_field(step.map, scene.sensor, space, INDOORS, FIELD_VIEWS, search.rays, search.seed)
    able = found.overlap >= search.minimum_overlap
    weights = INDOORS.attainable(found.seen.shares[able] if able.any() else found.seen.shares)
    utility = np.asarray(weights(found.seen.shares, found.seen.quality, found.seen.promising))
    x, y, z = found.poses[:, :3, 2].T
    return polars.DataFrame(
        {
            "view": np.full(len(x), step.number, np.int32),
            "azimuth_deg": np.rad2deg(np.arctan2(y, x)),
            "elevation_deg": np.rad2deg(np.arcsin(np.clip(z, -1, 1))),
            "utility": np.where(able, utility, np.nan).astype(np.float32),
        }
    )


def _chooser(planner: str, scene: EnvironmentScene) -> Chooser:
    if planner == "utility":
        return by_utility(scene.sensor, INDOORS)
    return lambda map, space, search, taken: hill_climbing(map, scene.sensor, space, taken[-1], search, INDOORS)


def _row(seen: Seen, scene: EnvironmentScene, seconds: float) -> dict[str, Any]:
    step, view, nan = seen.step, seen.step.planned, float("nan")
    return {
        "pass": seen.number,
        "view": step.number,
        "coverage": seen.coverage,
        "gain": step.gain,
        "utility": nan if view is None else view.utility,
        "novelty": nan if view is None else view.novelty,
        "overlap": nan if view is None else view.overlap,
        "back": step.back,
        "room": _room(scene, step.T_world_sensor),
        "ending": step.ending.name.lower(),
        **label_shares(step.map),
        **{f"T_{i}{j}": float(step.T_world_sensor[i, j]) for i in range(3) for j in range(4)},
        "seconds": seconds,
    }


def _room(scene: EnvironmentScene, T: np.ndarray) -> str:
    if scene.name == "cube":
        return "cube"
    _, left, right, _ = TwoRooms().ends
    return "left" if T[0, 3] < left else "right" if T[0, 3] > right else "passage"


def _summarised(table: polars.DataFrame) -> dict[str, Any]:
    """A run in numbers: how often it changed rooms, how far the sensor went."""
    places = table.select([f"T_{i}3" for i in range(3)]).to_numpy()
    rooms = [room for room in table["room"].to_list() if room != "passage"]
    return {
        "planner": table["planner"][0],
        "coverage": table["coverage"].to_list(),
        "views": len(table),
        "views_by_pass": table.group_by("pass", maintain_order=True).len()["len"].to_list(),
        "ending": table["ending"][-1],
        "complete": table["ending"][-1] in COMPLETE,
        "changes": sum(one != other for one, other in pairwise(rooms)),
        "way": float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()),
        "back": int((table["back"] > 0).sum()),
        "unknown": float(table["unknown"][-1]),
        "utility": table["utility"].to_list(),
        "seconds_a_view": float(np.median(table["seconds"].to_numpy())),
    }
