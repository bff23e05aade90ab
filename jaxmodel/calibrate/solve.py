"""AX = XB by any method, for one set of motions or for thousands, with the verdict on what the motions determine."""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.calibrate.conclude import Solved, conclude, pair_residuals
from jaxmodel.calibrate.dual_quaternion import solve_dual_quaternion
from jaxmodel.calibrate.estimate import Estimate
from jaxmodel.calibrate.linear import solve_linear, solve_one_step
from jaxmodel.calibrate.loss import Loss, checked_loss
from jaxmodel.calibrate.nonlinear import QuaternionWeights, solve_nonlinear, solve_quaternion_penalty
from jaxmodel.calibrate.observability import Observability
from jaxmodel.calibrate.outcome import Outcome
from jaxmodel.calibrate.pairs import Pairs, make_pairs, pair_sums
from jaxmodel.calibrate.park import solve_park
from jaxmodel.calibrate.quaternion import solve_quaternion
from jaxmodel.calibrate.refine import residuals
from jaxmodel.calibrate.reweighting import reweighted
from jaxmodel.calibrate.rigid import checked_motions
from jaxmodel.calibrate.tsai_lenz import solve_tsai_lenz
from jaxmodel.calibrate.verdict import plainly_solved
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.geometry.masked import pad_rows, size_class

METHODS: dict[str, Callable[[Pairs, bool], Estimate]] = {
    "linear": solve_linear,
    "linear_one_step": solve_one_step,
    "tsai_lenz": solve_tsai_lenz,
    "dual_quaternion": solve_dual_quaternion,
    "park": solve_park,
    "quaternion": solve_quaternion,
    "nonlinear": solve_nonlinear,
    "nonlinear_b": partial(solve_nonlinear, noise_in="B"),
    "quaternion_penalty": lambda pairs, _: solve_quaternion_penalty(pairs, QuaternionWeights()),
}
KNOWN_SCALE_ONLY = ("quaternion_penalty",)


class Calibration(eqx.Module):
    """X of AX = XB and how far to trust it. X maps B's frame to A's: ``p_A = X p_B``.

    ``scale`` times A's translations is in the unit of B's (1 unless it was unknown, NaN where it is not determined).
    ``rotation_residuals`` (rad) and ``translation_residuals`` (unit of B) are those of AX - XB, one for each motion.
    ``weights`` are those that the motions were given times those of a robust loss. Where ``outcome`` is not SOLVED, X
    is one of the answers that ``observability`` describes, the translation without its free part.
    """

    X: Float[np.ndarray, "4 4"]
    scale: float
    outcome: Outcome
    method: str
    steps: int
    rotation_residuals: Float[np.ndarray, " n"]
    translation_residuals: Float[np.ndarray, " n"]
    weights: Float[np.ndarray, " n"]
    observability: Observability

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        observed = self.observability
        return observed.sentence if observed.outcome is self.outcome else self.outcome.sentence


class Calibrations(eqx.Module):
    """As ``Calibration``, for a batch; residuals of masked motions are NaN, ``outcome`` holds values of Outcome."""

    X: Float[np.ndarray, "b 4 4"]
    scale: Float[np.ndarray, " b"]
    outcome: Int[np.ndarray, " b"]
    method: str
    steps: Int[np.ndarray, " b"]
    rotation_residuals: Float[np.ndarray, "b n"]
    translation_residuals: Float[np.ndarray, "b n"]
    weights: Float[np.ndarray, "b n"]


def solve(
    A: Float[np.ndarray, "n 4 4"],
    B: Float[np.ndarray, "m 4 4"],
    method: str = "linear",
    unknown_scale: bool = False,
    weights: Float[np.ndarray, " k"] | None = None,
    loss: str = "none",
) -> Calibration:
    """X of ``A_i X = X B_i`` from motions A, B ``(n, 4, 4)``, float64; each is a motion in its own moving frame.

    ``unknown_scale``: A's translations are known up to one common factor (eq. 4.1), which is found too. Methods:
    ``linear`` (RR-3507 ch. 3), ``linear_one_step`` (eq. 3.12), ``tsai_lenz``, ``dual_quaternion``, ``park``,
    ``quaternion``, ``nonlinear`` (noise in A; ``nonlinear_b``: in B) and ``quaternion_penalty`` (§2.2.3). Any of them
    takes ``weights`` (inverse variances up to a factor) and a robust ``loss``, which weighs each motion by its
    residuals. From absolute poses prefer ``calibrate_poses``. Raises :class:`InputError` naming the row and its defect.
    One motion, or motions that leave something undetermined, give a partial answer with its verdict.
    """
    A, B = checked_motions(A, "A"), checked_motions(B, "B")
    if len(A) != len(B):
        raise InputError(f"A and B must hold one motion each per row, but A has {len(A)} rows and B has {len(B)}.")
    if len(A) == 0:
        raise InputError("A and B hold no motion; one is needed for a partial answer, two for a whole one.")
    weights = np.ones(len(A)) if weights is None else np.asarray(weights, np.float64)
    if weights.shape != (len(A),) or not np.isfinite(weights).all() or (weights < 0).any() or not weights.any():
        raise InputError(f"weights must be {len(A)} finite numbers >= 0, not all of them 0.")
    _check_method(method, unknown_scale)
    kind = checked_loss(loss)
    length = size_class(len(A), smallest=16)
    solved = _run(pad_rows(A, length)[None], pad_rows(B, length)[None], pad_rows(weights, length)[None], method,
                  unknown_scale, kind)  # fmt: skip
    weights = np.asarray(solved.weight[0, : len(A)])
    used = weights > 0
    row = _row(solved, 0, np.flatnonzero(used))
    X, scale, verdict, replaced = conclude(A[used], B[used], weights[used], row, unknown_scale)
    angle, distance = pair_residuals(A, B, X, 1.0 if np.isnan(scale) else scale)
    outcome = verdict.outcome
    if outcome is Outcome.SOLVED and not replaced and not bool(solved.estimate.converged[0]):
        outcome = Outcome.NOT_CONVERGED
    return Calibration(X, scale, outcome, method, int(solved.estimate.steps[0]), angle, distance, weights, verdict)


def solve_many(
    A: Float[np.ndarray, "*any"],
    B: Float[np.ndarray, "*other"],
    mask: Bool[np.ndarray, "b n"] | None = None,
    method: str = "linear",
    unknown_scale: bool = False,
    weights: Float[np.ndarray, "b n"] | None = None,
    verdict: bool = True,
    loss: str = "none",
) -> Calibrations:
    """``solve`` for a batch of problems ``(batch, n, 4, 4)``; ``mask`` says which motions of each are there.

    Nothing of one problem touches another: a problem with a NaN or without motions gets its own ``outcome``.
    ``verdict=False`` returns each method's answer as it is, with no look at what the motions determine.
    """
    A, B = np.asarray(A, np.float64), np.asarray(B, np.float64)
    if A.ndim != 4 or A.shape[2:] != (4, 4) or A.shape != B.shape:
        raise InputError(f"A and B must both be (batch, n, 4, 4), not {A.shape} and {B.shape}.")
    batch, n = A.shape[:2]
    _check_method(method, unknown_scale)
    kind = checked_loss(loss)
    weights = np.ones((batch, n)) if weights is None else np.asarray(weights, np.float64)
    mask = np.ones((batch, n), bool) if mask is None else np.asarray(mask, bool)
    if mask.shape != (batch, n) or weights.shape != (batch, n):
        raise InputError(f"mask and weights must be ({batch}, {n}), not {mask.shape} and {weights.shape}.")
    weights = np.where(mask, weights, 0.0)
    if batch == 0 or n == 0:
        empty = np.full((batch, n), np.nan)
        X, none = np.full((batch, 4, 4), np.nan), np.full(batch, int(Outcome.NO_MOTION))
        return Calibrations(X, np.full(batch, np.nan), none, method, np.zeros(batch, int), empty, empty, weights)
    solved = _run(A, B, weights, method, unknown_scale, kind)
    weights = np.asarray(solved.weight)
    estimate = solved.estimate
    X = se3.compose(estimate.R, estimate.t)
    scale, steps = np.array(estimate.scale), np.asarray(estimate.steps, int)
    outcome = np.where(estimate.converged, int(Outcome.SOLVED), int(Outcome.NOT_CONVERGED))
    used = weights > 0
    angle, distance = np.where(used, solved.angle, np.nan), np.where(used, solved.distance, np.nan)
    count = used.sum(axis=1)
    bad = ~np.asarray(solved.sound)
    none = ~bad & (count == 0)
    if verdict:
        squares = np.nansum(np.where(used, weights * angle**2, 0.0), axis=1)
        plain = plainly_solved(solved.rotation, solved.scatter_A, solved.scatter_B, squares, count)
        plain &= not unknown_scale
        for i in np.flatnonzero(~plain & ~bad & ~none).tolist():
            rows = np.flatnonzero(used[i])
            row = _row(solved, i, rows)
            X[i], scale[i], observed, _ = conclude(A[i, rows], B[i, rows], weights[i, rows], row, unknown_scale)
            angle[i, rows], distance[i, rows] = pair_residuals(
                A[i, rows], B[i, rows], X[i], 1.0 if np.isnan(scale[i]) else scale[i]
            )
            if outcome[i] == Outcome.SOLVED or observed.outcome is not Outcome.SOLVED:
                outcome[i] = int(observed.outcome)
    for rows, value in ((bad, Outcome.NOT_FINITE), (none, Outcome.NO_MOTION)):
        X[rows], scale[rows], outcome[rows] = np.nan, np.nan, int(value)
        angle[rows], distance[rows] = np.nan, np.nan
    return Calibrations(X, scale, outcome, method, steps, angle, distance, weights)


def _run(A: np.ndarray, B: np.ndarray, weights: np.ndarray, method: str, unknown_scale: bool, loss: Loss) -> Any:
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _kernel(method, unknown_scale, loss)(A, B, weights))


def _kernel(method: str, unknown_scale: bool, loss: Loss = "none") -> Any:
    return _compiled(method, unknown_scale, loss)


@lru_cache
def _compiled(method: str, unknown_scale: bool, loss: Loss) -> Any:
    def one(A: jax.Array, B: jax.Array, weight: jax.Array) -> Solved:
        pairs, sound = make_pairs(A, B, weight)
        estimate, pairs = reweighted(lambda weighted: METHODS[method](weighted, unknown_scale), pairs, loss)
        angle, distance = residuals(pairs, estimate)
        sums = pair_sums(pairs)
        eye = jnp.eye(3, dtype=weight.dtype)
        scatter = [
            jnp.einsum("n,nji,njk->ik", pairs.weight, excess, excess) for excess in (pairs.R_A - eye, pairs.R_B - eye)
        ]
        return Solved(estimate, angle, distance, pairs.weight, sums.rotation, scatter[0], scatter[1], sound)

    return jax.jit(jax.vmap(one))


def _row(solved: Any, index: int, rows: np.ndarray) -> Any:
    row = jax.tree.map(lambda leaf: leaf[index], solved)
    return eqx.tree_at(lambda s: (s.angle, s.distance), row, (row.angle[rows], row.distance[rows]))


def _check_method(method: str, unknown_scale: bool) -> None:
    if method not in METHODS:
        raise InputError(f"method must be one of {', '.join(METHODS)}, not {method!r}.")
    if unknown_scale and method in KNOWN_SCALE_ONLY:
        raise InputError(f"the method {method!r} has no unknown scale; use 'linear' or 'nonlinear'.")
