"""Motions with a known X, exact or noisy."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


def motion(rotation_vector: ArrayLike, translation: ArrayLike) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.asarray(rotation_vector, float)).as_matrix()
    T[:3, 3] = np.asarray(translation, float)
    return T


class Simulation:
    """Draws of motions and their conjugates; everything from one generator."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def unit(self) -> np.ndarray:
        v = self.rng.normal(size=3)
        return v / np.linalg.norm(v)

    def X(self, angle: float | None = None) -> np.ndarray:
        angle = self.rng.uniform(0, np.pi) if angle is None else angle
        return motion(angle * self.unit(), self.rng.normal(size=3))

    def spread_axes(self, n: int) -> np.ndarray:
        """Unit axes of which the first two are at least 30 degrees apart."""
        while True:
            axes = np.stack([self.unit() for _ in range(n)])
            if n < 2 or abs(axes[0] @ axes[1]) < np.cos(np.radians(30)):
                return axes

    def motions(self, n: int, angle: float | tuple[float, float] = (0.5, 2.5), length: float = 1.0) -> np.ndarray:
        low, high = angle if isinstance(angle, tuple) else (angle, angle)
        angles = self.rng.uniform(low, high, size=n)
        return np.stack(
            [
                motion(a * axis, length * self.rng.normal(size=3))
                for a, axis in zip(angles, self.spread_axes(n), strict=True)
            ]
        )

    def noisy(self, motions: np.ndarray, rotation: float, translation: float) -> np.ndarray:
        flat = motions.reshape(-1, 4, 4).copy()
        turns = Rotation.from_rotvec(rotation * self.rng.normal(size=(len(flat), 3))).as_matrix()
        flat[:, :3, :3] = turns @ flat[:, :3, :3]
        flat[:, :3, 3] += translation * self.rng.normal(size=(len(flat), 3))
        return flat.reshape(motions.shape)


def conjugate(X: np.ndarray, B: np.ndarray) -> np.ndarray:
    return X @ B @ np.linalg.inv(X)


def errors(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Angle (rad) and relative distance between two X."""
    turn = Rotation.from_matrix(found[:3, :3] @ true[:3, :3].T).magnitude()
    return float(turn), float(np.linalg.norm(found[:3, 3] - true[:3, 3]) / np.linalg.norm(true[:3, 3]))
