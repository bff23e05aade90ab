"""The methods that RR-3507 compares, by its numbers and names, and ours beside them: X of whole batches."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.calibrate import solve_many
from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import solve_linear
from jaxmodel.calibrate.nonlinear import QuaternionWeights, solve_quaternion_penalty
from jaxmodel.calibrate.pairs import make_pairs
from jaxmodel.calibrate.tsai_lenz import solve_tsai_lenz
from jaxmodel.geometry import se3

PUBLISHED = ("axis/angle", "dual quaternions", "nonlinear", "linear")
"""Methods 1 to 4 of the report's figures and tables."""
OURS = ("linear, one step", "nonlinear on the group")
FROM_IDENTITY = "nonlinear from the identity"
UNIT_AXES = "axis/angle with unit axes"
"""As eq. 2.1 is printed; Tsai and Lenz weight their axes by 2 sin(angle / 2), and so does "axis/angle" here."""
_SOLVERS = {
    "axis/angle": "tsai_lenz",
    "dual quaternions": "dual_quaternion",
    "linear": "linear",
    "linear, one step": "linear_one_step",
    "nonlinear on the group": "nonlinear",
}
WEIGHTS = QuaternionWeights()
SENTENCE = (
    f"nonlinear: §2.2.3 with lambda_1 = {WEIGHTS.axes:g}, lambda_2 = {WEIGHTS.translations:g}, lambda = "
    f"{WEIGHTS.penalty:g}, started from the linear solution (the report states neither weights nor start)"
)


def solved(
    method: str,
    A: Float[np.ndarray, "b n 4 4"],
    B: Float[np.ndarray, "b n 4 4"],
    mask: Bool[np.ndarray, "b n"] | None = None,
    unknown_scale: bool = False,
) -> tuple[Float[np.ndarray, "b 4 4"], Float[np.ndarray, " b"]]:
    """X of AX = XB and the scale of each problem, as the method has them: no verdict."""
    if method in ("nonlinear", FROM_IDENTITY):
        return solved_by_penalty(A, B, mask, WEIGHTS, method == FROM_IDENTITY), np.ones(len(A))
    if method == UNIT_AXES:
        with jax.enable_x64(True):
            R, t = jax.tree.map(np.asarray, _unit_axes()(A, B, _used(A, mask)))
        return se3.compose(R, t), np.ones(len(A))
    found = solve_many(A, B, mask, _SOLVERS[method], unknown_scale, verdict=False)
    return found.X, found.scale


def solved_by_penalty(
    A: Float[np.ndarray, "b n 4 4"],
    B: Float[np.ndarray, "b n 4 4"],
    mask: Bool[np.ndarray, "b n"] | None,
    weights: QuaternionWeights,
    from_identity: bool,
) -> Float[np.ndarray, "b 4 4"]:
    """X by §2.2.3 under the given weights, started from the linear solution or from the identity."""
    with jax.enable_x64(True):
        given = jax.tree.map(np.float64, weights)
        R, t = jax.tree.map(np.asarray, _penalty()(A, B, _used(A, mask), given, np.float64(from_identity)))
    return se3.compose(R, t)


def _used(A: Float[np.ndarray, "b n 4 4"], mask: Bool[np.ndarray, "b n"] | None) -> Float[np.ndarray, "b n"]:
    return np.ones(A.shape[:2]) if mask is None else mask.astype(np.float64)


@lru_cache
def _unit_axes() -> Callable[..., Any]:
    def one(A: jax.Array, B: jax.Array, used: jax.Array) -> tuple[jax.Array, jax.Array]:
        found = solve_tsai_lenz(make_pairs(A, B, used)[0], unit_axes=True)
        return found.R, found.t

    return jax.jit(jax.vmap(one))


@lru_cache
def _penalty() -> Callable[..., Any]:
    """One program for all weights and both starts."""

    def one(
        A: jax.Array, B: jax.Array, used: jax.Array, weights: QuaternionWeights, from_identity: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        pairs = make_pairs(A, B, used)[0]
        identity = Estimate(jnp.eye(3, dtype=A.dtype), jnp.zeros(3, A.dtype), jnp.ones((), A.dtype))
        linear = solve_linear(pairs)
        start = jax.tree.map(lambda a, b: jnp.where(from_identity > 0, a, b), identity, linear)
        found = solve_quaternion_penalty(pairs, weights, start)
        return found.R, found.t

    return jax.jit(jax.vmap(one, in_axes=(0, 0, 0, None, None)))


def all_solved(
    methods: Sequence[str], A: np.ndarray, B: np.ndarray, mask: np.ndarray | None = None
) -> Mapping[str, np.ndarray]:
    """Method -> X of each problem."""
    return {method: solved(method, A, B, mask)[0] for method in methods}


class Stopwatch:
    """Runs a method on batches and says what one problem took of the processor, compilation left out."""

    def __init__(self) -> None:
        self._compiled: set[tuple[Any, ...]] = set()

    def run(self, methods: Sequence[str], A: np.ndarray, B: np.ndarray) -> Mapping[str, tuple[np.ndarray, float]]:
        """Method -> X of each problem, and processor seconds a problem."""
        found = {}
        for method in methods:
            shape = method, A.shape
            if shape not in self._compiled:
                solved(method, A, B)
                self._compiled.add(shape)
            begun = time.process_time()
            X, _ = solved(method, A, B)
            found[method] = X, (time.process_time() - begun) / len(A)
        return found
