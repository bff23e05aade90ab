"""Serial arms from URDF files: the chain of joints from one link to another, and nothing else of the robot.

Read as plain XML: no macro is expanded, no mesh or other file is opened, and XML with entities of its own is refused.
"""

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.text_files import read_text
from jaxmodel.plan.arm import Arm, JointKind

KINDS: dict[str, JointKind] = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}


class _Joint(NamedTuple):
    """One joint element, and the sentence's subject for whatever is wrong with it."""

    element: ElementTree.Element
    parent: str
    child: str
    named: str


def load_arm(
    path: str | Path,
    base_link: str | None = None,
    flange_link: str | None = None,
    scale: float = 1.0,
    T_flange_sensor: Float[np.ndarray, "4 4"] | None = None,
    T_world_base: Float[np.ndarray, "4 4"] | None = None,
) -> Arm:
    """The arm between two links of a URDF file.

    Args:
        path: the file, with its macros expanded (a xacro file is refused).
        base_link: frame of the arm's base; by default the only link that no joint carries.
        flange_link: frame that carries the sensor; by default the only link that carries no joint.
        scale: your unit per metre, 1000 for millimetres; URDF lengths are metres.
        T_flange_sensor: the sensor's mount, in your unit (see ``Arm``).
        T_world_base: the base's place, in your unit.

    Fixed joints become part of the links; a revolute joint needs limits, a continuous one has none. Raises
    :class:`InputError`: one sentence that names the file, and the joint or link at fault. Source: the URDF
    specification, wiki.ros.org/urdf/XML/joint.
    """
    path = Path(path)
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"{path}: expected a positive scale, got {scale}.")
    chain = _chain(path, _robot(path), base_link, flange_link)
    before, axes, limits, kinds, speeds, place = [], [], [], [], [], np.eye(4)
    for joint in chain:
        place = place @ _origin(joint, scale)
        kind = joint.element.get("type", "")
        if kind == "fixed":
            continue
        if kind not in KINDS:
            raise InputError(f"{joint.named} is of type {kind!r}, expected revolute, continuous, prismatic or fixed.")
        if joint.element.find("mimic") is not None:
            raise InputError(f"{joint.named} mimics another one, which a serial arm cannot.")
        unit = scale if kind == "prismatic" else 1.0
        bounds, speed = _limit(joint, kind)
        before.append(place)
        axes.append(_axis(joint))
        limits.append([unit * bound for bound in bounds])
        speeds.append(unit * speed)
        kinds.append(KINDS[kind])
        place = np.eye(4)
    if not before:
        raise InputError(f"{path}: no joint between its links {chain[0].parent} and {chain[-1].child} moves.")
    try:
        return Arm(
            np.stack(before),
            np.stack(axes),
            np.array(limits),
            tuple(kinds),
            place,
            T_flange_sensor,
            T_world_base,
            np.array(speeds),
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _robot(path: Path) -> ElementTree.Element:
    text = read_text(path).strip()
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{path}: XML with a document type or entities of its own is not read.")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{path} is not XML: {error}.") from error
    if root.tag != "robot":
        raise InputError(f"{path}: expected a URDF file, whose outermost element is robot, not {root.tag}.")
    if any("xacro" in element.tag for element in root.iter()):
        raise InputError(f"{path} holds xacro macros: expand it to plain URDF first.")
    return root


def _chain(path: Path, root: ElementTree.Element, base: str | None, flange: str | None) -> list[_Joint]:
    """The joints from ``base`` to ``flange``, in this order."""
    carried: dict[str, _Joint] = {}
    for element in root.findall("joint"):
        named = f"{path}: joint {element.get('name', '?')!r}"
        links = [part.get("link", "") if part is not None else "" for part in map(element.find, ("parent", "child"))]
        if not all(links):
            raise InputError(f"{named} lacks its parent or its child link.")
        if links[1] in carried:
            raise InputError(f"{named} carries the link {links[1]}, which another joint carries already.")
        carried[links[1]] = _Joint(element, links[0], links[1], named)
    if not carried:
        raise InputError(f"{path} holds no joint.")
    parents = {joint.parent for joint in carried.values()}
    link = flange or _only(path, "carry no joint", "flange_link", sorted(carried.keys() - parents))
    foot = base or _only(path, "no joint carries", "base_link", sorted(parents - carried.keys()))
    for name in (link, foot):
        if name not in parents | carried.keys():
            raise InputError(f"{path} has no joint at a link named {name}.")
    chain: list[_Joint] = []
    while link != foot:
        if link not in carried or len(chain) > len(carried):
            raise InputError(f"{path}: no chain of joints leads from the link {foot} to {flange or 'its end'}.")
        chain.append(carried[link])
        link = carried[link].parent
    if not chain:
        raise InputError(f"{path}: base_link and flange_link are both {foot}.")
    return chain[::-1]


def _only(path: Path, which: str, argument: str, links: list[str]) -> str:
    if len(links) != 1:
        named = ", ".join(links[:8]) or "none"
        raise InputError(f"{path}: expected one link for {argument}, but the links that {which} are: {named}.")
    return links[0]


def _origin(joint: _Joint, scale: float) -> Float[np.ndarray, "4 4"]:
    """T_parent_child of the joint at zero: fixed-axis roll, pitch, yaw, that is Rz(yaw) Ry(pitch) Rx(roll)."""
    element = joint.element.find("origin")
    if element is None:
        return np.eye(4)
    (cr, cp, cy), (sr, sp, sy) = (f(_numbers(joint, element, "rpy", "0 0 0")) for f in (np.cos, np.sin))
    R = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    return se3.compose(R, scale * _numbers(joint, element, "xyz", "0 0 0"))


def _axis(joint: _Joint) -> Float[np.ndarray, "3"]:
    element = joint.element.find("axis")
    axis = np.array([1.0, 0.0, 0.0]) if element is None else _numbers(joint, element, "xyz", "1 0 0")
    if not np.linalg.norm(axis) > 0:
        raise InputError(f"{joint.named} has an axis of length zero.")
    return axis


def _limit(joint: _Joint, kind: str) -> tuple[tuple[float, float], float]:
    """(lowest, highest) and the largest rate; a rate of zero, which some files give, is one that is not known."""
    element = joint.element.find("limit")
    if element is None and kind != "continuous":
        raise InputError(f"{joint.named} is {kind} and has no limit element.")
    speed = np.inf if element is None else _numbers(joint, element, "velocity", "0", 1)[0]
    if kind == "continuous" or element is None:
        low, high = -np.inf, np.inf
    else:
        low, high = (_numbers(joint, element, name, "0", 1)[0] for name in ("lower", "upper"))
    if low > high:
        raise InputError(f"{joint.named} has the limits {low} and {high}, expected lower <= upper.")
    if speed < 0:
        raise InputError(f"{joint.named} has a negative velocity limit.")
    return (low, high), speed if speed > 0 else np.inf


def _numbers(
    joint: _Joint, element: ElementTree.Element, name: str, default: str, count: int = 3
) -> Float[np.ndarray, " n"]:
    words = element.get(name, default).split()
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.array([np.nan])
    if len(numbers) != count or not np.isfinite(numbers).all():
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        raise InputError(f"{joint.named}: {element.tag} {name} must be {expected}, not {element.get(name, default)!r}.")
    return numbers
