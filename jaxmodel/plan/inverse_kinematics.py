"""Which joints place the sensor where a view wants it: thousands of poses at once, with the outcome of each (§4.5).

An elbow arm with a spherical wrist is solved in closed form, all eight postures; any other by Levenberg-Marquardt from
several starts. Either way each posture is checked by forward kinematics and turned into the joint limits, and the best
that is left is taken. A range sensor sees the same from any roll about its axis, so that the roll may be searched too.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.elimination import inverse_positive
from jaxmodel.plan.arm import Arm, forward, jacobian
from jaxmodel.plan.inverse_kinematics_search import joint_starts, search_postures
from jaxmodel.plan.inverse_kinematics_wrist import WristArm, wrist_arm, wrist_postures
from jaxmodel.plan.joint_limits import limit_margin, within_limits
from jaxmodel.plan.reach_outcome import Placements, Postures, ReachOutcome

REACHED, SINGULAR, JOINT_LIMITS, OUT_OF_REACH, NOT_CONVERGED, NOT_FINITE = (int(outcome) for outcome in ReachOutcome)
AT_ONCE = 64  # poses in one vectorised step: memory stays bounded, and a search waits for few others
CHUNK = 32 * AT_ONCE  # poses in one call of a kernel: with AT_ONCE the only shape that is ever compiled


class InverseKinematics(eqx.Module):
    """How postures are found and chosen.

    ``rolls``: how many rolls about the sensor's z axis are tried, evenly over the turn; 1 keeps the pose as given.
    ``tolerance``: the largest error of a reached pose, in radian and as a share of the arm's size. ``dexterity``: a
    posture below it is singular (see ``Placements``). ``starts``: of Levenberg-Marquardt, without a closed form.
    """

    rolls: int = eqx.field(static=True, default=1)
    starts: int = eqx.field(static=True, default=16)
    tolerance: float = 1e-8
    dexterity: float = 1e-3

    def __check_init__(self) -> None:
        for name in ("rolls", "starts"):
            if getattr(self, name) < 1:
                raise InputError(f"inverse kinematics: {name} must be at least 1, not {getattr(self, name)}.")
        for name in ("tolerance", "dexterity"):
            if not getattr(self, name) > 0:
                raise InputError(f"inverse kinematics: {name} must be positive, not {getattr(self, name)}.")


def inverse_kinematics(
    arm: Arm,
    T_world_sensor: Float[np.ndarray, "m 4 4"],
    current: Float[np.ndarray, " n"] | None = None,
    method: InverseKinematics = InverseKinematics(),
) -> Placements:
    """The best posture for each of many poses of the sensor, in float64.

    Args:
        arm: the arm; closed form where it is an elbow arm with a spherical wrist, else Levenberg-Marquardt.
        T_world_sensor: wanted poses, world frame, arm's unit.
        current: joints to stay close to (largest single motion); without them, the posture farthest from the limits.
        method: rolls and tolerances.

    Bad poses are an outcome; ``current`` of the wrong length or not finite is an :class:`InputError`.
    """
    problem, wanted, sound = _prepared(arm, T_world_sensor, current, method)
    found = _in_chunks(_placements, problem, wanted, np.asarray(current is None))
    found = jax.tree.map(lambda a: np.where(sound.reshape(-1, *[1] * (a.ndim - 1)), a, np.nan), found)
    return eqx.tree_at(lambda f: f.outcome, found, np.where(sound, found.outcome, NOT_FINITE).astype(np.int32))


def reachable(
    arm: Arm, T_world_sensor: Float[np.ndarray, "m 4 4"], method: InverseKinematics = InverseKinematics()
) -> Bool[np.ndarray, " m"]:
    """Which poses ``inverse_kinematics`` reaches, without choosing postures: for maps of very many poses."""
    problem, wanted, sound = _prepared(arm, T_world_sensor, None, method)
    return _in_chunks(_reachable, problem, wanted) & sound


def all_postures(
    arm: Arm,
    T_world_sensor: Float[np.ndarray, "m 4 4"],
    current: Float[np.ndarray, " n"] | None = None,
    method: InverseKinematics = InverseKinematics(),
) -> Postures:
    """Every posture found for each pose, with each roll: for paths, which choose among them."""
    problem, wanted, sound = _prepared(arm, T_world_sensor, current, method)
    found = _in_chunks(_postures, problem, wanted)
    sound = sound[:, None]
    return eqx.tree_at(lambda f: (f.reached, f.exact), found, (found.reached & sound, found.exact & sound))


class _Problem(eqx.Module):
    """What all poses share; ``closed`` or ``starts`` says how postures are found."""

    arm: Arm
    method: InverseKinematics
    T_base_world: Float[AnyArray, "4 4"]
    near: Float[AnyArray, " n"]
    size: Float[AnyArray, ""]
    closed: WristArm | None
    starts: Float[AnyArray, "s n"] | None

    def candidates(self, wanted: Float[jax.Array, "4 4"]) -> Postures:
        """All postures for one pose, of each roll."""
        rolls = jnp.arange(self.method.rolls) * (2 * jnp.pi / self.method.rolls)
        posture = jax.vmap(lambda roll: self._of_roll(wanted @ _roll(roll)))(rolls)
        each = jnp.repeat(rolls, posture.exact.shape[1])
        flat = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), posture)
        return eqx.tree_at(lambda p: p.roll, flat, each)

    def _of_roll(self, wanted: Float[jax.Array, "4 4"]) -> Postures:
        if self.closed is not None:
            joints = wrist_postures(self.closed, jnp.asarray(self.T_base_world) @ wanted, self.near)
        else:
            joints = search_postures(self.arm, wanted, self.near, self.starts, self.size)
        joints, fits = within_limits(self.arm, joints, self.near, self.size)
        place = forward(self.arm, joints)
        distance = jnp.sqrt(jnp.sum((place[:, :3, 3] - wanted[:3, 3]) ** 2, axis=1))
        chord = jnp.sqrt(jnp.sum((place[:, :3, :3] - wanted[:3, :3]) ** 2, axis=(1, 2)))
        angle = 2 * jnp.arcsin(jnp.minimum(chord / jnp.sqrt(8.0), 1.0))
        tolerance = self.method.tolerance
        exact = (distance <= tolerance * self.size) & (angle <= tolerance)
        return Postures(joints, exact & fits, exact, jnp.zeros(len(joints)), distance, angle)

    def chosen(self, wanted: Float[jax.Array, "4 4"], by_limits: Bool[AnyArray, ""]) -> Placements:
        """The best posture for one pose."""
        found = self.candidates(wanted)
        turning = jnp.array([kind == "revolute" for kind in self.arm.kinds])
        away = jnp.max(jnp.abs(found.joints - self.near) / jnp.where(turning, 1.0, self.size), axis=1)
        badness = jnp.where(by_limits, -limit_margin(self.arm, found.joints), away)
        error = found.position_error / self.size + found.rotation_error
        best = jnp.where(
            jnp.any(found.reached), jnp.argmin(jnp.where(found.reached, badness, jnp.inf)), jnp.argmin(error)
        )
        reached, joints = found.reached[best], found.joints[best]
        nimble = dexterity(self.arm, joints, self.size)
        shoulder = (jnp.asarray(self.arm.T_world_base) @ jnp.asarray(self.arm.T_parent_joint[0]))[:3, 3]
        beyond = jnp.sqrt(jnp.sum((wanted[:3, 3] - shoulder) ** 2)) > self.size * (1 + self.method.tolerance)
        # a search that found nothing has proved nothing, unless the arm is too short
        nothing = OUT_OF_REACH if self.closed is not None else jnp.where(beyond, OUT_OF_REACH, NOT_CONVERGED)
        outcome = jnp.where(jnp.any(found.exact), JOINT_LIMITS, nothing)
        outcome = jnp.where(reached, jnp.where(nimble < self.method.dexterity, SINGULAR, REACHED), outcome)
        nan = jnp.where(reached, 0.0, jnp.nan)
        return Placements(
            joints=joints + nan,
            outcome=outcome.astype(jnp.int32),
            roll=found.roll[best] + nan,
            position_error=found.position_error[best],
            rotation_error=found.rotation_error[best],
            limit_margin=limit_margin(self.arm, joints) + nan,
            dexterity=nimble + nan,
        )


def _prepared(
    arm: Arm,
    T_world_sensor: Float[np.ndarray, "m 4 4"],
    current: Float[np.ndarray, " n"] | None,
    method: InverseKinematics,
) -> tuple[_Problem, Float[np.ndarray, "m 4 4"], Bool[np.ndarray, " m"]]:
    """The problem, the poses (the unit for one that is no rigid motion), and which of them are rigid motions."""
    near = arm.middle if current is None else np.asarray(current, np.float64)
    if near.shape != (arm.count,) or not np.isfinite(near).all():
        raise InputError(f"inverse kinematics: expected {arm.count} finite current joints, got {current}.")
    if len(T_world_sensor) == 0:
        raise InputError("inverse kinematics: expected at least one pose.")
    sound = se3.are_rigid(T_world_sensor)
    wanted = np.where(sound[:, None, None], np.asarray(T_world_sensor, np.float64), np.eye(4))
    closed = wrist_arm(arm)
    starts = joint_starts(arm, method.starts) if closed is None else None
    return (
        _Problem(arm, method, se3.inverse(arm.T_world_base), near, np.asarray(arm.size), closed, starts),
        wanted,
        sound,
    )


def _in_chunks(kernel: Callable[..., Any], problem: _Problem, wanted: np.ndarray, *options: np.ndarray) -> Any:
    """``kernel`` over poses in chunks of one of two sizes, its results as NumPy arrays in the order of the poses."""
    # a search takes so long that what fills up a chunk would be felt
    size, parts = AT_ONCE if len(wanted) <= AT_ONCE or problem.closed is None else CHUNK, []
    with jax.enable_x64(True):
        for first in range(0, len(wanted), size):
            some = wanted[first : first + size]
            padded = np.concatenate([some, np.repeat(some[:1], size - len(some), axis=0)])
            found = kernel(problem, padded, *options)
            parts.append(jax.tree.map(lambda a, count=len(some): np.asarray(a)[:count], found))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


@jax.jit
def _placements(problem: _Problem, wanted: Float[jax.Array, "p 4 4"], by_limits: Bool[AnyArray, ""]) -> Placements:
    return jax.lax.map(lambda T: problem.chosen(T, by_limits), wanted, batch_size=AT_ONCE)


@jax.jit
def _postures(problem: _Problem, wanted: Float[jax.Array, "p 4 4"]) -> Postures:
    return jax.lax.map(lambda T: problem.candidates(T), wanted, batch_size=AT_ONCE)


@jax.jit
def _reachable(problem: _Problem, wanted: Float[jax.Array, "p 4 4"]) -> Bool[jax.Array, " p"]:
    return jax.lax.map(lambda T: jnp.any(problem.candidates(T).reached), wanted, batch_size=AT_ONCE)


def dexterity(arm: Arm, joints: Float[jax.Array, " n"], size: Float[jax.Array, ""]) -> Float[jax.Array, ""]:
    """``1 / |J^-1|`` (Frobenius) with lengths in ``size``: at most the smallest singular value, at least 0.4 of it.

    Of an arm with fewer than six joints: of the directions that its joints span.
    """
    turning = jnp.array([kind == "revolute" for kind in arm.kinds])
    rows = jnp.where(jnp.arange(6) < 3, 1 / size, 1.0)[:, None]
    J = rows * jacobian(arm, joints) * jnp.where(turning, 1.0, size)
    gram = J @ J.T if arm.count >= 6 else J.T @ J
    lifted = gram + 1e-14 * jnp.trace(gram) * jnp.eye(len(gram), dtype=gram.dtype)
    return jax.lax.rsqrt(jnp.trace(inverse_positive(lifted)))


def _roll(angle: Float[jax.Array, ""]) -> Float[jax.Array, "4 4"]:
    c, s, zero, one = jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle), jnp.ones_like(angle)
    rows = [[c, -s, zero, zero], [s, c, zero, zero], [zero, zero, one, zero], [zero, zero, zero, one]]
    return jnp.stack([jnp.stack(row) for row in rows])
