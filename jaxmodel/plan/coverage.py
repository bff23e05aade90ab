"""How much of the surface that can be seen at all has been seen: the measure of a sequence of views.

The reachable surface is what at least one pose of the view space sees; coverage is the share of its area that the
views taken so far have seen. Both are counted on the same samples of the true surface.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.errors import InputError
from jaxmodel.plan.surface_samples import SurfaceSamples
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh
from jaxmodel.scan.visibility import Occluders, exposed_points, seen_points

GRAZING_DEG = 80.0


def visible(
    samples: SurfaceSamples,
    mesh: ObjectMesh,
    T_world_sensor: Float[np.ndarray, "v 4 4"],
    sensor: Sensor,
    grazing_deg: float | int = GRAZING_DEG,
) -> Bool[np.ndarray, "v n"]:
    """Which samples of ``mesh`` (world frame) each pose sees (see :func:`jaxmodel.scan.visibility.seen_points`).

    One pose is worked on at a time, so the answer itself, a byte a pose and sample, is what grows with their number.
    """
    occluders = Occluders(mesh.vertices, mesh.faces)
    seen = np.zeros((len(T_world_sensor), len(samples.points)), dtype=bool)
    for row, pose in zip(seen, T_world_sensor, strict=True):
        row[:] = seen_points(samples.points, samples.normals, occluders, sensor, pose, grazing_deg)
    return seen


def reachable(
    samples: SurfaceSamples,
    mesh: ObjectMesh,
    T_world_sensor: Float[np.ndarray, "v 4 4"],
    sensor: Sensor,
    grazing_deg: float | int = GRAZING_DEG,
) -> Bool[np.ndarray, " n"]:
    """Which samples at least one of the poses sees: with poses dense in the view space, the reachable surface.

    A pose is asked only about samples that none before it saw, so thousands of poses cost a few dozen's time.
    """
    occluders = Occluders(mesh.vertices, mesh.faces)
    seen = np.zeros(len(samples.points), dtype=bool)
    for pose in T_world_sensor:
        rest = np.flatnonzero(~seen)
        if len(rest) == 0:
            break
        seen[rest] = seen_points(samples.points[rest], samples.normals[rest], occluders, sensor, pose, grazing_deg)
    return seen


def exposed(samples: SurfaceSamples, mesh: ObjectMesh) -> Bool[np.ndarray, " n"]:
    """Which samples border the outside of ``mesh``, of closed parts that may overlap; the rest is buried in a part.

    The surface that a share of the whole surface is a share of. Meaningless for an open mesh.
    """
    return exposed_points(samples.points, samples.normals, Occluders(mesh.vertices, mesh.faces))


def coverage(
    seen: Bool[np.ndarray, " n"], reachable: Bool[np.ndarray, " n"], weights: Float[np.ndarray, " n"]
) -> float:
    """Share, by weight, of the reachable samples that are seen; NaN where nothing is reachable."""
    whole = float(weights[reachable].sum())
    return float(weights[reachable & seen].sum()) / whole if whole > 0 else float("nan")


def greedy_views(
    visible: Bool[np.ndarray, "v n"], reachable: Bool[np.ndarray, " n"], weights: Float[np.ndarray, " n"], count: int
) -> Int[np.ndarray, " k"]:
    """The views, at most ``count``, that one who knew the true surface would take: each adds the most to what is seen.

    No sequence of as many of these views covers more than 1 / (1 - 1/e) times as much (Nemhauser, Wolsey and Fisher,
    1978): the mark for planners that must find the surface first. It ends early when no view adds anything.
    """
    worth = np.where(reachable, weights, 0.0)
    order: list[int] = []
    for _ in range(count):
        gain = np.array([worth[view].sum() for view in visible])  # a product would copy every view as floats
        if len(gain) == 0 or not gain.max() > 0:
            break
        order.append(int(np.argmax(gain)))
        worth = np.where(visible[order[-1]], 0.0, worth)
    return np.array(order, dtype=np.int64)


class CoverageCurve(eqx.Module):
    """Coverage after each view of a sequence; :meth:`after` returns the curve one view longer.

    ``seen (n,)`` are the samples any view so far saw, ``shares`` the coverage after the first, second, ... view.
    """

    reachable: Bool[np.ndarray, " n"]
    weights: Float[np.ndarray, " n"]
    seen: Bool[np.ndarray, " n"]
    shares: tuple[float, ...] = ()

    @staticmethod
    def start(reachable: Bool[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> "CoverageCurve":
        """The curve before the first view. Raises :class:`InputError` when nothing is reachable."""
        if not float(weights[reachable].sum()) > 0:
            raise InputError("No part of the surface can be reached from the view space, so there is no coverage.")
        return CoverageCurve(reachable, weights, np.zeros_like(reachable))

    def after(self, view: Bool[np.ndarray, " n"]) -> "CoverageCurve":
        """The curve with one more view, which sees the samples ``view``."""
        seen = self.seen | view
        share = coverage(seen, self.reachable, self.weights)
        return CoverageCurve(self.reachable, self.weights, seen, (*self.shares, share))

    def after_all(self, views: Bool[np.ndarray, "v n"]) -> "CoverageCurve":
        """The curve with the views ``views`` added in their order."""
        curve = self
        for view in views:
            curve = curve.after(view)
        return curve

    def area(self, views: int) -> float:
        """Mean coverage over the first ``views`` views; a shorter sequence stays at its last value (0 if empty).

        1 would be everything seen by the first view. Raises :class:`InputError` for ``views`` below 1.
        """
        if views < 1:
            raise InputError(f"views: expected at least 1, got {views}.")
        held = self.shares[:views] or (0.0,)
        return float(np.mean([*held, *[held[-1]] * (views - len(held))]))

    def views_needed(self, share: float) -> int | None:
        """The least number of views with a coverage of at least ``share``; None if the sequence does not get there."""
        return next((count for count, value in enumerate(self.shares, start=1) if value >= share), None)
