"""A small pair with a known motion, of one size class (256), for every test of the registration."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.register.method import IcpMethod
from jaxmodel.register.methods import named


def small(name: str) -> IcpMethod:
    """A published method with tables that are built at once and still fine enough for 250 points."""
    return replace(named(name), cells=48, exact_cells=24)


def pose(rotation_vector: tuple[float, float, float], translation: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    T[:3, 3] = translation
    return T


def moved(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


def bumpy(count: int, phase: float = 0.0) -> np.ndarray:
    """Evenly spaced points on a bumpy closed surface about one unit across that no rotation maps to itself."""
    s = np.arange(count) + 0.5
    z, angle = 1 - 2 * s / count, np.pi * (1 + 5**0.5) * s + phase
    r = np.sqrt(1 - z * z)
    x, y = r * np.cos(angle), r * np.sin(angle)
    radius = 0.5 * (1 + 0.25 * np.sin(5 * x + 1) * np.cos(4 * y) + 0.2 * np.sin(6 * z + x))
    return radius[:, None] * np.stack([x, 0.7 * y, 0.5 * z], axis=1)


@dataclass(frozen=True)
class Pair:
    """``target`` and ``source`` (250, 3) sample one surface; ``near`` is a start 3 degrees and 2 % off the truth."""

    target: np.ndarray
    source: np.ndarray
    T_target_source: np.ndarray
    near: np.ndarray


def _pair(target: np.ndarray, same_surface: np.ndarray) -> Pair:
    T = pose((0.4, -1.1, 0.7), (3.0, -2.0, 1.0))
    source = moved(np.linalg.inv(T), same_surface)
    off = pose((0.03, -0.04, 0.02), (0.01, -0.01, 0.01))
    centre = target.mean(axis=0)
    about = pose((0, 0, 0), tuple(centre)) @ off @ pose((0, 0, 0), tuple(-centre))
    return Pair(target, source, T, about @ T)


@pytest.fixture(scope="session")
def exact_pair() -> Pair:
    """The source's points are the target's own: the true motion leaves no error."""
    target = bumpy(250)
    return _pair(target, np.random.default_rng(0).permutation(target))


@pytest.fixture(scope="session")
def resampled_pair() -> Pair:
    """The source samples the surface elsewhere and lacks a side: partial overlap, no exact correspondence."""
    target = bumpy(250)
    other = bumpy(350, phase=1.0)
    return _pair(target[target[:, 0] < 0.35], other[other[:, 0] > -0.25][:250])
