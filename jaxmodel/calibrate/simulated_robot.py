"""A simulated five-axis Cartesian robot with a camera on its hand, and the noise of poses measured in images.

It stands for the robot of RR-3507 §3.6 (three sliding axes, two turning ones), which is not available. Camera poses err
as those of a bundle adjustment do: their covariance comes from the pixels' noise, with the points known (a target) or
unknown (a scene, whose scale and frame then stay free).
"""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3
from jaxmodel.geometry.arrays import AnyArray

Trajectory = Literal["far", "exponential", "near"]


class Image(NamedTuple):
    """The camera: focal length and standard deviation of a measured point, both in pixels."""

    focal: float
    noise: float


def look(
    pan_tilt: Float[np.ndarray, "n 2"], distance: Float[np.ndarray, " n"], T_hand_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 4 4"]:
    """T_base_hand with the given turns (rad) of the two last axes, placed so that the camera looks at the origin."""
    R = Rotation.from_euler("ZX", pan_tilt).as_matrix()
    along = R @ T_hand_camera[:3, 2]
    return se3.compose(R, -distance[:, None] * along - R @ T_hand_camera[:3, 3])


def far_positions(
    spread: Float[np.ndarray, "m 3"], count: int, T_hand_camera: Float[np.ndarray, "4 4"], reach: tuple[float, float]
) -> Float[np.ndarray, "c 4 4"]:
    """``count`` of m candidate positions, each as far in rotation from the one before as those left allow.

    ``spread`` are uniform numbers (pan, tilt, distance); ``reach`` the largest pan and tilt (rad). Distances are 0.4 to
    0.6. Large turns between stations are what Tsai and Lenz ask for.
    """
    hand = look((2 * spread[:, :2] - 1) * reach, 0.4 + 0.2 * spread[:, 2], T_hand_camera)
    chosen, left = [0], np.ones(len(hand), bool)
    for _ in range(count - 1):
        left[chosen[-1]] = False
        angle = se3.rotation_angle_deg(hand[chosen[-1], :3, :3].T @ hand[:, :3, :3])
        chosen.append(int(np.argmax(np.where(left, angle, -1.0))))
    return hand[chosen]


def exponential_positions(
    T_hand_camera: Float[np.ndarray, "4 4"], turn: float, small: float, steps: int, decay: float
) -> Float[np.ndarray, "n 4 4"]:
    """Two large motions about unlike axes, then ``steps`` whose joint coordinates all decay as ``exp(-decay k)``.

    ``turn`` (rad) is that of the large motions, ``small`` that of all small ones together.
    """
    stations = np.array([[0.0, 0.0], [turn, 0.0], [turn, -turn], [turn - small, 0.7 * small - turn]])
    hand = look(stations, np.array([0.5, 0.55, 0.5, 0.45]), T_hand_camera)
    left = np.exp(-decay * np.arange(1, steps + 1))[:, None]
    pan_tilt = stations[3] + left * (stations[2] - stations[3])
    place = hand[3, :3, 3] + left * (hand[2, :3, 3] - hand[3, :3, 3])
    approach = se3.compose(Rotation.from_euler("ZX", pan_tilt).as_matrix(), place)
    return np.concatenate([hand[:3], approach])


def near_positions(
    spread: Float[np.ndarray, "n 3"], step: float, T_hand_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 4 4"]:
    """Positions that each turn by about ``step`` (rad) from the one before, in directions drawn at random."""
    direction = 2 * np.pi * spread[:, 0]
    walk = np.cumsum(step * np.stack([np.cos(direction), np.sin(direction)], axis=1), axis=0)
    return look(walk, 0.45 + 0.1 * spread[:, 2], T_hand_camera)


def camera_poses(
    hand: Float[np.ndarray, "n 4 4"], T_hand_camera: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n 4 4"]:
    """T_camera_base of each position."""
    return se3.inverse(hand @ T_hand_camera)


def board(camera: Float[np.ndarray, "n 4 4"], rows: int = 7, square: float = 0.03) -> Float[np.ndarray, "m 3"]:
    """Corners of a flat target at the origin that faces the cameras."""
    grid = square * (np.stack(np.meshgrid(np.arange(rows), np.arange(rows)), -1).reshape(-1, 2) - (rows - 1) / 2)
    view = camera[:, 2, :3].mean(axis=0)
    first = np.cross(view, np.eye(3)[np.argmin(np.abs(view))])
    frame = np.stack([first / np.linalg.norm(first), np.cross(view, first) / np.linalg.norm(np.cross(view, first))])
    return grid @ frame


def _derivatives(
    camera: Float[np.ndarray, "n 4 4"], points: Float[np.ndarray, "m 3"], image: Image
) -> tuple[Float[np.ndarray, "n m 2 6"], Float[np.ndarray, "n m 2 3"]]:
    """Of the pixels, in standard deviations, by each pose's (turn, shift), ``exp(d) R``, ``t + e``, and by points."""
    turned = np.einsum("nij,mj->nmi", camera[:, :3, :3], points)
    x, y, z = np.moveaxis(turned + camera[:, None, :3, 3], -1, 0)
    zero = np.zeros_like(z)
    project = np.stack([np.stack([1 / z, zero, -x / z**2], -1), np.stack([zero, 1 / z, -y / z**2], -1)], -2)
    project *= image.focal / image.noise
    a, b, c = np.moveaxis(turned, -1, 0)
    lever = np.stack(
        [np.stack([zero, c, -b], -1), np.stack([-c, zero, a], -1), np.stack([b, -a, zero], -1)], -2
    )  # d x v = lever d
    return np.concatenate([project @ lever, project], axis=-1), project @ camera[:, None, :3, :3]


def seen(
    camera: Float[np.ndarray, "n 4 4"],
    points: Float[np.ndarray, "m 3"],
    image: Image,
    drawn: Float[np.ndarray, " k"],
    points_known: bool,
) -> Float[np.ndarray, "n 4 4"]:
    """T_camera_target as measured: the errors of a bundle adjustment to first order; ``drawn`` are 6 n normals.

    With unknown points the poses err together, and their common frame and scale are left as they are.
    """
    n = len(camera)
    by_pose, by_point = _derivatives(camera, points, image)
    own = np.einsum("nmki,nmkj->nij", by_pose, by_pose)
    if points_known:
        values, vectors = np.linalg.eigh(own)
        error = np.einsum("nij,nj->ni", vectors, drawn[: 6 * n].reshape(n, 6) / np.sqrt(values))
    else:
        information = np.zeros((n, 6, n, 6))
        information[np.arange(n), :, np.arange(n)] = own
        W = np.einsum("nmki,nmkj->mnij", by_pose, by_point)
        V = np.einsum("nmki,nmkj->mij", by_point, by_point)
        information -= np.einsum("mnij,mjk,mplk->nipl", W, np.linalg.inv(V), W, optimize=True)
        values, vectors = np.linalg.eigh(information.reshape(6 * n, 6 * n))
        free = 7  # three turns, three shifts and the scale of the whole scene
        error = (vectors[:, free:] @ (drawn[: 6 * n - free] / np.sqrt(values[free:]))).reshape(n, 6)
    turn = Rotation.from_rotvec(error[:, :3]).as_matrix()
    return se3.compose(turn @ camera[:, :3, :3], camera[:, :3, 3] + error[:, 3:])


def consecutive(poses: Float[AnyArray, "n 4 4"], of_camera: bool) -> Float[np.ndarray, "k 4 4"]:
    """Motions between neighbours, A of the camera's poses or B of the hand's (``motions.py``)."""
    if of_camera:
        return poses[1:] @ se3.inverse(poses[:-1])
    return se3.inverse(poses[1:]) @ poses[:-1]
