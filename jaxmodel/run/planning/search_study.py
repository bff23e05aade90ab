"""The experiment ``next_view_search``: is the view found the best there is? (thesis §4.3.2, Figs 4.6, 4.7)

Maps are taken along modelling runs. On each, every method's view is scored again beside the best of an exhaustive field
of views it has never seen: same map, same (fine) rays, same nominal shares, same least overlap.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import polars
from jaxtyping import Float

from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.plan.explore import Ending, Loop
from jaxmodel.plan.hill_climbing import hill_climbing
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.next_view import Search, View, next_view, utility_field
from jaxmodel.plan.ray_march import ready
from jaxmodel.plan.utility import Utility
from jaxmodel.plan.view_scores import Scorer, Scores, planning_sensor
from jaxmodel.run.console import Progress
from jaxmodel.run.planning.object_run import FIRST_VIEWS, Case, object_run
from jaxmodel.run.planning.object_scene import ObjectScene, SceneOptions, object_scene
from jaxmodel.run.planning.objects import PLANNING_OBJECTS, load_object, object_files
from jaxmodel.run.planning.search_report import draw, tables
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared

__all__ = ["METHODS", "Config", "SearchStudy", "draw", "prepare", "tables"]

FIELD_SEED = 7919
"""Apart from the search's, so that the field's views are others than those it scores."""


class Decision(NamedTuple):
    """What a method is given: a map along a run, the poses so far, and how hard to look."""

    map: LabelMap
    taken: list[np.ndarray]
    scene: ObjectScene
    search: Search
    weights: Utility


def _searched(**changed: Any) -> Callable[[Decision], View]:
    def decide(of: Decision) -> View:
        search = replace(of.search, **changed)
        return next_view(of.map, of.scene.sensor, of.scene.sphere, search, Utility(), of.taken[-1], of.taken)

    return decide


def _climbed(of: Decision) -> View:
    sphere, sensor = of.scene.sphere, of.scene.sensor
    return hill_climbing(of.map, sensor, sphere, of.taken[-1], of.search, of.weights, of.taken)


METHODS: Mapping[str, Callable[[Decision], View]] = {
    "pattern": _searched(),
    "views": _searched(rounds=0, gradient=0),
    "gradient": _searched(rounds=0, gradient=3),
    "spiral_gradient": _searched(views=1, rounds=0, gradient=8),
    "hill_climbing": _climbed,
}
"""The search as it is; its first views alone; these improved by Levenberg-Marquardt on the soft utility; that from the
spiral alone, as the thesis does; and the earlier method."""


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``objects``: names of built-in ones, or files of meshes; ``maps`` of each, one after each view of a run by the
    utility, fewer where the run ends before; ``starts``: how many first views, a run each; ``field_views``: of the
    exhaustive field.
    """

    experiment: Literal["next_view_search"] = "next_view_search"
    seed: int = 0
    objects: tuple[str, ...] = PLANNING_OBJECTS
    maps: int = 6
    starts: int = 1
    field_views: int = 20_000
    methods: tuple[str, ...] = tuple(METHODS)
    scene: SceneOptions = field(default_factory=SceneOptions)
    search: Search = field(default_factory=Search)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        for key in ("objects", "methods"):
            if not getattr(self, key):
                raise ValueError(f"{key} must name at least one")
        for key in ("maps", "field_views"):
            if getattr(self, key) < 1:
                raise ValueError(f"{key} is {getattr(self, key)}, expected at least 1")
        if not 1 <= self.starts <= FIRST_VIEWS:
            raise ValueError(f"starts is {self.starts}, expected 1 to {FIRST_VIEWS}")
        for method in self.methods:
            if method not in METHODS:
                raise ValueError(f"methods names {method!r}, expected some of {', '.join(METHODS)}")


class SearchStudy(Prepared):
    """All maps; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.scenes = {name: object_scene(name, load_object(name), config.scene) for name in config.objects}
        self.inputs = hash_files(object_files(config.objects))
        self.resolved = unstructure(config)
        self.bytes_needed = 20_000_000

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Decide on the maps that are not yet decided on, write tables, pictures and ``summary.json``."""
        begun, config = time.perf_counter(), self.config
        progress.begin("maps", len(self.scenes) * config.starts * config.maps)
        rows, fields = [], []
        for place, scene in enumerate(self.scenes.values()):
            for start in range(config.starts):
                key = f"object{place:03d}start{start}"
                parts = folder.read_parts(key)
                if 0 not in parts:
                    progress.describe(scene.name)
                    parts[0], parts[1] = self._run(scene, start, progress)
                    folder.write_part(key, 1, parts[1])
                    folder.write_part(key, 0, parts[0])
                else:
                    progress.advance(config.maps)
                rows.append(parts[0])
                fields.append(parts[1] if (place, start) == (0, 0) else parts[1].head(0))
        table = polars.concat(rows, how="vertical")
        folder.write_table("results.parquet", table.drop("seconds"))  # times are no result: same seed, same bytes
        folder.write_table("field.parquet", polars.concat(fields, how="vertical"))
        summary: dict[str, Any] = {
            "experiment": "next_view_search",
            "objects": list(self.scenes),
            "field_views": config.field_views,
            "methods": summarised(table),
        }
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _run(self, scene: ObjectScene, start: int, progress: Progress) -> tuple[polars.DataFrame, polars.DataFrame]:
        """Rows of every map and method, and the fields."""
        config, rows, fields = self.config, [], []
        before = 0
        for map, taken in maps_along(scene, config.maps, config.seed, config.search, start):
            all_views, weights = exhaustive(map, taken, scene, config.search, config.field_views, config.seed)
            decision = Decision(map, taken, scene, config.search, weights)
            best = _best(all_views, config.search.minimum_overlap)
            shown = {"object": scene.name, "start": start, "map": len(taken)}
            for method in config.methods:
                begun = time.perf_counter()
                view = METHODS[method](decision)
                seconds = time.perf_counter() - begun
                worth = _again(decision, view)
                rows.append(
                    {
                        **shown,
                        "method": method,
                        "field_best": best,
                        "value": worth,
                        "ratio": worth / best,
                        "scored": view.scored,
                        "outcome": view.outcome.name.lower(),
                        **_looks_from(view.T_world_sensor[None], scene)[0],
                        "seconds": seconds,
                    }
                )
            able = all_views.overlap >= config.search.minimum_overlap
            for place, value, fits in zip(_looks_from(all_views.poses, scene), all_views.value, able, strict=True):
                fields.append({**shown, **place, "value": float(value), "overlaps": bool(fits)})
            progress.advance(1)
            before += 1
        progress.advance(config.maps - before)
        return polars.DataFrame(rows), polars.DataFrame(fields)


def prepare(config: Config) -> SearchStudy:
    """Read and check everything ``config`` names."""
    return SearchStudy(config)


def maps_along(
    scene: ObjectScene, count: int, seed: int, search: Search, start: int = 0
) -> Iterator[tuple[LabelMap, list[np.ndarray]]]:
    """The maps after each of ``count`` views of a run by the utility while it goes on, with the poses up to there."""
    case = Case("utility", start, 0.0, False, 0.0, 0.0, seed)
    taken = []
    for seen in object_run(scene, case, Loop(views=count + 1), search):
        taken.append(seen.step.T_world_sensor)
        if seen.step.ending is Ending.GOES_ON:
            yield seen.step.map, list(taken)


def exhaustive(
    map: LabelMap, taken: list[np.ndarray], scene: ObjectScene, search: Search, views: int, seed: int
) -> tuple[Scores, Utility]:
    """The field of views, and the utility whose nominal shares follow from it."""
    found = utility_field(map, scene.sensor, scene.sphere, Utility(), views, search.fine, seed + FIELD_SEED)
    scorer, scores = _scorer(map, taken, scene, search, Utility()).attaining(found, search.minimum_overlap)
    return scores, scorer.weights


def summarised(table: polars.DataFrame) -> list[dict[str, Any]]:
    """By method: how many maps, and how near to the field's best."""
    found = []
    for (method,), rows in table.group_by(["method"], maintain_order=True):
        ratio = rows["ratio"].to_numpy()
        found.append(
            {
                "method": method,
                "maps": len(rows),
                "reached": float(np.mean(ratio >= 0.99)),
                "mean": float(ratio.mean()),
                "worst": float(ratio.min()),
                "scored": float(rows["scored"].to_numpy().mean()),
                "seconds": float(np.median(rows["seconds"].to_numpy())),
            }
        )
    return found


def _scorer(map: LabelMap, taken: list[np.ndarray], scene: ObjectScene, search: Search, weights: Utility) -> Scorer:
    sensor = planning_sensor(scene.sensor, search.fine)
    return Scorer(map, ready(map), sensor, scene.sphere, weights, 0.0, None, tuple(taken))


def _best(scores: Scores, least_overlap: float) -> float:
    able = scores.overlap >= least_overlap
    return float(scores.value[able].max() if able.any() else scores.value[np.argmax(scores.overlap)])


def _again(of: Decision, view: View) -> float:
    """What a view is worth on the field's terms; nothing where it overlaps too little."""
    found = _scorer(of.map, of.taken, of.scene, of.search, of.weights)(view.parameter[None])
    return float(found.value[0]) if found.overlap[0] >= of.search.minimum_overlap else 0.0


def _looks_from(poses: Float[np.ndarray, "n 4 4"], scene: ObjectScene) -> list[dict[str, float]]:
    """Azimuth and elevation of where views stand on the sphere, in degrees."""
    x, y, z = ((poses[:, :3, 3] - scene.sphere.origin) / scene.sphere.radius).T
    azimuth, elevation = np.rad2deg(np.arctan2(y, x)), np.rad2deg(np.arcsin(np.clip(z, -1, 1)))
    return [{"azimuth_deg": float(a), "elevation_deg": float(e)} for a, e in zip(azimuth, elevation, strict=True)]
