"""Weighted closed-form rigid fits: three methods, one contract (thesis §2.6 and annex A, with its misprints corrected).

All minimise ``sum_i w_i |target_i - (R source_i + t)|^2`` (eq. 2.1). ``svd`` is Arun et al. 1987 as the thesis used it,
with the reflection repaired per problem; ``quaternion`` is Horn 1987 (§2.6.3) without LAPACK, fast enough for the inner
loop of a sweep; ``dual_quaternion`` is Walker, Shao and Volz 1991 (§2.6.2). They agree to rounding.
"""

from enum import IntEnum
from functools import partial
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float, Int

from jaxmodel.geometry.eigen import largest_eigenvector

Method = Literal["svd", "quaternion", "dual_quaternion"]


class FitOutcome(IntEnum):
    """How a rigid fit ended."""

    OK = 0
    EMPTY = 1
    NOT_FINITE = 2
    COINCIDENT = 3
    COLLINEAR = 4

    @property
    def sentence(self) -> str:
        return {
            FitOutcome.OK: "the fit is unique",
            FitOutcome.EMPTY: "no pair carries weight, so nothing is determined",
            FitOutcome.NOT_FINITE: "a pair that carries weight is not finite",
            FitOutcome.COINCIDENT: "all points of a set coincide, so the rotation is not determined",
            FitOutcome.COLLINEAR: "the points lie on a line, so a rotation about it is not determined",
        }[self]


class RigidFit(eqx.Module):
    """``T_target_source`` is usable only where ``outcome`` is OK; elsewhere it is NaN."""

    T_target_source: Float[jax.Array, "4 4"]
    outcome: Int[jax.Array, ""]


class Moments(eqx.Module):
    """Weighted first and second moments of paired points: all a fit needs to know of them."""

    weight: Float[jax.Array, ""]
    source_mean: Float[jax.Array, "3"]
    target_mean: Float[jax.Array, "3"]
    covariance: Float[jax.Array, "3 3"]  # sum w (source - mean) (target - mean)^T / sum w


def quaternion_from_moments(moments: Moments) -> tuple[Float[jax.Array, "4"], Float[jax.Array, ""]]:
    """Rotation as a unit quaternion (w, x, y, z) and its uniqueness (see ``largest_eigenvector``): Horn's method."""
    S = moments.covariance
    delta = jnp.stack([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])  # [D23 D31 D12], eq. 2.37 corrected
    trace = jnp.trace(S)
    N = jnp.block([[trace[None, None], delta[None, :]], [delta[:, None], S + S.T - trace * jnp.eye(3, dtype=S.dtype)]])
    return largest_eigenvector(N)


def rotation_from_quaternion(quaternion: Float[jax.Array, "4"]) -> Float[jax.Array, "3 3"]:
    """Rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return jnp.stack(
        [
            jnp.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]),
            jnp.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]),
            jnp.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]),
        ]
    )


def _fit_quaternion(moments: Moments) -> tuple[jax.Array, jax.Array]:
    quaternion, _ = quaternion_from_moments(moments)
    R = rotation_from_quaternion(quaternion)
    return R, moments.target_mean - R @ moments.source_mean


def _fit_svd(moments: Moments) -> tuple[jax.Array, jax.Array]:
    U, _, Vt = jnp.linalg.svd(moments.covariance)
    sign = jnp.where(jnp.linalg.det(Vt.T @ U.T) < 0, -1.0, 1.0).astype(U.dtype)
    R = (Vt.T * jnp.stack([jnp.ones_like(sign), jnp.ones_like(sign), sign])) @ U.T  # eq. 2.12, never a reflection
    return R, moments.target_mean - R @ moments.source_mean


def _skew_basis() -> np.ndarray:
    K = np.zeros((3, 3, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        K[a, c, b], K[a, b, c] = 1.0, -1.0
    return K


def _quaternion_matrices(sign: float) -> np.ndarray:
    """``M[a]`` such that ``sum_a v_a M[a]`` is Q(v) (sign +1) or W(v) (sign -1) of Walker et al., order x, y, z, w."""
    M = np.zeros((3, 4, 4))
    M[:, :3, :3] = sign * _skew_basis()
    for a in range(3):
        M[a, a, 3], M[a, 3, a] = 1.0, -1.0
    return M


_Q, _W = _quaternion_matrices(1.0), _quaternion_matrices(-1.0)


def _fit_dual_quaternion(moments: Moments) -> tuple[jax.Array, jax.Array]:
    # §2.6.2 keeps the translation inside the problem: second moments about the target's mean alone, not the source's
    dtype = moments.covariance.dtype
    Q, W = jnp.asarray(_Q, dtype), jnp.asarray(_W, dtype)
    offset = moments.source_mean - moments.target_mean
    # Walker et al. with half coordinates x = source / 2, y = target / 2, divided by the total weight
    C1 = -0.5 * jnp.einsum("ab,bji,ajk->ik", moments.covariance, Q, W)
    C3 = jnp.einsum("a,aij->ij", offset, W)
    # A = (C3^T C3 / 2 - C1 - C1^T) / 2, but C3^T C3 = |offset|^2 I moves all eigenvalues alike, and would drown the
    # rest in its rounding where the sets are far apart
    A = -0.5 * (C1 + C1.T)
    r, _ = largest_eigenvector(A)
    s = -0.5 * (C3 @ r)  # dual part of the unit dual quaternion
    vector, scalar = r[:3], r[3]
    K = jnp.einsum("a,aij->ij", vector, jnp.asarray(_skew_basis(), dtype))
    R = (scalar**2 - vector @ vector) * jnp.eye(3, dtype=dtype) + 2 * jnp.outer(vector, vector) + 2 * scalar * K
    W_of_r = jnp.einsum("a,aij->ij", vector, W) + scalar * jnp.eye(4, dtype=dtype)
    shift = 2 * (W_of_r.T @ s)[:3]  # translation in coordinates centred on the target's mean
    return R, shift + moments.target_mean - R @ moments.target_mean


METHODS = {"svd": _fit_svd, "quaternion": _fit_quaternion, "dual_quaternion": _fit_dual_quaternion}


def weighted_moments(
    source: Float[jax.Array, "n 3"], target: Float[jax.Array, "n 3"], weights: Float[jax.Array, " n"]
) -> Moments:
    """Moments by two passes: exact to rounding however far from the origin the points are."""
    total = jnp.sum(weights)
    share = weights / jnp.where(total > 0, total, 1.0)
    source_mean, target_mean = share @ source, share @ target
    covariance = (share[:, None] * (source - source_mean)).T @ (target - target_mean)
    return Moments(total, source_mean, target_mean, covariance)


def rigid_fit(
    source: Float[jax.Array, "n 3"],
    target: Float[jax.Array, "n 3"],
    weights: Float[jax.Array, " n"] | None = None,
    mask: Bool[jax.Array, " n"] | None = None,
    method: Method = "svd",
) -> RigidFit:
    """The fit as a kernel: one problem, batched by ``vmap``; it reports degenerate input instead of raising.

    Masked entries and entries of weight zero may hold anything, NaN included. Precision is that of the arguments.
    """
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    weights = jnp.ones(source.shape[0], source.dtype) if weights is None else weights.astype(source.dtype)
    used = (weights != 0) if mask is None else mask & (weights != 0)
    finite = jnp.all(jnp.where(used[:, None], jnp.isfinite(source) & jnp.isfinite(target), True))
    finite &= jnp.all(jnp.where(used, jnp.isfinite(weights) & (weights >= 0), True))
    clean = used & finite
    weights = jnp.where(clean, weights, 0.0)
    source, target = jnp.where(clean[:, None], source, 0.0), jnp.where(clean[:, None], target, 0.0)
    moments = weighted_moments(source, target, weights)
    outcome = _diagnose(source, target, weights, moments)
    outcome = jnp.where(finite, outcome, FitOutcome.NOT_FINITE)
    R, t = METHODS[method](moments)
    T = jnp.concatenate([jnp.concatenate([R, t[:, None]], 1), jnp.eye(4, dtype=R.dtype)[3:]])
    return RigidFit(jnp.where(outcome == FitOutcome.OK, T, jnp.nan), outcome.astype(jnp.int32))


def _diagnose(source: jax.Array, target: jax.Array, weights: jax.Array, moments: Moments) -> jax.Array:
    epsilon = jnp.finfo(source.dtype).eps
    share = weights / jnp.where(moments.weight > 0, moments.weight, 1.0)

    def spread(points: jax.Array, mean: jax.Array) -> tuple[jax.Array, jax.Array]:
        scatter = (share[:, None] * (points - mean)).T @ (points - mean)
        total = jnp.trace(scatter)
        # sum of the 2 x 2 principal minors = products of pairs of eigenvalues: zero for a line
        minors = 0.5 * (total**2 - jnp.sum(scatter * scatter))
        reach = jnp.max(jnp.where(weights[:, None] > 0, jnp.abs(points), 0.0), initial=0.0)
        rounding = (16 * epsilon * reach) ** 2
        return total <= rounding, minors <= jnp.maximum(16 * epsilon * total**2 * epsilon, 4 * rounding * total)

    source_point, source_line = spread(source, moments.source_mean)
    target_point, target_line = spread(target, moments.target_mean)
    _, alone = quaternion_from_moments(moments)
    outcome = jnp.where(source_line | target_line | (alone < 0.999), FitOutcome.COLLINEAR, FitOutcome.OK)
    outcome = jnp.where(source_point | target_point, FitOutcome.COINCIDENT, outcome)
    return jnp.where(moments.weight > 0, outcome, FitOutcome.EMPTY)


def fit_rigid(source, target, weights=None, method: Method = "svd"):
    """The rigid motion that brings ``source`` onto ``target`` in the weighted least-squares sense.

    ``source`` and ``target`` are ``(n, 3)`` in one unit, paired row by row; ``weights`` is ``(n,)``, non-negative.
    Returns ``T_target_source`` (4, 4). NumPy float64 input is computed in float64 and comes back as NumPy float64.
    Raises ``ValueError`` with a sentence when the motion is not determined (empty, one point, collinear) or the input
    is not finite. Inside ``jit`` or ``vmap`` nothing can be raised: such a problem then gives NaN.
    """
    arrays = [source, target] if weights is None else [source, target, weights]
    if any(isinstance(a, Tracer) for a in arrays):
        return rigid_fit(source, target, weights, method=method).T_target_source
    single = all(getattr(a, "dtype", None) == np.float32 for a in (source, target))
    dtype = np.float32 if single else np.float64
    p, q = np.asarray(source, dtype), np.asarray(target, dtype)
    if p.ndim != 2 or p.shape[1] != 3 or p.shape != q.shape:
        raise ValueError(f"source and target must both be (n, 3), not {p.shape} and {q.shape}")
    w = np.ones(len(p), dtype) if weights is None else np.asarray(weights, dtype)
    if w.shape != (len(p),):
        raise ValueError(f"weights must be ({len(p)},), one for each pair, not {w.shape}")
    with jax.enable_x64(dtype == np.float64):
        fit = _fit_jit(p, q, w, method)
        T, outcome = np.asarray(fit.T_target_source), FitOutcome(int(fit.outcome))
    if outcome is not FitOutcome.OK:
        raise ValueError(f"cannot fit a rigid motion: {outcome.sentence}")
    return T


@partial(jax.jit, static_argnums=3)
def _fit_jit(source, target, weights, method):
    return rigid_fit(source, target, weights, method=method)
