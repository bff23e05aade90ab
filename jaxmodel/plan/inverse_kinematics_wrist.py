"""Inverse kinematics in closed form of an elbow arm with a spherical wrist: up to eight postures for a pose.

The arm is described by its axes at zero, so that Denavit-Hartenberg rows and URDF files are the same to it: six turning
joints; axes 4, 5, 6 meet in the wrist's centre; axis 2 is perpendicular to axis 1 and parallel to axis 3 (shoulder and
elbow may be offset). The wrist's centre is placed by the first three joints (two shoulders times two elbows), the rest
of the rotation by the wrist (two flips): Pieper 1968, in the form of Paden and Kahan's subproblems.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxmodel.geometry.arrays import AnyArray
from jaxmodel.geometry.polar import skew
from jaxmodel.plan.arm import Arm
from jaxmodel.plan.arm_lines import Lines, joint_lines, meeting_point

SIGNS = tuple((shoulder, elbow, wrist) for shoulder in (1, -1) for elbow in (1, -1) for wrist in (1, -1))
ALIGNED = 1e-9  # sine of an angle, or share of the arm's size, that counts as none


class WristArm(eqx.Module):
    """Geometry at zero, in the base frame: unit axes, and the first three joints' plane as complex numbers.

    That plane holds axis 1 (real part) and its common perpendicular with axis 2 (imaginary part), so that a turn by q
    about axis 2 multiplies by ``exp(i q)``.
    """

    axes: Float[AnyArray, "6 3"]
    plane: Float[AnyArray, "3 3"]  # rows: imaginary direction, axis 2, axis 1
    foot: Float[AnyArray, "3"]  # a point of axis 1
    aside: Float[AnyArray, ""]  # of the wrist's centre along axis 2
    shoulder: Float[AnyArray, "2"]  # (real, imaginary), of axis 2
    upper: Float[AnyArray, "2"]  # from axis 2 to axis 3
    fore: Float[AnyArray, "2"]  # from axis 3 to the wrist's centre
    elbow_sense: Float[AnyArray, ""]  # of axis 3, along axis 2 or against it
    wrist_sensor: Float[AnyArray, "3"]  # the wrist's centre in the sensor's frame
    R_sensor_base: Float[AnyArray, "3 3"]
    oblique: Float[AnyArray, "2"]  # of the wrist: its constant part, and how much sin^2 lacks to one; zero if square
    size: Float[AnyArray, ""]


def wrist_arm(arm: Arm) -> WristArm | None:
    """The arm's geometry if the closed form fits it, else None."""
    if arm.count != 6 or any(kind != "revolute" for kind in arm.kinds):
        return None
    lines: Lines = joint_lines(arm)
    z, size = lines.directions, arm.size
    centre = meeting_point(z[3:], lines.points[3:], ALIGNED * size)
    parallel, square = np.linalg.norm(np.cross(z[1], z[2])), abs(float(z[0] @ z[1]))
    if centre is None or parallel > ALIGNED or square > ALIGNED:
        return None
    if min(np.linalg.norm(np.cross(z[3], z[4])), np.linalg.norm(np.cross(z[4], z[5]))) < 1e-3:
        return None
    plane = np.stack([np.cross(z[1], z[0]), z[1], z[0]])
    at = {
        name: plane @ (point - lines.points[0]) for name, point in zip("abc", [*lines.points[1:3], centre], strict=True)
    }
    shoulder, elbow, wrist = (at[name][[2, 0]] for name in "abc")
    upper, fore = elbow - shoulder, wrist - elbow
    if min(np.linalg.norm(upper), np.linalg.norm(fore)) < 1e-6 * size:
        return None
    R, t = lines.T_base_sensor[:3, :3], lines.T_base_sensor[:3, 3]
    middle = float((z[3] @ z[4]) * (z[4] @ z[5]))
    swing = np.hypot(z[3] @ z[5] - middle, z[3] @ np.cross(z[4], z[5]))
    oblique = np.array([middle, 1 - swing**2])
    return WristArm(
        axes=z,
        plane=plane,
        foot=lines.points[0],
        aside=np.asarray(at["c"][1] if abs(at["c"][1]) > 1e-12 * size else 0.0),
        shoulder=shoulder,
        upper=upper,
        fore=fore,
        elbow_sense=np.asarray(np.sign(z[1] @ z[2])),
        wrist_sensor=R.T @ (centre - t),
        R_sensor_base=R.T,
        # rounding here would cost half the digits of a stretched wrist
        oblique=np.where(np.abs(oblique) < 1e-12, 0.0, oblique),
        size=np.asarray(size),
    )


def wrist_postures(
    arm: WristArm, T_base_sensor: Float[jax.Array, "4 4"], near: Float[jax.Array, "6"]
) -> Float[jax.Array, "8 6"]:
    """Joints of the eight postures for a pose; where none is exact, the nearest stretch: check by ``forward``.

    At a singularity the joint that the pose leaves free (the first with the wrist on axis 1, the fourth with axes 4 and
    6 in line) is that of ``near``. Angles are not yet turned into any limits.
    """
    # one branch for all signs, so that it is compiled once
    return jax.vmap(lambda signs: _posture(arm, T_base_sensor, near, signs))(jnp.array(SIGNS, near.dtype))


def _posture(arm: WristArm, T_base_sensor: jax.Array, near: jax.Array, signs: Float[jax.Array, "3"]) -> jax.Array:
    """The posture with the given signs of shoulder, elbow and wrist."""
    R, t = T_base_sensor[:3, :3], T_base_sensor[:3, 3]
    u = jnp.asarray(arm.plane) @ (R @ jnp.asarray(arm.wrist_sensor) + t - jnp.asarray(arm.foot))
    radius = jnp.hypot(u[0], u[1])
    slant = jnp.arcsin(jnp.clip(arm.aside / jnp.where(radius > 0, radius, 1.0), -1.0, 1.0))
    slope = jnp.where(signs[0] > 0, slant, jnp.pi - slant)
    bearing = jnp.where(radius > 1e-10 * arm.size, jnp.arctan2(u[1], u[0]), near[0] + slope)
    first = bearing - slope
    second, third = _elbow(arm, jnp.stack([u[2], radius * jnp.cos(slope)]) - jnp.asarray(arm.shoulder), signs[1])
    arms = _turn(arm.axes[0], first) @ _turn(arm.axes[1], second) @ _turn(arm.axes[2], third)
    rest = arms.T @ R @ jnp.asarray(arm.R_sensor_base)
    return jnp.stack([first, second, third, *_wrist(arm, rest, signs[2], near[3])])


def _elbow(arm: WristArm, target: jax.Array, bend: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Turns about axes 2 and 3 that bring the wrist's centre to ``target`` (real, imaginary), by the law of cosines."""
    upper, fore = jnp.asarray(arm.upper), jnp.asarray(arm.fore)
    l2, l3 = jnp.hypot(upper[0], upper[1]), jnp.hypot(fore[0], fore[1])
    cosine = (jnp.sum(target**2) - l2**2 - l3**2) / (2 * l2 * l3)
    bent = jnp.arctan2(fore[1], fore[0]) - jnp.arctan2(upper[1], upper[0])
    turned = bend * jnp.arccos(jnp.clip(cosine, -1.0, 1.0)) - bent
    c, s = jnp.cos(turned), jnp.sin(turned)
    reach = upper + jnp.stack([c * fore[0] - s * fore[1], s * fore[0] + c * fore[1]])
    return jnp.arctan2(target[1], target[0]) - jnp.arctan2(reach[1], reach[0]), arm.elbow_sense * turned


def _wrist(arm: WristArm, rest: jax.Array, flip: jax.Array, near: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Turns about axes 4, 5 and 6 whose product is ``rest``."""
    z4, z5, z6 = jnp.asarray(arm.axes[3]), jnp.asarray(arm.axes[4]), jnp.asarray(arm.axes[5])
    aim = rest @ z6
    constant, lacking = arm.oblique[0], arm.oblique[1]
    # z4 . exp(q5) z6 = constant + swing cos(q5 - ahead); the sine from the cross product keeps its digits near zero
    cosine = z4 @ aim - constant
    cross = jnp.cross(z4, aim)
    squared = cross @ cross - lacking - constant**2 + 2 * constant * (z4 @ aim)
    sine = jnp.sqrt(jnp.where(squared > 0, squared, 0.0))
    ahead = jnp.arctan2(z4 @ jnp.cross(z5, z6), z4 @ z6 - constant)
    fifth = ahead + flip * jnp.arctan2(sine, cosine)
    bent = _turn(z5, fifth) @ z6
    free = jnp.sum((bent - (z4 @ bent) * z4) ** 2) <= 1e-20
    # both as seen along z4: the difference of two cosines would lose the digits of a nearly straight wrist
    seen, wanted = jnp.cross(z4, bent), cross
    about = jnp.arctan2(z4 @ jnp.cross(seen, wanted), seen @ wanted)
    fourth = jnp.where(free, near, about)
    # the last joint takes what is left, so that near the singularity the sum of the two is right
    left = (_turn(z4, fourth) @ _turn(z5, fifth)).T @ rest
    twist = jnp.stack([left[2, 1] - left[1, 2], left[0, 2] - left[2, 0], left[1, 0] - left[0, 1]]) / 2
    return fourth, fifth, jnp.arctan2(z6 @ twist, (jnp.trace(left) - 1) / 2)


def _turn(axis: Float[AnyArray, "3"], angle: Float[jax.Array, ""]) -> Float[jax.Array, "3 3"]:
    K = skew(jnp.asarray(axis))
    return jnp.eye(3, dtype=angle.dtype) + jnp.sin(angle) * K + 2 * jnp.sin(angle / 2) ** 2 * (K @ K)
