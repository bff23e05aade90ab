"""Where a sweep begins: sets of initial poses T_target_source."""

from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

Translation = Literal["centroids", "zero"]


def euler_rotations(steps: int = 10) -> Float[np.ndarray, "s 3 3"]:
    """The thesis's grid (§2.9.2): all triples of ``steps`` Euler angles (fixed axes x, y, z) evenly around 360 degrees.

    Since (a, b, c) and (a + 180, 180 - b, c + 180) are the same rotation, an even number of steps gives half as many
    distinct rotations as triples (ERRATA): see ``basin.distinct``.
    """
    angles = np.arange(steps) * (360.0 / steps)
    triples = np.stack(np.meshgrid(angles, angles, angles, indexing="ij"), axis=-1).reshape(-1, 3)
    return Rotation.from_euler("xyz", triples, degrees=True).as_matrix()


def even_rotations(count: int) -> Float[np.ndarray, "s 3 3"]:
    """``count`` rotations spread evenly over SO(3): a super-Fibonacci spiral on the unit quaternions.

    M. Alexa, "Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3)", CVPR 2022. All are distinct.
    """
    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(count) + 0.5
    r, R = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2.0 * np.pi * s / phi, 2.0 * np.pi * s / psi
    xyzw = np.stack([r * np.sin(alpha), r * np.cos(alpha), R * np.sin(beta), R * np.cos(beta)], axis=-1)
    return Rotation.from_quat(xyzw).as_matrix()


def starts_from_rotations(
    rotations: Float[np.ndarray, "s 3 3"],
    target_points: Float[np.ndarray, "m 3"],
    source_points: Float[np.ndarray, "n 3"],
    translation: Translation = "centroids",
) -> Float[np.ndarray, "s 4 4"]:
    """Poses with the given rotations.

    ``centroids``: turn about the source's centroid and bring the two centroids together; ``zero``: t = 0, as the thesis
    prints (both scans about their own origins).
    """
    T = np.tile(np.eye(4), (len(rotations), 1, 1))
    T[:, :3, :3] = rotations
    if translation == "centroids":
        T[:, :3, 3] = np.mean(target_points, axis=0) - rotations @ np.mean(source_points, axis=0)
    return T


def euler_starts(
    target_points: Float[np.ndarray, "m 3"],
    source_points: Float[np.ndarray, "n 3"],
    steps: int = 10,
    translation: Translation = "centroids",
) -> Float[np.ndarray, "s 4 4"]:
    """``steps`` cubed starts on the thesis's Euler grid."""
    return starts_from_rotations(euler_rotations(steps), target_points, source_points, translation)


def even_starts(
    target_points: Float[np.ndarray, "m 3"],
    source_points: Float[np.ndarray, "n 3"],
    count: int = 1000,
    translation: Translation = "centroids",
) -> Float[np.ndarray, "s 4 4"]:
    """``count`` starts whose rotations are spread evenly over SO(3)."""
    return starts_from_rotations(even_rotations(count), target_points, source_points, translation)


def plausible_starts(
    T_target_source: Float[np.ndarray, "4 4"],
    source_centroid: Float[np.ndarray, "3"],
    count: int,
    seed: int,
    spread_deg: float,
    shift: float,
    most_deg: float = 180.0,
) -> Float[np.ndarray, "s 4 4"]:
    """Starts as a person who lines two scans up by eye would give them (our reading of §2.9.2, which does not say).

    The source is put at its true pose, turned about its centroid around a random axis, and moved.

    Args:
        T_target_source: the true pose.
        source_centroid: mean of the source's points, its frame.
        count: how many.
        seed: start i draws from ``[seed, i]``, so it is the same however many there are.
        spread_deg: the angle is the absolute value of a normal draw with this standard deviation: its median is two
            thirds of it, one angle in twenty is beyond twice of it. Draws beyond ``most_deg`` are made again.
        shift: radius of the ball the translation is drawn from uniformly, unit of the data.
        most_deg: largest angle.
    """
    T = np.tile(np.eye(4), (count, 1, 1))
    for i in range(count):
        draw = np.random.default_rng([seed, i])
        axis, direction = draw.normal(size=3), draw.normal(size=3)
        angle = abs(draw.normal()) * spread_deg
        while angle > most_deg:
            angle = abs(draw.normal()) * spread_deg
        turn = Rotation.from_rotvec(np.radians(angle) * axis / np.linalg.norm(axis)).as_matrix()
        moved = shift * draw.uniform() ** (1 / 3) * direction / np.linalg.norm(direction)
        T[i, :3, :3] = turn @ T_target_source[:3, :3]
        centre = T_target_source[:3, :3] @ source_centroid + T_target_source[:3, 3]
        T[i, :3, 3] = centre + moved - T[i, :3, :3] @ source_centroid
    return T
