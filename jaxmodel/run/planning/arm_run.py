"""A modelling run with the sensor on an arm: only views in reach, and another place of its base when they are used up.

The thesis leaves the base where it is and names moving it as what comes next (§4.5, Fig. 4.12).
"""

from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jaxmodel.plan.arm import Arm
from jaxmodel.plan.arm_check import ReachCheck, check_reached
from jaxmodel.plan.arm_reposition import reposition
from jaxmodel.plan.coverage import CoverageCurve, visible
from jaxmodel.plan.explore import Loop, Step, explore
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.next_view import Search, View, ViewOutcome, next_view, utility_field
from jaxmodel.plan.reach_map import ArmReach, ArmViews
from jaxmodel.plan.utility import Utility
from jaxmodel.plan.viewpoints import Restricted
from jaxmodel.run.planning.arm_scene import ArmScene

Bases = Literal["free", "fixed", "moving"]
BASES: tuple[Bases, ...] = ("free", "fixed", "moving")
"""No arm: any view of the sphere; an arm that stays; an arm whose base moves."""
WANTED = 400
"""Views of the sphere among which those worth a move are picked."""
WORTH = 0.5
"""Part of the best view's novelty from which a view is worth a move."""


class ArmStep(NamedTuple):
    """A step of the loop with what the arm did for it; ``check`` was made without the solvers."""

    step: Step
    coverage: float
    station: int
    arm: Arm
    views: ArmViews | None
    check: ReachCheck | None


class Robot:
    """The arm where it stands now, and where it stood at each view."""

    def __init__(self, scene: ArmScene, bases: Bases, least_novelty: float) -> None:
        self.scene, self.bases, self.least_novelty = scene, bases, least_novelty
        self.arm, self.station = scene.arm, 0
        self.views: ArmViews | None = None

    @property
    def space(self) -> Any:
        """The views that can be taken from here."""
        sphere = self.scene.object.sphere
        return sphere if self.bases == "free" else Restricted(sphere, ArmReach(self.arm, self.scene.method))

    def first(self) -> Float[np.ndarray, "4 4"] | None:
        """The view that leaves the joints most room; None where none is reached, from no place that may be taken."""
        sphere = self.scene.object.sphere
        poses = sphere.poses(sphere.spread(WANTED))
        if self.bases == "free":
            return poses[0]
        if self.bases == "moving" and not ArmReach(self.arm, self.scene.method)(poses).any():
            self._moved(poses)
        found = ArmReach(self.arm, self.scene.method).place(poses)
        if not found.reached.any():
            return None
        return self._goes_to(poses[int(np.nanargmax(found.placements.limit_margin))])

    def choose(self, map: LabelMap, space: Any, search: Search, taken: Sequence[np.ndarray]) -> View:
        """The best view from here; where that is worth too little, the best from where most of the rest is reached."""
        view = self._next(map, space, search, taken)
        if self.bases == "moving" and not (view.outcome is ViewOutcome.FOUND and view.novelty >= self.least_novelty):
            view = self._from_elsewhere(view, map, search, taken)
        if self.bases == "free" or not np.isfinite(view.T_world_sensor).all():
            return view
        return view._replace(T_world_sensor=self._goes_to(view.T_world_sensor))

    def _from_elsewhere(self, view: View, map: LabelMap, search: Search, taken: Sequence[np.ndarray]) -> View:
        """A better view than ``view`` from another place of the base, if there is one; the arm then stands there."""
        of = self.scene.object
        field = utility_field(map, of.sensor, of.sphere, Utility(), WANTED, search.fine, search.seed)
        here = np.nan_to_num(view.novelty)
        useful = (field.novelty > max(WORTH * field.novelty.max(), here)) & (field.overlap >= search.minimum_overlap)
        before = self.arm
        if not useful.any() or not self._moved(field.poses[useful]):
            return view
        other = self._next(map, self.space, search, taken)
        if other.outcome is ViewOutcome.FOUND and other.novelty > here:
            self.station += 1
            return other
        self.arm = before
        return view

    def _next(self, map: LabelMap, space: Any, search: Search, taken: Sequence[np.ndarray]) -> View:
        return next_view(map, self.scene.object.sensor, space, search, Utility(), taken[-1], taken)

    def _goes_to(self, T_world_sensor: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """The pose in the roll that is nearest to where the joints are."""
        joints = None if self.views is None else self.views.placements.joints[0]
        self.views = ArmReach(self.arm, self.scene.method).place(T_world_sensor[None], joints)
        return self.views.T_world_sensor[0]

    def _moved(self, wanted: Float[np.ndarray, "m 4 4"]) -> bool:
        """Whether the base was moved to where most of ``wanted`` is reached."""
        if len(self.scene.places) == 0:
            return False
        found = reposition(self.arm, wanted, self.scene.places, self.scene.method)
        if found.candidate >= 0:
            self.arm = self.arm.at(found.T_world_base)
        return found.candidate >= 0


def arm_run(scene: ArmScene, bases: Bases, loop: Loop, search: Search, noise: float, seed: int) -> Iterator[ArmStep]:
    """The steps of one run, as they are made; none where the arm reaches no view at all."""
    robot = Robot(scene, bases, loop.worth)
    first = robot.first()
    if first is None:
        return
    keys = jax.random.split(jax.random.key(seed), loop.views)
    of = scene.object
    curve = CoverageCurve.start(of.reachable, of.samples.weights)
    # the loop plans the next view before it hands out a step: where the arm stands is noted when it scans
    stood: list[tuple[int, Arm, ArmViews | None]] = []

    def scan(T: np.ndarray, number: int) -> Any:
        stood.append((robot.station, robot.arm, robot.views))
        return of.scan(T, noise, keys[number])

    for step in explore(scan, of.map, of.sensor, lambda map, T: robot.space, first, loop, search, robot.choose):
        station, arm, views = stood[step.number]
        T = step.T_world_sensor[None]
        check = None if views is None else check_reached(arm, views.placements.joints, T)
        curve = curve.after(visible(of.samples, of.mesh, T, of.sensor)[0])
        yield ArmStep(step, curve.shares[-1], station, arm, views, check)
