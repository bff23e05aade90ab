"""Pose files with a known answer, as a user would write them."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.motions import Setup
from jaxmodel.geometry import se3

NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")


def motion(rotation_vector_deg: object, translation: object) -> np.ndarray:
    R = Rotation.from_rotvec(np.radians(np.asarray(rotation_vector_deg, float))).as_matrix()
    return se3.compose(R, np.asarray(translation, float))


X = motion([3.0, -4.0, 88.0], [0.05, -0.03, 0.08])
Z = motion([170.0, 10.0, -5.0], [0.6, 0.1, 0.02])


def streams(setup: Setup = Setup.EYE_IN_HAND, n: int = 12, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Exact poses of a hand that turns by up to 60 degrees about every axis, and what the camera gives."""
    draw = np.random.default_rng(seed)
    hand = np.stack([motion(draw.uniform(-60, 60, 3), draw.uniform(-0.3, 0.3, 3)) for _ in range(n)])
    return hand, camera_of(hand, setup)


def camera_of(hand: np.ndarray, setup: Setup) -> np.ndarray:
    """The camera's poses of a set-up with X and Z above."""
    if setup is Setup.EYE_TO_HAND:
        return se3.inverse(X) @ hand @ Z
    seen = se3.inverse(hand @ X) @ Z
    return se3.inverse(seen) if setup is Setup.MOVING_FRAMES else seen


def noisy(poses: np.ndarray, degrees: float = 0.1, metres: float = 0.001, seed: int = 1) -> np.ndarray:
    draw = np.random.default_rng(seed)
    errors = [motion(degrees * draw.normal(size=3), np.zeros(3)) for _ in poses]
    moved = np.stack([error[:3, :3] @ T[:3, :3] for error, T in zip(errors, poses, strict=True)])
    return se3.compose(moved, poses[:, :3, 3] + metres * draw.normal(size=(len(poses), 3)))


def write(path: Path, *, times: np.ndarray | None = None, groups: object = None, **of: np.ndarray) -> Path:
    """A table with names: ``hand=`` and ``camera=`` in one file, or one of them; the hand's alone has plain names."""
    prefix = {name: "" if len(of) == 1 else f"{name}_" for name in of}
    head = [*(["t"] if times is not None else []), *(["group"] if groups is not None else [])]
    head += [f"{prefix[name]}{column}" for name in of for column in NAMES]
    lines = [",".join(head)]
    for k in range(len(next(iter(of.values())))):
        values = [] if times is None else [repr(float(times[k]))]
        values += [] if groups is None else [str(groups[k])]  # pyright: ignore[reportIndexIssue]
        for poses in of.values():
            turn = Rotation.from_matrix(poses[k][:3, :3]).as_quat()
            values += [repr(float(v)) for v in (*poses[k][:3, 3], *turn)]
        lines.append(",".join(values))
    path.write_text("\n".join(lines) + "\n")
    return path
