"""Many starts of one registration through the lane engine, and single registrations as sweeps of one."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.geometry.se3 import are_rigid, quaternion_to_rotation, rotation_to_quaternion
from jaxmodel.lanes import Engine, jit_kernel, run_chunks
from jaxmodel.register.icp import Icp, IcpResult, Pose
from jaxmodel.register.method import IcpMethod
from jaxmodel.register.methods import resolve
from jaxmodel.register.outcome import Outcome
from jaxmodel.register.problem import Frames, Problem, Views, prepare


class Registration(eqx.Module):
    """One registration. ``error``: mean distance of the kept pairs, unit of the data; ``start``: its number."""

    T_target_source: Float[np.ndarray, "4 4"]
    error: float
    matched_fraction: float
    shared_rate: float
    steps: int
    switch_1: int
    switch_2: int
    increases: int
    outcome: Outcome
    start: int = 0

    def __index__(self) -> int:
        return self.start


class Sweep(eqx.Module):
    """Results in start order. Errors in the unit of the data; ``outcome`` holds ``Outcome`` values."""

    T_target_source: Float[np.ndarray, "s 4 4"]
    error: Float[np.ndarray, " s"]
    matched_fraction: Float[np.ndarray, " s"]
    shared_rate: Float[np.ndarray, " s"]
    steps: Int[np.ndarray, " s"]
    switch_1: Int[np.ndarray, " s"]
    switch_2: Int[np.ndarray, " s"]
    increases: Int[np.ndarray, " s"]
    outcome: Int[np.ndarray, " s"]

    def __len__(self) -> int:
        return len(self.error)

    def registration(self, start: int) -> Registration:
        """The registration that began at one start."""
        values = {field: getattr(self, field)[start] for field in self.__dataclass_fields__}
        pose, outcome = values.pop("T_target_source"), Outcome(int(values.pop("outcome")))
        plain: dict[str, Any] = {name: value.item() for name, value in values.items()}
        return Registration(T_target_source=pose, outcome=outcome, start=int(start), **plain)

    @property
    def best(self) -> Registration:
        """Lowest error among the starts whose matched fraction is at least half of the sweep's largest."""
        eligible = self.matched_fraction >= 0.5 * self.matched_fraction.max()
        return self.registration(int(np.argmin(np.where(eligible, self.error, np.inf))))


def sweep(
    target: Views,
    source: Views,
    starts: Float[np.ndarray, "s 4 4"],
    method: str | IcpMethod = "thesis_2005",
    lanes: int | None = None,
    chunk: int = 256,
    engine: Engine | None = None,
) -> Sweep:
    """Register ``source`` to ``target`` from every start.

    ``target`` and ``source`` are ``(n, 3)`` arrays, clouds or range images in one unit; ``starts`` are ``(s, 4, 4)``
    poses T_target_source; ``method`` is the name of a file in configs/methods or an ``IcpMethod``. ``lanes`` chooses
    the lane executor with that many lanes; by default each CPU core works through its own starts. All points given are
    used: choose control points first (``jaxmodel.control_points.select``). Raises ``InputError`` for input that cannot
    be registered.
    """
    count = len(np.asarray(starts))
    parts = list(sweep_chunks(target, source, starts, method, lanes, chunk, engine=engine))
    if len(parts) == 1:
        return parts[0][2]
    order = np.argsort(np.concatenate([members for _, members, _ in parts]))
    assert len(order) == count
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[order], *(part for _, _, part in parts))


def sweep_chunks(
    target: Views,
    source: Views,
    starts: Float[np.ndarray, "s 4 4"],
    method: str | IcpMethod = "thesis_2005",
    lanes: int | None = None,
    chunk: int = 256,
    order: Int[np.ndarray, " s"] | None = None,
    skip: frozenset[int] = frozenset(),
    engine: Engine | None = None,
) -> Iterator[tuple[int, Int[np.ndarray, " c"], Sweep]]:
    """As ``sweep``, chunk by chunk as they are done: chunk number, its starts, their results.

    ``order`` permutes the starts before they are cut into chunks; ``skip`` leaves out chunks already done. A start's
    result does not depend on either.
    """
    method = resolve(method)
    engine = engine or Engine("cores" if lanes is None else "lanes", lanes=256 if lanes is None else lanes, chunk=chunk)
    if lanes is None and engine.executor == "auto":
        engine = Engine(engine.resolved(), engine.lanes, engine.chunk, engine.steps_per_round)
    starts = check_starts(starts)
    yield from sweep_prepared(prepare(target, source, method), starts, method, engine, order, skip)


def sweep_prepared(
    prepared: tuple[Problem, Frames],
    starts: Float[np.ndarray, "s 4 4"],
    method: IcpMethod,
    engine: Engine,
    order: Int[np.ndarray, " s"] | None = None,
    skip: frozenset[int] = frozenset(),
) -> Iterator[tuple[int, Int[np.ndarray, " c"], Sweep]]:
    """As ``sweep_chunks``, on a pair made ready by ``problem.prepare`` for this ``method``.

    For several sweeps of one pair, or to time the making of the voxel tables apart.
    """
    starts = check_starts(starts)
    if method.fit == "svd" and engine.resolved() == "cores":
        # LAPACK inside sharded loops can hang on CPU (see geometry/eigen.py): run the same method on lanes
        engine = Engine("lanes", engine.lanes, engine.chunk, engine.steps_per_round)
    problem, frames = prepared
    R, t = frames.to_centred(starts)
    for number, members, result in run_chunks(Icp(problem, method), Pose(R, t), engine, order, skip):
        yield number, members, _collected(result, frames)


def register(
    target: Views,
    source: Views,
    init: Float[np.ndarray, "4 4"] | None = None,
    method: str | IcpMethod = "thesis_2005",
) -> Registration:
    """One registration from ``init`` (T_target_source; default: the two scans share a frame already)."""
    start = np.eye(4) if init is None else np.asarray(init, np.float64)
    return sweep(target, source, start[None], method, chunk=len(jax.devices())).registration(0)


class Trace(eqx.Module):
    """One row per iteration (thesis fig. 2.23): values at the pairing, before that iteration's fit."""

    error: Float[np.ndarray, " k"]
    matched_fraction: Float[np.ndarray, " k"]
    shared_rate: Float[np.ndarray, " k"]
    strategy: Int[np.ndarray, " k"]
    T_target_source: Float[np.ndarray, "k 4 4"]


def register_trace(
    target: Views,
    source: Views,
    init: Float[np.ndarray, "4 4"] | None = None,
    method: str | IcpMethod = "thesis_2005",
) -> tuple[Registration, Trace]:
    """As ``register``, with the history of the iterations; slower, for plots and for looking into a failure."""
    method = resolve(method)
    start = check_starts((np.eye(4) if init is None else np.asarray(init, np.float64))[None])
    problem, frames = prepare(target, source, method)
    R, t = frames.to_centred(start)
    kernel = Icp(problem, method)
    final, rows = _traced(kernel.reorders_sums)(kernel, Pose(R[0], t[0]), int(method.max_iterations))
    taken = int(final.steps)
    history = jax.tree.map(lambda a: np.asarray(a)[:taken], rows)
    registration = _collected(jax.tree.map(lambda a: np.asarray(a)[None], final), frames).registration(0)
    poses = frames.from_centred(_orthonormal(history["pose"].rotation), history["pose"].translation)
    return registration, Trace(
        history["error"], history["matched_fraction"], history["shared_rate"], history["strategy"], poses
    )


@lru_cache
def _traced(reorder: bool) -> Any:
    return jit_kernel(_run_traced, reorder, static_argnums=2)


def _run_traced(kernel: Icp, start: Pose, length: int) -> tuple[IcpResult, dict]:
    def body(state, _):
        following = jax.tree.map(lambda new, old: jnp.where(kernel.done(state), old, new), kernel.step(state), state)
        row = {
            "error": following.error,
            "matched_fraction": following.matched_fraction,
            "shared_rate": kernel.shared_rate(state.pose, state.clusters),
            "strategy": state.strategy,
            "pose": state.pose,
        }
        return following, row

    state, rows = jax.lax.scan(body, kernel.init(start), None, length)
    return kernel.finish(state), rows


def check_starts(starts: Float[np.ndarray, "s 4 4"]) -> Float[np.ndarray, "s 4 4"]:
    """Starts as float64, or ``InputError`` naming the first one that is not a rigid motion."""
    poses = np.asarray(starts, np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or len(poses) == 0:
        raise InputError(f"starts must be (s, 4, 4) with s at least 1, not {poses.shape}")
    rigid = np.concatenate([are_rigid(poses[first : first + 4096]) for first in range(0, len(poses), 4096)])
    if not rigid.all():
        number = int(np.argmin(rigid))
        raise InputError(f"start {number} is not a rigid motion (a proper rotation and a finite translation)")
    return poses


def _orthonormal(R: Float[np.ndarray, "s 3 3"]) -> Float[np.ndarray, "s 3 3"]:
    return quaternion_to_rotation(rotation_to_quaternion(R))


def _collected(result: IcpResult, frames: Frames) -> Sweep:
    R, t = np.asarray(result.pose.rotation), np.asarray(result.pose.translation)
    finite = np.all(np.isfinite(R), axis=(1, 2)) & np.all(np.isfinite(t), axis=1)
    R = np.where(finite[:, None, None], R, np.eye(3))
    poses = frames.from_centred(_orthonormal(R), t)
    return Sweep(
        T_target_source=np.where(finite[:, None, None], poses, np.nan),
        error=np.asarray(result.error, np.float64),
        matched_fraction=np.asarray(result.matched_fraction, np.float64),
        shared_rate=np.asarray(result.shared_rate, np.float64),
        steps=np.asarray(result.steps),
        switch_1=np.asarray(result.switches[:, 0]),
        switch_2=np.asarray(result.switches[:, 1]),
        increases=np.asarray(result.increases),
        outcome=np.asarray(result.outcome),
    )
