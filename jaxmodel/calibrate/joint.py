"""X and the fixed target's pose refined together from absolute poses, AX = ZB: each measurement counts once.

Pairs of poses count a pose many times and are correlated; this estimator reaches the Cramer-Rao bound and knows its
covariance. It is the recommended answer where absolute poses are given. With ``hand`` H_i and ``camera`` C_i it finds
X and Z of ``H_i X C_i = Z``; ``poses.py`` says what H, C, X and Z are in each set-up.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Bool, Float, Int

from jaxmodel.calibrate.loss import Loss, loss_slopes, loss_weights, robust_variance
from jaxmodel.calibrate.refine import turn
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.elimination import NormalEquations, inverse_positive
from jaxmodel.geometry.polar import nearest_rotation

Noise = Literal["camera", "depth", "hand"]
"""The stream that carries the noise; ``depth``: the camera, with a variance of its own along the line of sight."""
STAGES: dict[Loss, tuple[Loss, ...]] = {"none": ("none",), "huber": ("huber",), "tukey": ("huber", "tukey")}
ROUNDS = 20  # Gauss-Newton steps that also estimate the variances of rotation and translation
FEW = 5  # poses; fewer have one variance, of both kinds in the ratio that the start shows
MAX_STEPS = 60
ROUNDING = 1e-18


class Poses(eqx.Module):
    """Absolute poses of both streams, and a weight for each; 0: not there."""

    R_hand: Float[AnyArray, "*b n 3 3"]
    t_hand: Float[AnyArray, "*b n 3"]
    R_camera: Float[AnyArray, "*b n 3 3"]
    t_camera: Float[AnyArray, "*b n 3"]
    weight: Float[AnyArray, "*b n"]


class Pose(eqx.Module):
    R: Float[AnyArray, "*b 3 3"]
    t: Float[AnyArray, "*b 3"]


class JointSolution(eqx.Module):
    """X and Z of ``H X C = Z`` with the covariance of (rotation, translation) of X, then of Z, and scale.

    Errors are ``R <- exp(d) R`` (rad) and ``t <- t + e``. ``rotation_noise`` and ``translation_noise`` are the standard
    deviations of one component of the noisy stream, ``depth_noise`` that along the line of sight (the same unless it is
    apart); ``freedom`` the degrees of freedom of the least well known. ``weight``: what a robust loss makes of a pose.
    """

    X: Pose
    Z: Pose
    scale: Float[AnyArray, "*b"]
    covariance: Float[AnyArray, "*b 13 13"]
    rotation_noise: Float[AnyArray, "*b"]
    translation_noise: Float[AnyArray, "*b"]
    depth_noise: Float[AnyArray, "*b"]
    freedom: Float[AnyArray, "*b"]
    rotation_residuals: Float[AnyArray, "*b n"]
    translation_residuals: Float[AnyArray, "*b n"]
    influence: Float[AnyArray, "*b n"]
    weight: Float[AnyArray, "*b n"]
    steps: Int[AnyArray, "*b"]
    converged: Bool[AnyArray, "*b"]


class _Point(eqx.Module):
    X: Pose
    Z: Pose
    scale: Float[jax.Array, ""]

    def moved(self, tangent: Float[jax.Array, "13"]) -> "_Point":
        X = Pose(turn(tangent[0:3]) @ self.X.R, self.X.t + tangent[3:6])
        Z = Pose(turn(tangent[6:9]) @ self.Z.R, self.Z.t + tangent[9:12])
        return _Point(X, Z, self.scale * jnp.exp(tangent[12]))


def _residuals(poses: Poses, point: _Point, noise: Noise) -> list[jax.Array]:
    """Rotation (n, 9; norm = angle, rad) and translation (n, 3) errors of the noisy stream.

    With noise in the camera its pose is predicted as ``X^-1 H^-1 Z``, with noise in the hand as ``Z C^-1 X^-1``: the
    errors of rotation and translation then stay independent. The camera's given translations are ``1 / scale`` of the
    metric ones, and so are its errors. ``depth`` splits them: across the line of sight (n, 3), and along it (n, 1).
    """
    X, Z = point.X, point.Z
    root = jnp.sqrt(jnp.asarray(0.5, Z.t.dtype))
    n = poses.weight.shape[0]
    if noise == "hand":
        back = jnp.einsum("ij,nkj->nik", Z.R, poses.R_camera)  # Z C^-1
        R = jnp.einsum("nij,kj->nik", back, X.R)
        offset = point.scale * poses.t_camera + X.R.T @ X.t
        t = Z.t - jnp.einsum("nij,nj->ni", back, offset)
        return [root * (poses.R_hand - R).reshape(n, 9), poses.t_hand - t]
    toward = jnp.einsum("nji,jk->nik", poses.R_hand, Z.R)
    R = jnp.einsum("ji,njk->nik", X.R, toward)
    inner = jnp.einsum("nji,nj->ni", poses.R_hand, Z.t - poses.t_hand)
    rotation = root * (poses.R_camera - R).reshape(n, 9)
    error = poses.t_camera - (inner - X.t) @ X.R / point.scale
    if noise == "camera":
        return [rotation, error]
    distance = jnp.sqrt(jnp.sum(poses.t_camera**2, axis=1, keepdims=True))
    sight = jnp.where(distance > 0, poses.t_camera / jnp.where(distance > 0, distance, 1.0), jnp.eye(3)[2])
    along = jnp.sum(error * sight, axis=1, keepdims=True)
    return [rotation, error - along * sight, along]


def _stacked(residuals: list[jax.Array], weight: jax.Array, weights: Sequence[jax.Array]) -> jax.Array:
    """All residuals in a row, kind by kind: times the root of the pose's weight and the kind's own."""
    root = jnp.sqrt(weight)[:, None]
    return jnp.concatenate([(root * r).reshape(-1) * w for r, w in zip(residuals, weights, strict=True)])


def solve_joint(
    poses: Poses,
    X: Pose,
    Z: Pose,
    scale: Float[jax.Array, ""],
    noise: Noise = "camera",
    unknown_scale: bool = False,
    loss: Loss = "none",
) -> JointSolution:
    """Maximum likelihood from a start; one problem, batched by ``vmap``.

    The variances of rotation and translation are estimated together with X and Z (each from its own residuals and its
    own share of the unknowns), so no unit of length enters. A robust ``loss`` takes them from medians and weighs each
    pose by its residuals, iteratively; Tukey's begins where Huber's ends.
    """
    free = jnp.arange(13) < (13 if unknown_scale else 12)
    used = poses.weight > 0
    count = jnp.sum(used)
    reach = jnp.sum(poses.weight * jnp.sum(poses.t_camera**2, axis=1)) / jnp.maximum(jnp.sum(poses.weight), 1e-300)
    dimensions = (3, 2, 1) if noise == "depth" else (3, 3)
    floor = [ROUNDING, *(ROUNDING * (reach + 1e-300) for _ in dimensions[1:])]
    n = poses.weight.shape[0]
    ends = [9 * n, 12 * n] if noise == "depth" else [9 * n]

    def jacobian(point: _Point, weight: jax.Array, weights: Sequence[jax.Array]) -> jax.Array:
        def moved(d: jax.Array) -> jax.Array:
            return _stacked(_residuals(poses, point.moved(d), noise), weight, weights)

        return jnp.where(free, jax.jacfwd(moved)(jnp.zeros(13, reach.dtype)), 0.0)

    def variances(residuals: list[jax.Array], shares: Sequence[jax.Array], kind: Loss) -> list[jax.Array]:
        found = []
        for r, share, k, least in zip(residuals, shares, dimensions, floor, strict=True):
            squares = jnp.sum(r**2, axis=1)
            left = jnp.maximum(k * count - share, 1.0)
            if kind == "none":
                found.append(jnp.sum(poses.weight * squares) / left + least)
            else:
                found.append(robust_variance(jnp.sqrt(squares), used, k) * (k * count / left) + least)
        return found

    def settled(residuals: list[jax.Array], shares: Sequence[jax.Array], kind: Loss) -> list[jax.Array]:
        """Too few poses tell the variances apart no more, and one could vanish: theirs keep the start's ratio."""
        found = variances(residuals, shares, kind)
        squares = [jnp.sum(poses.weight * jnp.sum(r**2, axis=1)) for r in residuals]
        common = sum(s / v for s, v in zip(squares, begun, strict=True)) / jnp.maximum(6 * count - sum(shares), 1.0)
        floored = [common * v + least for v, least in zip(begun, floor, strict=True)]
        return [jnp.where(count < FEW, one, other) for one, other in zip(floored, found, strict=True)]

    def sizes(residuals: list[jax.Array], variance: list[jax.Array]) -> jax.Array:
        return jnp.sqrt(sum(jnp.sum(r**2, axis=1) / v for r, v in zip(residuals, variance, strict=True)) / 6)

    def descend(point: _Point, weights: Sequence[jax.Array]) -> tuple[_Point, jax.Array, jax.Array]:
        # curvature of about 1e4, so that the solver's first damping (1) is a small one
        unit = 100.0 / (weights[0] * jnp.sqrt(jnp.maximum(jnp.sum(poses.weight), 1.0)))
        scaled = [w * unit for w in weights]
        solution = optx.least_squares(
            lambda d, p: _stacked(_residuals(poses, p.moved(jnp.where(free, d, 0.0)), noise), poses.weight, scaled),
            optx.LevenbergMarquardt(rtol=1e-5, atol=1e-5, linear_solver=NormalEquations()),
            jnp.zeros(13, reach.dtype),
            args=point,
            max_steps=MAX_STEPS,
            throw=False,
        )
        moved = point.moved(jnp.where(free, solution.value, 0.0))
        steps = solution.stats["num_steps"].astype(jnp.int32)
        return moved, steps, solution.result == optx.RESULTS.successful

    def polish(kind: Loss) -> Callable[[jax.Array, tuple], tuple]:
        def step(_: jax.Array, carry: tuple) -> tuple:
            """A Gauss-Newton step, then the variances anew, each with its own share of the unknowns."""
            point, shares = carry
            residuals = _residuals(poses, point, noise)
            variance = settled(residuals, shares, kind)
            weights = [v**-0.5 for v in variance]
            weight = poses.weight * loss_weights(sizes(residuals, variance), kind)
            rows = jacobian(point, weight, weights)
            parts = [part.T @ part for part in jnp.split(rows, ends)]
            inverse = inverse_positive(sum(parts) + jnp.diag(jnp.where(free, 0.0, 1.0)))
            step = -inverse @ (rows.T @ _stacked(residuals, weight, weights))
            return point.moved(jnp.where(free, step, 0.0)), [jnp.sum(inverse * part) for part in parts]

        return step

    shares = [jnp.asarray(2.0 * k, reach.dtype) for k in dimensions]
    first = _Point(X, Z, scale)
    begun = variances(_residuals(poses, first, noise), shares, "none")
    point, steps, converged = descend(first, [v**-0.5 for v in begun])
    for kind in STAGES[loss]:
        point, shares = jax.lax.fori_loop(0, ROUNDS, polish(kind), (point, shares))
    residuals = _residuals(poses, point, noise)
    variance = settled(residuals, shares, loss)
    weights, size = [v**-0.5 for v in variance], sizes(residuals, variance)
    robust = loss_weights(size, loss)
    whole = jacobian(point, poses.weight, weights)
    covariance = inverse_positive(whole.T @ whole + jnp.diag(jnp.where(free, 0.0, 1.0)))
    covariance = jnp.where(free[:, None] & free[None, :], covariance, 0.0)
    if loss != "none":  # Huber 1981, §7.6: mean square of psi over the square of its mean slope
        square, slope = (jnp.sum(jnp.where(used, f, 0.0)) / jnp.maximum(count, 1)
                         for f in ((robust * size) ** 2, loss_slopes(size, loss)))  # fmt: skip
        covariance *= square / jnp.maximum(slope, 1e-3) ** 2 * count / jnp.maximum(count - 2, 1)
    # how far each pose alone moves X, in standard deviations: Cook's distance over the six unknowns of X
    pulls = (whole @ covariance * _stacked(residuals, poses.weight * robust**2, weights)[:, None])[:, :6]
    per_pose = sum(part.reshape(n, -1, 6).sum(axis=1) for part in jnp.split(pulls, ends))
    information = inverse_positive(covariance[:6, :6])
    influence = jnp.sqrt(jnp.maximum(jnp.einsum("ni,ij,nj->n", per_pose, information, per_pose) / 6, 0.0))
    translations = sum(k * v for k, v in zip(dimensions[1:], variance[1:], strict=True)) / 3
    left = jnp.stack([k * count - share for k, share in zip(dimensions, shares, strict=True)])
    return JointSolution(
        point.X,
        point.Z,
        point.scale,
        covariance,
        jnp.sqrt(variance[0]),
        jnp.sqrt(translations),
        jnp.sqrt(variance[-1]),
        jnp.where(count < FEW, jnp.sum(left), jnp.min(left)),
        jnp.sqrt(jnp.sum(residuals[0] ** 2, axis=1)),
        jnp.sqrt(sum(jnp.sum(r**2, axis=1) for r in residuals[1:])),
        influence,
        robust,
        steps,
        converged,
    )


@lru_cache
def kernel(noise: Noise, unknown_scale: bool, loss: Loss = "none") -> Any:
    """``solve_joint`` compiled for a batch: (poses, X, Z, scale), each with a leading axis."""
    return jax.jit(jax.vmap(lambda poses, X, Z, scale: solve_joint(poses, X, Z, scale, noise, unknown_scale, loss)))


def target_from(poses: Poses, X: Pose) -> Pose:
    """The Z that suits an X best: rotation and translation averaged over the poses (host or kernel)."""
    R = jnp.einsum("n,nij,jk,nkl->il", poses.weight, poses.R_hand, X.R, poses.R_camera)
    t = jnp.einsum("nij,nj->ni", poses.R_hand, poses.t_camera @ X.R.T + X.t) + poses.t_hand
    total = jnp.sum(poses.weight)
    return Pose(nearest_rotation(R), poses.weight @ t / jnp.where(total > 0, total, 1.0))
