"""X and the fixed target's pose refined together from absolute poses, AX = ZB: each measurement counts once.

Pairs of poses count a pose many times and are correlated; this estimator reaches the Cramer-Rao bound and knows its
covariance. It is the recommended answer where absolute poses are given. With ``hand`` H_i and ``camera`` C_i it finds
X and Z of ``H_i X C_i = Z``; ``poses.py`` says what H, C, X and Z are in each set-up.
"""

from functools import lru_cache
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Bool, Float, Int

from jaxmodel.calibrate.refine import turn
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.elimination import NormalEquations, inverse_positive
from jaxmodel.geometry.polar import nearest_rotation

Noise = Literal["camera", "hand"]
ROUNDS = 20  # Gauss-Newton steps that also estimate the variances of rotation and translation
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
    deviations of one component of the noisy stream; ``freedom`` the degrees of freedom of the less well known of both.
    """

    X: Pose
    Z: Pose
    scale: Float[AnyArray, "*b"]
    covariance: Float[AnyArray, "*b 13 13"]
    rotation_noise: Float[AnyArray, "*b"]
    translation_noise: Float[AnyArray, "*b"]
    freedom: Float[AnyArray, "*b"]
    rotation_residuals: Float[AnyArray, "*b n"]
    translation_residuals: Float[AnyArray, "*b n"]
    influence: Float[AnyArray, "*b n"]
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


def _residuals(poses: Poses, point: _Point, noise: Noise) -> tuple[jax.Array, jax.Array]:
    """Rotation (n, 9; norm = angle, rad) and translation (n, 3) errors of the noisy stream.

    With noise in the camera its pose is predicted as ``X^-1 H^-1 Z``, with noise in the hand as ``Z C^-1 X^-1``: the
    errors of rotation and translation then stay independent. The camera's given translations are ``1 / scale`` of the
    metric ones, and so are its errors.
    """
    X, Z = point.X, point.Z
    root = jnp.sqrt(jnp.asarray(0.5, Z.t.dtype))
    n = poses.weight.shape[0]
    if noise == "camera":
        toward = jnp.einsum("nji,jk->nik", poses.R_hand, Z.R)
        R = jnp.einsum("ji,njk->nik", X.R, toward)
        inner = jnp.einsum("nji,nj->ni", poses.R_hand, Z.t - poses.t_hand)
        t = (inner - X.t) @ X.R / point.scale
        return root * (poses.R_camera - R).reshape(n, 9), poses.t_camera - t
    back = jnp.einsum("ij,nkj->nik", Z.R, poses.R_camera)  # Z C^-1
    R = jnp.einsum("nij,kj->nik", back, X.R)
    offset = point.scale * poses.t_camera + X.R.T @ X.t
    t = Z.t - jnp.einsum("nij,nj->ni", back, offset)
    return root * (poses.R_hand - R).reshape(n, 9), poses.t_hand - t


def _stacked(poses: Poses, point: _Point, noise: Noise, weights: tuple[jax.Array, jax.Array]) -> jax.Array:
    rotation, translation = _residuals(poses, point, noise)
    root = jnp.sqrt(poses.weight)[:, None]
    return jnp.concatenate([(root * rotation).reshape(-1) * weights[0], (root * translation).reshape(-1) * weights[1]])


def solve_joint(
    poses: Poses, X: Pose, Z: Pose, scale: Float[jax.Array, ""], noise: Noise = "camera", unknown_scale: bool = False
) -> JointSolution:
    """Maximum likelihood from a start; one problem, batched by ``vmap``.

    The variances of rotation and translation are estimated together with X and Z (each from its own residuals and its
    own share of the unknowns), so no unit of length enters.
    """
    size = 13 if unknown_scale else 12
    free = jnp.arange(13) < size
    count = jnp.sum(poses.weight > 0)
    reach = jnp.sum(poses.weight * jnp.sum(poses.t_camera**2, axis=1)) / jnp.maximum(jnp.sum(poses.weight), 1e-300)
    n = poses.weight.shape[0]

    def jacobian(point: _Point, weights: tuple[jax.Array, jax.Array]) -> jax.Array:
        rows = jax.jacfwd(lambda d: _stacked(poses, point.moved(d), noise, weights))(jnp.zeros(13, reach.dtype))
        return jnp.where(free, rows, 0.0)

    def variances(point: _Point, shares: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        rotation, translation = _residuals(poses, point, noise)
        squares = [jnp.sum(poses.weight * jnp.sum(r**2, axis=1)) for r in (rotation, translation)]
        left = [jnp.maximum(3 * count - share, 1.0) for share in shares]
        return squares[0] / left[0] + ROUNDING, squares[1] / left[1] + ROUNDING * (reach + 1e-300)

    def descend(point: _Point, weights: tuple[jax.Array, jax.Array]) -> tuple[_Point, jax.Array, jax.Array]:
        # curvature of about 1e4, so that the solver's first damping (1) is a small one
        unit = 100.0 / (weights[0] * jnp.sqrt(jnp.maximum(jnp.sum(poses.weight), 1.0)))
        scaled = weights[0] * unit, weights[1] * unit
        solution = optx.least_squares(
            lambda d, p: _stacked(poses, p.moved(jnp.where(free, d, 0.0)), noise, scaled),
            optx.LevenbergMarquardt(rtol=1e-5, atol=1e-5, linear_solver=NormalEquations()),
            jnp.zeros(13, reach.dtype),
            args=point,
            max_steps=MAX_STEPS,
            throw=False,
        )
        moved = point.moved(jnp.where(free, solution.value, 0.0))
        steps = solution.stats["num_steps"].astype(jnp.int32)
        return moved, steps, solution.result == optx.RESULTS.successful

    def polish(_: jax.Array, carry: tuple) -> tuple:
        """A Gauss-Newton step, then the variances anew, each with its own share of the unknowns."""
        point, shares = carry
        variance = variances(point, shares)
        weights = variance[0] ** -0.5, variance[1] ** -0.5
        rows = jacobian(point, weights)
        turns, shifts = rows[: 9 * n].T @ rows[: 9 * n], rows[9 * n :].T @ rows[9 * n :]
        inverse = inverse_positive(turns + shifts + jnp.diag(jnp.where(free, 0.0, 1.0)))
        step = -inverse @ (rows.T @ _stacked(poses, point, noise, weights))
        return point.moved(jnp.where(free, step, 0.0)), (jnp.sum(inverse * turns), jnp.sum(inverse * shifts))

    six = jnp.asarray(6.0, reach.dtype)
    first = _Point(X, Z, scale)
    variance = variances(first, (six, six))
    point, steps, converged = descend(first, (variance[0] ** -0.5, variance[1] ** -0.5))
    point, shares = jax.lax.fori_loop(0, ROUNDS, polish, (point, (six, six)))
    variance = variances(point, shares)
    weights = variance[0] ** -0.5, variance[1] ** -0.5
    rows = jacobian(point, weights)
    covariance = inverse_positive(rows.T @ rows + jnp.diag(jnp.where(free, 0.0, 1.0)))
    covariance = jnp.where(free[:, None] & free[None, :], covariance, 0.0)
    rotation, translation = _residuals(poses, point, noise)
    # how far each pose alone moves X, in standard deviations: Cook's distance over the six unknowns of X
    hat = rows @ covariance
    residual = _stacked(poses, point, noise, weights)
    pulls = (hat * residual[:, None])[:, :6]
    per_pose = pulls[: 9 * n].reshape(n, 9, 6).sum(axis=1) + pulls[9 * n :].reshape(n, 3, 6).sum(axis=1)
    information = inverse_positive(covariance[:6, :6])
    influence = jnp.sqrt(jnp.maximum(jnp.einsum("ni,ij,nj->n", per_pose, information, per_pose) / 6, 0.0))
    return JointSolution(
        point.X,
        point.Z,
        point.scale,
        covariance,
        jnp.sqrt(variance[0]),
        jnp.sqrt(variance[1]),
        3.0 * count - jnp.maximum(*shares),
        jnp.sqrt(jnp.sum(rotation**2, axis=1)),
        jnp.sqrt(jnp.sum(translation**2, axis=1)),
        influence,
        steps,
        converged,
    )


@lru_cache
def kernel(noise: Noise, unknown_scale: bool) -> Any:
    """``solve_joint`` compiled for a batch: (poses, X, Z, scale), each with a leading axis."""
    return jax.jit(jax.vmap(lambda poses, X, Z, scale: solve_joint(poses, X, Z, scale, noise, unknown_scale)))


def target_from(poses: Poses, X: Pose) -> Pose:
    """The Z that suits an X best: rotation and translation averaged over the poses (host or kernel)."""
    R = jnp.einsum("n,nij,jk,nkl->il", poses.weight, poses.R_hand, X.R, poses.R_camera)
    t = jnp.einsum("nij,nj->ni", poses.R_hand, poses.t_camera @ X.R.T + X.t) + poses.t_hand
    total = jnp.sum(poses.weight)
    return Pose(nearest_rotation(R), poses.weight @ t / jnp.where(total > 0, total, 1.0))
