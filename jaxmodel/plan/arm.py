"""A serial arm that carries the sensor: its joints, its forward kinematics, its limits (thesis §4.5).

Frames: ``base`` is the arm's foot, ``flange`` its last link, ``sensor`` the range sensor of ``scan/sensor.py`` (x
right, y down, z ahead). ``T_flange_sensor`` is the hand-eye transform X, the place of the sensor in the flange's frame:
``T_hand_camera`` of ``calibrate``, for which the flange is the hand and the sensor the camera. Angles are radians,
lengths in the arm's unit. Nothing here knows of collisions, of the arm with itself or with the table.
"""

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.polar import skew

JointKind = Literal["revolute", "prismatic"]


class Arm(eqx.Module):
    """A chain of joints, each a fixed transform and then a turn about, or a slide along, a unit axis.

    ``T_parent_joint[i]`` maps joint i's frame to that of the link before (the base for i = 0) when joint i is at zero;
    ``axes`` are in the joints' own frames; ``T_last_flange`` maps the flange to the last joint's moved frame.
    ``limits`` are (lowest, highest) of each joint, infinite for one that turns for ever; ``speeds`` the largest rates
    (rad or length per second; infinite where unknown). Raises :class:`InputError` for what makes no arm.
    Denavit-Hartenberg rows: ``arm_from_dh``; URDF: ``jaxmodel.io.urdf``.
    """

    T_parent_joint: Float[AnyArray, "n 4 4"]
    axes: Float[AnyArray, "n 3"]
    limits: Float[AnyArray, "n 2"]
    speeds: Float[AnyArray, " n"]
    T_last_flange: Float[AnyArray, "4 4"]
    T_flange_sensor: Float[AnyArray, "4 4"]
    T_world_base: Float[AnyArray, "4 4"]
    kinds: tuple[JointKind, ...] = eqx.field(static=True)

    def __init__(
        self,
        T_parent_joint: Float[AnyArray, "n 4 4"],
        axes: Float[AnyArray, "n 3"],
        limits: Float[AnyArray, "n 2"],
        kinds: tuple[JointKind, ...] | None = None,
        T_last_flange: Float[AnyArray, "4 4"] | None = None,
        T_flange_sensor: Float[AnyArray, "4 4"] | None = None,
        T_world_base: Float[AnyArray, "4 4"] | None = None,
        speeds: Float[AnyArray, " n"] | None = None,
    ) -> None:
        count = len(axes)
        self.kinds = ("revolute",) * count if kinds is None else tuple(kinds)
        self.T_parent_joint = np.asarray(T_parent_joint, np.float64)
        lengths = np.linalg.norm(axes, axis=-1, keepdims=True)
        if count == 0 or not np.all(lengths > 0):
            raise InputError("arm: expected at least one joint, each with an axis of positive length.")
        self.axes = np.asarray(axes, np.float64) / lengths
        self.limits = np.asarray(limits, np.float64)
        self.speeds = np.full(count, np.inf) if speeds is None else np.asarray(speeds, np.float64)
        self.T_last_flange = np.eye(4) if T_last_flange is None else np.asarray(T_last_flange, np.float64)
        self.T_flange_sensor = np.eye(4) if T_flange_sensor is None else np.asarray(T_flange_sensor, np.float64)
        self.T_world_base = np.eye(4) if T_world_base is None else np.asarray(T_world_base, np.float64)
        self._check()

    def _check(self) -> None:
        if len(self.kinds) != self.count:
            raise InputError(f"arm: {self.count} joints have {len(self.kinds)} kinds.")
        for joint, (low, high) in enumerate(self.limits, start=1):
            if not low <= high:
                raise InputError(f"arm: joint {joint} has the limits {low} and {high}, expected lowest <= highest.")
        if not np.all(self.speeds > 0):
            raise InputError("arm: expected positive largest speeds.")
        for joint in np.flatnonzero(~se3.are_rigid(self.T_parent_joint)):
            raise InputError(f"arm: the transform before joint {joint + 1} is not a rigid motion.")
        for name in ("T_last_flange", "T_flange_sensor", "T_world_base"):
            if not se3.is_rigid(getattr(self, name)):
                raise InputError(f"arm: {name} is not a rigid motion.")
        if not self.size > 0:
            raise InputError("arm: all its links have length zero.")

    @property
    def count(self) -> int:
        """Number of joints."""
        return self.axes.shape[0]

    @property
    def size(self) -> float:
        """Length of the chain stretched out from the first joint to the sensor: nothing is reached from farther.

        Sliding joints count with their longest slide, where that is finite.
        """
        links = np.linalg.norm(self.T_parent_joint[1:, :3, 3], axis=-1).sum()
        ends = np.linalg.norm(self.T_last_flange[:3, 3]) + np.linalg.norm(self.T_flange_sensor[:3, 3])
        sliding = np.array([kind == "prismatic" for kind in self.kinds])
        slides = np.abs(np.where(np.isfinite(self.limits), self.limits, 0.0)).max(axis=1)
        return float(links + ends + slides[sliding].sum())

    @property
    def shoulder_world(self) -> Float[np.ndarray, "3"]:
        """Origin of the first joint's frame: the sensor is never farther from it than ``size``."""
        return (self.T_world_base @ self.T_parent_joint[0])[:3, 3]

    @property
    def middle(self) -> Float[np.ndarray, " n"]:
        """Joints in the middle of their limits; zero where a limit is infinite."""
        bounded = np.isfinite(self.limits).all(axis=1, keepdims=True)
        return np.where(bounded, self.limits, 0.0).mean(axis=1)

    def at(self, T_world_base: Float[AnyArray, "4 4"]) -> "Arm":
        """The same arm on another foot."""
        return self._replaced(T_world_base=T_world_base)

    def carrying(self, T_flange_sensor: Float[AnyArray, "4 4"]) -> "Arm":
        """The same arm with another sensor mount: X of a hand-eye calibration, in the arm's unit."""
        return self._replaced(T_flange_sensor=T_flange_sensor)

    def _replaced(self, **changed: Float[AnyArray, "4 4"]) -> "Arm":
        ends = {"T_flange_sensor": self.T_flange_sensor, "T_world_base": self.T_world_base} | changed
        return Arm(
            self.T_parent_joint, self.axes, self.limits, self.kinds, self.T_last_flange, speeds=self.speeds, **ends
        )


def arm_from_dh(
    rows: Float[AnyArray, "n 4"],
    limits: Float[AnyArray, "n 2"],
    kinds: tuple[JointKind, ...] | None = None,
    T_flange_sensor: Float[AnyArray, "4 4"] | None = None,
    T_world_base: Float[AnyArray, "4 4"] | None = None,
    speeds: Float[AnyArray, " n"] | None = None,
) -> Arm:
    """An arm from standard Denavit-Hartenberg rows ``(a, alpha, d, theta)``, one a joint.

    Link i is ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``; the joint's value is added to ``theta`` (revolute) or to ``d``
    (prismatic). The turn, or slide, comes first and the rest of the row is fixed, which is the form ``Arm`` keeps.
    """
    links = np.stack([_dh_link(*row) for row in np.asarray(rows, np.float64)])
    before = np.concatenate([np.eye(4)[None], links[:-1]])
    axes = np.tile([0.0, 0.0, 1.0], (len(links), 1))
    return Arm(before, axes, limits, kinds, links[-1], T_flange_sensor, T_world_base, speeds)


def _dh_link(a: float, alpha: float, d: float, theta: float) -> Float[np.ndarray, "4 4"]:
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]])


class Chain(NamedTuple):
    """Frames of an arm at some joints: each moved joint's, the flange's and the sensor's, for drawing and Jacobians."""

    T_world_link: Float[jax.Array, "*batch n 4 4"]
    T_world_flange: Float[jax.Array, "*batch 4 4"]
    T_world_sensor: Float[jax.Array, "*batch 4 4"]


def link_frames(arm: Arm, joints: Float[jax.Array, "*batch n"]) -> Chain:
    """All frames of the arm at ``joints``, in the world. Pure; in the precision of the context."""
    joints = jnp.asarray(joints)
    turning = jnp.array([kind == "revolute" for kind in arm.kinds])

    def link(T: jax.Array, of: tuple[jax.Array, ...]) -> tuple[jax.Array, jax.Array]:
        before, axis, turns, value = of
        T = _product(_product(T, before), _motion(axis, value, turns))
        return T, T

    # one joint after the other in a loop: written out, an arm took three times as long to compile
    links = (jnp.asarray(arm.T_parent_joint), jnp.asarray(arm.axes), turning, jnp.moveaxis(joints, -1, 0))
    base = jnp.broadcast_to(jnp.asarray(arm.T_world_base, joints.dtype), (*joints.shape[:-1], 4, 4))
    T, frames = jax.lax.scan(link, base, links)
    T_world_flange = _product(T, jnp.asarray(arm.T_last_flange))
    sensor = _product(T_world_flange, jnp.asarray(arm.T_flange_sensor))
    return Chain(jnp.moveaxis(frames, 0, -3), T_world_flange, sensor)


def forward(arm: Arm, joints: Float[jax.Array, "*batch n"]) -> Float[jax.Array, "*batch 4 4"]:
    """T_world_sensor at ``joints``. Pure, for jit and vmap; in the precision of the context (float32 by default)."""
    return link_frames(arm, joints).T_world_sensor


def jacobian(arm: Arm, joints: Float[jax.Array, " n"]) -> Float[jax.Array, "6 n"]:
    """The sensor's (velocity, turn rate) in the world for a unit rate of each joint, at its own origin."""
    chain = link_frames(arm, joints)
    directions = jnp.einsum("nij,nj->ni", chain.T_world_link[:, :3, :3], jnp.asarray(arm.axes), precision="highest")
    levers = jnp.cross(directions, chain.T_world_sensor[:3, 3] - chain.T_world_link[:, :3, 3])
    turning = jnp.array([kind == "revolute" for kind in arm.kinds])[:, None]
    return jnp.concatenate([jnp.where(turning, levers, directions), jnp.where(turning, directions, 0.0)], axis=1).T


def _motion(axis: Float[jax.Array, "3"], value: Float[jax.Array, "*batch"], turns: Bool[jax.Array, ""]) -> jax.Array:
    """The joint's own motion: Rodrigues' formula about a unit axis, or a slide along it."""
    angle, slide = jnp.where(turns, value, 0.0), jnp.where(turns, 0.0, value)
    K = skew(axis)
    sine, rest = jnp.sin(angle)[..., None, None], 2 * jnp.sin(angle / 2)[..., None, None] ** 2
    R = jnp.eye(3, dtype=value.dtype) + sine * K + rest * _product(K, K)
    last = jnp.broadcast_to(jnp.array([[0.0, 0.0, 0.0, 1.0]], value.dtype), (*value.shape, 1, 4))
    return jnp.concatenate([jnp.concatenate([R, (slide[..., None] * axis)[..., None]], axis=-1), last], axis=-2)


def _product(a: jax.Array, b: jax.Array) -> jax.Array:
    # an accelerator would otherwise round the factors of a float32 product to ten bits
    return jnp.matmul(a, b, precision="highest")
