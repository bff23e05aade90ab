"""Arms from URDF: the same kinematics as the tables they were written from, and one sentence for every fault."""

from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.urdf import load_arm
from jaxmodel.plan.arm import Arm, forward
from jaxmodel.plan.arm_models import gt6a_like

X = se3.compose(Rotation.from_rotvec([0.3, -0.5, 1.1]).as_matrix(), np.array([0.05, -0.02, 0.12]))


def origin(T: np.ndarray) -> str:
    rpy = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    numbers = lambda row: " ".join(repr(float(x)) for x in row)  # noqa: E731
    return f'<origin xyz="{numbers(T[:3, 3])}" rpy="{numbers(rpy)}"/>'


def urdf_of(arm: Arm) -> str:
    """The arm as URDF, its flange on a fixed joint, beside a gripper's camera that is no part of the chain."""
    parts = []
    for i, (T, axis, (low, high), speed) in enumerate(
        zip(arm.T_parent_joint, arm.axes, arm.limits, arm.speeds, strict=True)
    ):
        kind = "revolute" if arm.kinds[i] == "revolute" else "prismatic"
        words = " ".join(map(repr, map(float, axis)))
        parts.append(
            f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>{origin(T)}'
            f'<axis xyz="{words}"/><limit lower="{low!r}" upper="{high!r}" velocity="{float(speed)!r}"/></joint>'
        )
    end = len(arm.axes)
    parts.append(
        f'<joint name="to_flange" type="fixed"><parent link="l{end}"/><child link="flange"/>'
        f"{origin(arm.T_last_flange)}</joint>"
    )
    parts.append('<joint name="cable" type="floating"><parent link="l2"/><child link="cable"/></joint>')
    return f'<?xml version="1.0"?><robot name="arm">{"".join(parts)}</robot>'.replace("np.float64", "")


def written(folder: Path, text: str) -> Path:
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_the_arm_is_the_one_that_was_written(tmp_path: Path, scale: float) -> None:
    metres, arm = gt6a_like(1.0), gt6a_like(scale, X)
    text = urdf_of(metres).replace("(", "").replace(")", "")
    found = load_arm(written(tmp_path, text), flange_link="flange", scale=scale, T_flange_sensor=X)
    joints = np.random.default_rng(0).uniform(arm.limits[:, 0], arm.limits[:, 1], (50, 6))
    with jax.enable_x64(True):
        ours, theirs = (np.asarray(forward(of, jax.numpy.asarray(joints))) for of in (found, arm))
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * scale)
    np.testing.assert_allclose(found.limits, arm.limits, atol=1e-12)
    np.testing.assert_allclose(found.speeds, arm.speeds, rtol=1e-12)


def joint(kind: str, more: str = "") -> str:
    return f'<joint name="a" type="{kind}"><parent link="foot"/><child link="hand"/>{more}</joint>'


LIMIT = '<limit lower="-1" upper="2" velocity="0"/>'


def test_kinds_of_joints(tmp_path: Path) -> None:
    for kind, limits in (("continuous", (-np.inf, np.inf)), ("revolute", (-1, 2)), ("prismatic", (-3, 6))):
        origin = '<origin xyz="0 0 1"/>'
        more = '<joint name="b" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="1 0 0"/></joint>'
        text = f"<robot>{joint(kind, origin + LIMIT)}{more}</robot>"
        arm = load_arm(written(tmp_path, text), scale=3.0)
        assert tuple(arm.limits[0]) == limits and arm.kinds == ("prismatic" if kind == "prismatic" else "revolute",)
        np.testing.assert_array_equal(arm.axes, [[1.0, 0.0, 0.0]])
        assert arm.T_parent_joint[0, 2, 3] == 3.0 and arm.T_last_flange[0, 3] == 3.0 and np.isinf(arm.speeds[0])


def revolute(more: str) -> str:
    return f"<robot>{joint('revolute', more)}</robot>"


FAULTS = {
    "is not XML": "<robot><joint>",
    "entities of its own": '<!DOCTYPE robot [<!ENTITY a "b">]><robot/>',
    "outermost element is robot, not sdf": "<sdf/>",
    "xacro macros": '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
    "holds no joint": "<robot/>",
    "lacks its parent": '<robot><joint name="a" type="revolute"><child link="b"/></joint></robot>',
    "has no limit element": revolute(""),
    "of type 'planar'": f"<robot>{joint('planar')}</robot>",
    "mimics another": revolute(LIMIT + '<mimic joint="b"/>'),
    "axis of length zero": revolute(LIMIT + '<axis xyz="0 0 0"/>'),
    "must be 3 finite numbers": revolute(LIMIT + '<axis xyz="0 nan 0"/>'),
    "must be a finite number": revolute('<limit lower="low" upper="1"/>'),
    "expected lower <= upper": revolute('<limit lower="2" upper="1"/>'),
    "negative velocity": revolute('<limit velocity="-1"/>'),
    "no joint between its links foot and hand moves": f"<robot>{joint('fixed')}</robot>",
    "another joint carries already": f"<robot>{2 * joint('revolute', LIMIT)}</robot>",
    "all its links have length zero": revolute(LIMIT),
}


@pytest.mark.parametrize("told", FAULTS)
def test_a_fault_is_one_sentence_with_the_file(tmp_path: Path, told: str) -> None:
    with pytest.raises(InputError) as raised:
        load_arm(written(tmp_path, FAULTS[told]))
    assert told in str(raised.value) and "arm.urdf" in str(raised.value) and "\n" not in str(raised.value)


def test_the_links_must_be_clear(tmp_path: Path) -> None:
    path = written(tmp_path, urdf_of(gt6a_like(1.0)).replace("(", "").replace(")", ""))
    with pytest.raises(InputError, match=r"expected one link for flange_link, but .* are: cable, flange"):
        load_arm(path)
    with pytest.raises(InputError, match="no joint at a link named elbow"):
        load_arm(path, flange_link="elbow")
    with pytest.raises(InputError, match="no chain of joints leads from the link l3 to cable"):
        load_arm(path, base_link="l3", flange_link="cable")
    with pytest.raises(InputError, match="are both l3"):
        load_arm(path, base_link="l3", flange_link="l3")
    with pytest.raises(InputError, match="positive scale"):
        load_arm(path, scale=0.0)
    with pytest.raises(InputError, match="of type 'floating'"):
        load_arm(path, flange_link="cable")
    part = load_arm(path, base_link="l1", flange_link="l3")
    assert part.count == 2
