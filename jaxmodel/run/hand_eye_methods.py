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
from jaxmodel.calibrate.nonlinear import QuaternionWeights, solve_quaternion_penalty
from jaxmodel.calibrate.pairs import make_pairs
from jaxmodel.geometry import se3

PUBLISHED = ("axis/angle", "dual quaternions", "nonlinear", "linear")
"""Methods 1 to 4 of the report's figures and tables."""
OURS = ("linear, one step", "nonlinear on the group")
FROM_IDENTITY = "nonlinear from the identity"
_SOLVERS = {
    "axis/angle": "tsai_lenz",
    "dual quaternions": "dual_quaternion",
    "nonlinear": "quaternion_penalty",
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
    if method == FROM_IDENTITY:
        weights = np.ones(A.shape[:2]) if mask is None else mask.astype(np.float64)
        with jax.enable_x64(True):
            R, t = jax.tree.map(np.asarray, _from_identity()(A, B, weights))
        return se3.compose(R, t), np.ones(len(A))
    found = solve_many(A, B, mask, _SOLVERS[method], unknown_scale, verdict=False)
    return found.X, found.scale


@lru_cache
def _from_identity() -> Callable[..., Any]:
    def one(A: jax.Array, B: jax.Array, weight: jax.Array) -> tuple[jax.Array, jax.Array]:
        start = Estimate(jnp.eye(3, dtype=A.dtype), jnp.zeros(3, A.dtype), jnp.ones((), A.dtype))
        found = solve_quaternion_penalty(make_pairs(A, B, weight)[0], WEIGHTS, start)
        return found.R, found.t

    return jax.jit(jax.vmap(one))


class Stopwatch:
    """Runs a method on batches and says what one problem took, compilation left out."""

    def __init__(self) -> None:
        self._compiled: set[tuple[Any, ...]] = set()

    def run(
        self, methods: Sequence[str], A: np.ndarray, B: np.ndarray, mask: np.ndarray | None = None
    ) -> Mapping[str, tuple[np.ndarray, float]]:
        """Method -> X of each problem, and seconds a problem."""
        found = {}
        for method in methods:
            shape = method, A.shape, mask is None
            if shape not in self._compiled:
                solved(method, A, B, mask)
                self._compiled.add(shape)
            begun = time.perf_counter()
            X, _ = solved(method, A, B, mask)
            found[method] = X, (time.perf_counter() - begun) / len(A)
        return found
