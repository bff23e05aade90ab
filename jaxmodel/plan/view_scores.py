"""Views and their exact scores, many at once."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import Label
from jaxmodel.plan.open_space import Space
from jaxmodel.plan.ray_march import look
from jaxmodel.plan.seen import Seen
from jaxmodel.plan.utility import Utility
from jaxmodel.scan.sensor import Sensor

LEAST_ROWS = 256
"""Views that utilities are computed of at least."""


class Scores(NamedTuple):
    """Exact scores of many views, by view: ``value`` is the utility less repeats and travel."""

    parameters: Float[np.ndarray, "n d"]
    poses: Float[np.ndarray, "n 4 4"]
    seen: Seen
    utility: Float[np.ndarray, " n"]
    value: Float[np.ndarray, " n"]
    overlap: Float[np.ndarray, " n"]
    novelty: Float[np.ndarray, " n"]

    def take(self, rows: np.ndarray) -> "Scores":
        """Some of the views."""
        seen = self.seen.take(rows)
        rest = (self.utility, self.value, self.overlap, self.novelty)
        return Scores(self.parameters[rows], self.poses[rows], seen, *(array[rows] for array in rest))


class Scorer(NamedTuple):
    """Everything that a view's exact score depends on."""

    map: LabelMap
    space: Space
    sensor: Sensor
    views: Any
    weights: Utility
    travel: float
    eye: Float[np.ndarray, "3"] | None
    taken: tuple[Float[np.ndarray, "4 4"], ...]

    def __call__(self, parameters: Float[np.ndarray, "n d"]) -> Scores:
        """Scores of those of ``parameters`` that the view space allows."""
        poses = self.views.poses(parameters)
        allowed = np.asarray(self.views.allowed(poses))
        parameters, poses = parameters[allowed], poses[allowed]
        return self.scored(parameters, poses, look(self.map, poses, self.sensor, space=self.space))

    def attaining(self, found: Scores, least_overlap: float) -> tuple["Scorer", Scores]:
        """With nominal shares after the views that overlap enough (all, where none does), and these scores by it."""
        able = found.overlap >= least_overlap
        weights = self.weights.attainable(found.seen.shares[able] if able.any() else found.seen.shares)
        scorer = self._replace(weights=weights)
        return scorer, scorer.scored(found.parameters, found.poses, found.seen)

    def scored(self, parameters, poses, seen: Seen) -> Scores:
        """The scores that follow from what is seen."""
        utility = utilities(self.weights, seen)
        met = np.maximum(seen.counts.sum(axis=1), 1)
        overlap = (seen.counts[:, Label.OCCUPIED] + seen.counts[:, Label.BORDER]) / met
        novelty = (seen.counts[:, Label.UNKNOWN] + seen.counts[:, Label.OCCLUSION_PLANE]) / seen.total
        value = utility
        if len(self.taken):
            value = value - float(self.weights.repeat) * self.views.likeness(poses, self.taken)
        if self.travel > 0 and self.eye is not None:
            extent = self.map.grid.cell * max(self.map.grid.shape)
            value = value - self.travel * np.linalg.norm(poses[:, :3, 3] - self.eye, axis=1) / extent
        return Scores(parameters, poses, seen, utility, value, overlap, novelty)


def utilities(weights: Utility, seen: Seen) -> Float[np.ndarray, " v"]:
    """The utility of each view. Rows are filled up to a power of two: another number of views compiles nothing."""
    rows = len(seen.counts)
    size = max(LEAST_ROWS, 1 << (rows - 1).bit_length()) if rows else LEAST_ROWS
    filled = (
        np.pad(np.asarray(of, np.float32), ((0, size - rows), (0, 0)))
        for of in (seen.shares, seen.quality, seen.promising)
    )
    return np.asarray(_utilities(weights, *filled))[:rows]


@jax.jit
def _utilities(weights: Utility, shares: Any, quality: Any, promise: Any) -> Any:
    return weights(shares, quality, promise)


def joined(one: Scores, two: Scores) -> Scores:
    """The views of both."""
    seen = one.seen.joined(two.seen)
    rest = [
        np.concatenate([getattr(one, name), getattr(two, name)]) for name in ("utility", "value", "overlap", "novelty")
    ]
    return Scores(np.concatenate([one.parameters, two.parameters]), np.concatenate([one.poses, two.poses]), seen, *rest)


def leaders(scores: Scores, count: int, apart: Float[np.ndarray, " d"], least_overlap: float) -> Int[np.ndarray, " k"]:
    """Rows of the best views that overlap enough, no two of them closer than twice the field's spacing."""
    order = np.argsort(-np.where(scores.overlap >= least_overlap, scores.value, -np.inf), kind="stable")
    order = order[: int(np.sum(scores.overlap >= least_overlap))][: 40 * count]
    chosen: list[int] = []
    poses = scores.poses
    reach = 2 * float(apart[-1])
    for row in order:
        turn = [float(poses[row, :3, 2] @ poses[other, :3, 2]) for other in chosen]
        way = [float(np.linalg.norm(poses[row, :3, 3] - poses[other, :3, 3])) for other in chosen]
        size = float(np.ptp(poses[:, :3, 3], axis=0).max())
        near = [c > np.cos(reach) and w <= reach / 2 * max(size, 1e-300) for c, w in zip(turn, way, strict=True)]
        if not any(near):
            chosen.append(int(row))
        if len(chosen) == count:
            break
    return np.array(chosen, np.int64)


def planning_sensor(sensor: Sensor, rays: int) -> Sensor:
    """``sensor`` with the same view and about ``rays`` pixels in all, for planning; never more than it has."""
    scale = min(1.0, np.sqrt(rays / (sensor.width * sensor.height)))
    return replace(sensor, width=max(1, round(sensor.width * scale)), height=max(1, round(sensor.height * scale)))
