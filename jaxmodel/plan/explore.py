"""The closed loop: scan, place, update the map, plan, move (thesis §4.4, Fig. 4.9; §4.5 for objects).

The loop knows no scanner and no robot: ``scan`` takes a range image from a pose, ``place`` says from where it really
was taken, ``views_at`` which views can be reached next. Steps come one by one, so that a caller may watch, save, stop.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.plan.free_space import FreeSpace
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import Label
from jaxmodel.plan.map_update import update
from jaxmodel.plan.next_view import Search, View, ViewOutcome, next_view
from jaxmodel.plan.utility import Utility
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor

FAILURES = 3
"""Views in a row that may fail to be placed before the loop gives up."""


@dataclass(frozen=True)
class Loop:
    """``views`` at most; the loop ends after two views in a row that add less than ``least_gain`` of the surface known.

    ``stride``: in free space, how far the next view may be while one near enough is worth taking (unit of the data;
    None: anywhere); ``worth`` the part of a view's rays that must meet something new for that. Without such a view the
    robot goes back along its way (thesis §4.4), and only then anywhere.
    """

    views: int = 20
    least_gain: float = 0.01
    stride: float | None = None
    worth: float = 0.05

    def __post_init__(self) -> None:
        if self.views < 1:
            raise InputError(f"loop.views: expected at least 1, got {self.views}.")
        if not 0 <= self.least_gain < 1:
            raise InputError(f"loop.least_gain: expected a share below 1, got {self.least_gain}.")
        if self.stride is not None and not self.stride > 0:
            raise InputError(f"loop.stride: expected a positive length, got {self.stride}.")


class Ending(Enum):
    """Why the loop stops after a step; the value is a sentence."""

    GOES_ON = "more views are worth taking"
    NOTHING_NEW = "no reachable view meets anything unknown or hidden"
    LITTLE_NEW = "the best reachable view meets almost nothing unknown or hidden"
    LITTLE_GAIN = "two views in a row added almost nothing to the surface known"
    VIEWS_USED = "the number of views allowed is used up"
    NO_REACHABLE_VIEW = "the sensor can reach no other view"
    NOTHING_SEEN = "the first view met no surface"
    NOT_PLACED = "views in a row could not be registered to the model"


ENDS = {
    ViewOutcome.NO_REACHABLE_VIEW: Ending.NO_REACHABLE_VIEW,
    ViewOutcome.NOTHING_NEW: Ending.NOTHING_NEW,
    ViewOutcome.LITTLE_NEW: Ending.LITTLE_NEW,
}
"""Outcomes of the search that end the loop."""


class Placed(NamedTuple):
    """Where a view was really taken from, and whether that could be told; ``report`` is the caller's own."""

    T_world_sensor: Float[np.ndarray, "4 4"]
    sure: bool = True
    report: Any = None


class Step(NamedTuple):
    """One view: ``planned`` None for the first; ``image`` in its own frame; ``map`` after it; ``gain`` part of the
    occupied voxels that it added; ``back`` how many views the robot went back before this one; ``ending`` of the loop.
    """

    number: int
    planned: View | None
    T_world_sensor: Float[np.ndarray, "4 4"]
    image: RangeImage
    placed: Placed
    map: LabelMap
    gain: float
    back: int
    ending: Ending


class Way(NamedTuple):
    """What the loop keeps: every pose so far, the last gains, failures in a row."""

    poses: list[np.ndarray]
    gains: list[float]
    failures: int


Chooser = Callable[[LabelMap, Any, Search, Sequence[np.ndarray]], View]
"""The next view from a map, a view space, the search and all poses so far."""


def by_utility(sensor: Sensor, weights: Utility = Utility()) -> Chooser:
    """The view of highest utility (:func:`next_view`)."""
    return lambda map, space, search, taken: next_view(map, sensor, space, search, weights, taken[-1], taken)


def explore(
    scan: Callable[[np.ndarray, int], RangeImage],
    map: LabelMap,
    sensor: Sensor,
    views_at: Callable[[LabelMap, np.ndarray], Any],
    first: Float[np.ndarray, "4 4"],
    loop: Loop = Loop(),
    search: Search = Search(),
    choose: Chooser | None = None,
    place: Callable[[RangeImage, np.ndarray], Placed] | None = None,
) -> Iterator[Step]:
    """Steps of an exploration from the pose ``first`` (T_world_sensor) on.

    ``scan(T_world_sensor, number)`` gives the image of view ``number``; ``views_at(map, T_world_sensor)`` the view
    space from there; ``choose`` the next view (default :func:`by_utility`); ``place(image, T_planned)`` the pose an
    image was really taken from (default: as planned). A view that cannot be placed is not added to the map, and the
    next one must overlap more.
    """
    choose = by_utility(sensor) if choose is None else choose
    T, planned, back = np.asarray(first, np.float64), None, 0
    way = Way([], [], 0)
    for number in range(loop.views):
        image = scan(T, number)
        placed = Placed(T) if place is None or number == 0 else place(image, T)
        before = known(map)
        if placed.sure:
            map = update(map, image, placed.T_world_sensor, sensor)
        gain = (known(map) - before) / max(known(map), 1)
        way = Way([*way.poses, T], [*way.gains, gain], 0 if placed.sure else way.failures + 1)
        ending = _ending(map, way, loop)
        following, steps_back = None, 0
        if ending is Ending.GOES_ON:
            tighter = _tighter(search, way.failures, number)
            following, steps_back = planned_view(map, views_at, way, loop, tighter, choose)
            ending = ENDS.get(following.outcome, ending)
        yield Step(number, planned, T, image, placed, map, gain, back, ending)
        if ending is not Ending.GOES_ON or following is None:
            return
        T, planned, back = following.T_world_sensor, following, steps_back


def known(map: LabelMap) -> int:
    """Voxels that hold readings."""
    return int(np.count_nonzero(map.points))


def planned_view(
    map: LabelMap, views_at: Callable, way: Way, loop: Loop, search: Search, choose: Chooser
) -> tuple[View, int]:
    """The next view, near the last pose, near an earlier one or anywhere, and how many views the robot goes back."""
    space = views_at(map, way.poses[-1])
    if loop.stride is not None and isinstance(space, FreeSpace):
        here, tried = way.poses[-1][:3, 3], []
        # the nearest first, not the latest: the latest may lie at the other end of a long way
        order = sorted(range(len(way.poses)), key=lambda k: (float(np.linalg.norm(way.poses[k][:3, 3] - here)), -k))
        for number in order:
            T = way.poses[number]
            if any(np.linalg.norm(T[:3, 3] - other) < loop.stride / 2 for other in tried):
                continue
            tried.append(T[:3, 3])
            view = choose(map, space.near(T[:3, 3], loop.stride), search, [*way.poses, T])
            if view.outcome is ViewOutcome.FOUND and view.novelty >= loop.worth:
                return view, len(way.poses) - 1 - number
    return choose(map, space, search, way.poses), 0


def _tighter(search: Search, failures: int, number: int) -> Search:
    """After a view that could not be placed: more overlap, other candidates."""
    overlap = 1 - (1 - search.minimum_overlap) * 0.6**failures
    return replace(search, minimum_overlap=overlap, seed=search.seed + number)


def _ending(map: LabelMap, way: Way, loop: Loop) -> Ending:
    if known(map) == 0:
        return Ending.NOTHING_SEEN
    if way.failures >= FAILURES:
        return Ending.NOT_PLACED
    if len(way.gains) == loop.views:
        return Ending.VIEWS_USED
    if way.failures == 0 and len(way.gains) > 2 and max(way.gains[-2:]) < loop.least_gain:
        return Ending.LITTLE_GAIN
    return Ending.GOES_ON


def label_shares(map: LabelMap) -> dict[str, float]:
    """Part of all voxels with each label."""
    count = np.bincount(map.labels.reshape(-1), minlength=len(Label))
    return {label.name.lower(): float(count[label] / map.labels.size) for label in Label}
