"""One modelling run of an object: scan, plan, move, and how much of the surface is seen after each view."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxmodel.plan.baselines import baseline_view
from jaxmodel.plan.coverage import CoverageCurve, visible
from jaxmodel.plan.explore import Chooser, Loop, Step, by_utility, explore
from jaxmodel.plan.next_view import Search
from jaxmodel.run.planning.object_scene import ObjectScene
from jaxmodel.run.planning.placing import Placer

PLANNERS = ("utility", "area_factor", "uniform", "random")
FREE = "_free"
"""Ending of the name of a planner that is not held to an overlap."""
FIRST_VIEWS = 7
"""The first view is one of so many spread over the sphere."""


@dataclass(frozen=True)
class Case:
    """What one run does: ``planner`` of :data:`PLANNERS`, held to the overlap unless it ends in ``FREE``.

    ``start``: which of the first views; ``noise`` of the scanner in the object's longest side; ``registered``: views
    are placed by registration, from poses off by ``off_deg`` and ``off_shift`` (of the size).
    """

    planner: str
    start: int
    noise: float
    registered: bool
    off_deg: float
    off_shift: float
    seed: int


class Seen(NamedTuple):
    """A step of the loop and the share of the reachable surface seen by all views up to it."""

    step: Step
    coverage: float


def object_run(scene: ObjectScene, case: Case, loop: Loop, search: Search) -> Iterator[Seen]:
    """The steps of one run, as they are made."""
    free = case.planner.endswith(FREE)
    search = Search(**{**vars(search), "minimum_overlap": 0.0}) if free else search
    keys = jax.random.split(jax.random.key(case.seed), loop.views)
    rng = np.random.default_rng((case.seed, case.start))
    placer = Placer(case.off_deg, case.off_shift, scene.size, rng) if case.registered else None
    first = scene.sphere.poses(scene.sphere.spread(FIRST_VIEWS, case.seed))[case.start % FIRST_VIEWS]

    def scan(T: np.ndarray, number: int) -> Any:
        image = scene.scan(T, case.noise, keys[number])
        if placer is not None and number == 0:
            placer.first(image, T)
        return image

    curve = CoverageCurve.start(scene.reachable, scene.samples.weights)
    steps = explore(
        scan,
        scene.map,
        scene.sensor,
        lambda map, T: scene.sphere,
        first,
        loop,
        search,
        chooser(case.planner.removesuffix(FREE), scene),
        placer,
    )
    for step in steps:
        if step.placed.sure:
            curve = curve.after(visible(scene.samples, scene.mesh, step.T_world_sensor[None], scene.sensor)[0])
        yield Seen(step, curve.shares[-1] if curve.shares else 0.0)


def chooser(planner: str, scene: ObjectScene) -> Chooser:
    """How the next view is chosen."""
    if planner == "utility":
        return by_utility(scene.sensor)
    return lambda map, space, search, taken: baseline_view(planner, map, scene.sensor, space, taken, search)


def row_of(seen: Seen) -> dict[str, Any]:
    """One row of the table of results."""
    step, view = seen.step, seen.step.planned
    report = step.placed.report
    nan = float("nan")
    return {
        "view": step.number,
        "coverage": seen.coverage,
        "gain": step.gain,
        "overlap": nan if view is None else view.overlap,
        "novelty": nan if view is None else view.novelty,
        "utility": nan if view is None else view.utility,
        "scored": 0 if view is None else view.scored,
        "placed": step.placed.sure,
        "right": report is None or report.right,
        "start_deg": nan if report is None else report.start_deg,
        "start_shift": nan if report is None else report.start_shift,
        "error_deg": nan if report is None else report.error_deg,
        "error_shift": nan if report is None else report.error_shift,
        "ending": step.ending.name.lower(),
        **{f"T_{i}{j}": float(step.T_world_sensor[i, j]) for i in range(3) for j in range(4)},
    }
