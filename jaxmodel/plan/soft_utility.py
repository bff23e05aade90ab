"""Views improved by Levenberg-Marquardt on what soft rays meet, from several starts at once (thesis §4.3.2).

The thesis runs Levenberg-Marquardt on counted percentages, whose derivative is zero almost everywhere (ERRATA); here
it runs on :mod:`soft_march`. What it finds is to be scored again by the exact march.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.geometry.elimination import NormalEquations
from jaxmodel.lanes import Engine, Kernel, run
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.soft_march import SoftLaw, SoftRays, SoftSpace, quality, soft_rays, soft_ready, soft_shares
from jaxmodel.scan.sensor import Sensor

STIFFNESS = 10.0
"""Residuals are scaled by it, so that the solver's first damping (1) is a small one."""

Pose = Callable[[Float[jax.Array, " d"]], Float[jax.Array, "4 4"]]
Residuals = Callable[[Float[jax.Array, "6"], Float[jax.Array, "6"]], Float[jax.Array, " k"]]


class ClimbOutcome(IntEnum):
    """How a climb ended."""

    CONVERGED = 0
    STEP_LIMIT = 1
    NOT_FINITE = 2

    @property
    def sentence(self) -> str:
        """What the outcome means."""
        return {
            ClimbOutcome.CONVERGED: "the stopping rule was met",
            ClimbOutcome.STEP_LIMIT: "the step limit was reached before the stopping rule was met",
            ClimbOutcome.NOT_FINITE: "the residuals at the start are not finite; the start is returned",
        }[self]


class Climbed(NamedTuple):
    """One row a start: the ``parameter`` found, its ``cost`` (sum of squared residuals), that of the start, and how.

    ``cost`` is never above ``start_cost``; ``outcome`` is a :class:`ClimbOutcome`.
    """

    parameter: Float[np.ndarray, "s d"]
    cost: Float[np.ndarray, " s"]
    start_cost: Float[np.ndarray, " s"]
    steps: Int[np.ndarray, " s"]
    outcome: Int[np.ndarray, " s"]


class SoftProblem(eqx.Module):
    """Residuals of a view, by its parameter; ``corner`` of the grid where ``pose`` counts from, ``cell`` its voxel."""

    space: SoftSpace
    rays: SoftRays
    law: SoftLaw
    pose: Any
    residuals: Any
    corner: Float[jax.Array, "3"]
    cell: Float[jax.Array, ""]

    def __call__(self, parameter: Float[jax.Array, " d"]) -> Float[jax.Array, " k"]:
        """Residuals, whose sum of squares is to be small."""
        T = self.pose(parameter)
        in_cells = T.at[:3, 3].set((T[:3, 3] - self.corner) / self.cell)
        seen = soft_shares(self.space, in_cells, self.rays, self.law)
        return self.residuals(seen.shares, quality(seen, self.rays.directions.shape[1]))


class Climb(Kernel):
    """Levenberg-Marquardt as a kernel: an item is a start ``(d,)``; it is solved as a whole."""

    problem: SoftProblem
    tolerance: Any
    max_steps: int = eqx.field(static=True)

    def init(self, item):
        solution = optx.least_squares(
            lambda parameter, problem: STIFFNESS * problem(parameter),
            optx.LevenbergMarquardt(rtol=self.tolerance, atol=self.tolerance, linear_solver=NormalEquations()),
            item,
            args=self.problem,
            max_steps=self.max_steps,
            throw=False,
        )
        before, after = (jnp.sum(self.problem(point) ** 2) for point in (item, solution.value))
        better = after < before
        ended = jnp.where(solution.result == optx.RESULTS.successful, ClimbOutcome.CONVERGED, ClimbOutcome.STEP_LIMIT)
        outcome = jnp.where(jnp.isfinite(before), ended, ClimbOutcome.NOT_FINITE)
        parameter = jnp.where(better, solution.value, item)
        steps = solution.stats["num_steps"].astype(jnp.int32)
        return parameter, jnp.where(better, after, before), before, steps, outcome.astype(jnp.int32)

    def step(self, state):
        return state

    def done(self, state):
        return jnp.asarray(True)

    def finish(self, state):
        return state


def levenberg_marquardt(
    map: LabelMap,
    sensor: Sensor,
    pose: Pose,
    residuals: Residuals,
    starts: Float[np.ndarray, "s d"],
    origin: Float[np.ndarray, "3"] | None = None,
    space: SoftSpace | None = None,
    law: SoftLaw | None = None,
    max_steps: int = 12,
    tolerance: float = 1e-3,
    engine: Engine | None = None,
) -> Climbed:
    """Views of ``sensor`` (a few hundred rays will do) with small ``residuals``, one from each start.

    ``pose`` takes a parameter to ``T_world_sensor``, its translation measured from ``origin`` (world, default 0);
    ``residuals`` takes the soft shares and qualities by label to residuals, such as ``sqrt(1 - K f(x) + tiny)``. Both
    are jax functions or modules, whose arrays are traced. ``space``: the map made ready by :func:`soft_ready`.
    ``tolerance`` of a step and of the residuals, relative and absolute. Raises :class:`InputError` for starts that are
    none.
    """
    starts = np.asarray(starts, np.float32)
    if starts.ndim != 2 or starts.shape[1] < 1 or not np.isfinite(starts).all():
        raise InputError(f"The starts of a climb must be a finite array (starts, parameters), not {starts.shape}.")
    if max_steps < 1:
        raise InputError(f"A climb needs at least one step, not {max_steps}.")
    if len(starts) == 0:
        none, whole = np.zeros(0, np.float32), np.zeros(0, np.int32)
        return Climbed(starts, none, none, whole, whole)
    corner = map.grid.origin - (0.0 if origin is None else np.asarray(origin, np.float64))
    problem = SoftProblem(
        soft_ready(map) if space is None else space,
        soft_rays(map, sensor),
        _traced(SoftLaw() if law is None else law),
        _argument(pose),
        _argument(residuals),
        jnp.asarray(corner, jnp.float32),
        jnp.float32(map.grid.cell),
    )
    kernel = Climb(problem, jnp.float32(tolerance), max_steps)
    return Climbed(*run(kernel, starts, Engine(chunk=16, lanes=16) if engine is None else engine))


def _argument(function: Callable) -> Any:
    """A function as an argument of a compiled kernel: a module with its arrays traced, any other by its identity."""
    return _traced(function) if isinstance(function, eqx.Module) else jax.tree_util.Partial(function)


def _traced(module: Any) -> Any:
    """Its numbers as arrays, so that another value compiles nothing."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), module)
