"""The views a sensor may take: an observation sphere, a circle on it, a fixed point, free space (thesis §4.3.2, §4.5).

A view space turns unconstrained parameters, which an optimiser may move freely, into poses; it proposes views that
cover it evenly and the thesis's spiral, and says which poses are allowed. Angles in radian, lengths in the unit of the
data. Poses are ``T_world_sensor``, the sensor's z along its view, its x level.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxmodel.errors import InputError

GOLDEN = np.pi * (3 - np.sqrt(5))
TURNS = 6
"""Turns of the spiral from one end of its band to the other."""


class ViewSpace(eqx.Module):
    """Poses by parameters ``(d,)``."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """How many parameters a view has."""

    @property
    @abstractmethod
    def origin(self) -> Float[np.ndarray, "3"]:
        """World point that :meth:`pose` measures from, so that float32 loses nothing to a far origin."""

    @abstractmethod
    def pose(self, parameter: Float[Array, " d"]) -> Float[Array, "4 4"]:
        """``T_world_sensor`` of a view, its translation from :attr:`origin`; smooth in its parameter."""

    @abstractmethod
    def spread(self, count: int, seed: int = 0) -> Float[np.ndarray, "n d"]:
        """``count`` views that cover the space evenly."""

    @abstractmethod
    def spiral(self, count: int) -> Float[np.ndarray, "n d"]:
        """``count`` views along the thesis's spiral (Fig. 4.6)."""

    @abstractmethod
    def spacing(self, count: int) -> Float[np.ndarray, " d"]:
        """How far apart ``count`` evenly spread views lie, in each parameter."""

    def allowed(self, poses: Float[np.ndarray, "n 4 4"]) -> Bool[np.ndarray, " n"]:
        """Which poses the sensor may take."""
        return np.ones(len(poses), bool)

    def likeness(
        self, poses: Float[np.ndarray, "n 4 4"], taken: Sequence[Float[np.ndarray, "4 4"]]
    ) -> Float[np.ndarray, " n"]:
        """How much each pose looks along one of those taken: the largest cosine between their views."""
        forward = np.stack([T[:3, 2] for T in taken])
        return np.max(poses[:, :3, 2] @ forward.T, axis=1)

    def poses(self, parameters: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 4 4"]:
        """Poses of many views, float64, their rotations exact."""
        poses = np.asarray(_many(self, jnp.asarray(parameters, jnp.float32)), np.float64)
        forward = poses[:, :3, 2] / np.linalg.norm(poses[:, :3, 2], axis=1, keepdims=True)
        right = poses[:, :3, 0] - np.sum(poses[:, :3, 0] * forward, axis=1, keepdims=True) * forward
        right /= np.linalg.norm(right, axis=1, keepdims=True)
        poses[:, :3, :3] = np.stack([right, np.cross(forward, right), forward], axis=2)
        poses[:, :3, 3] += self.origin
        return poses


@jax.jit
def _many(space: ViewSpace, parameters: Float[Array, "n d"]) -> Float[Array, "n 4 4"]:
    return jax.vmap(lambda parameter: space.pose(parameter))(parameters)


class ObservationSphere(ViewSpace):
    """Views from a sphere towards its ``centre``, no lower than ``lowest_deg`` above the horizon, in two parameters.

    Azimuth, and an angle whose sine runs from the lowest height to the pole: no value is out of bounds.
    """

    centre: Float[np.ndarray, "3"]
    radius: float
    lowest_deg: float = -90.0

    def __check_init__(self) -> None:
        if not self.radius > 0:
            raise InputError(f"The radius of an observation sphere must be a positive length, not {self.radius}.")
        if not -90 <= self.lowest_deg < 90:
            raise InputError(f"The lowest elevation of a view must be from -90 to below 90 degrees: {self.lowest_deg}.")

    @property
    def dimension(self) -> int:
        """Two: azimuth and height."""
        return 2

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        return np.asarray(self.centre, np.float64)

    def pose(self, parameter: Float[Array, "2"]) -> Float[Array, "4 4"]:
        away, right = direction_and_right(parameter[0], parameter[1], jnp.sin(jnp.deg2rad(self.lowest_deg)), 1.0)
        return view_pose(self.radius * away, -away, right)

    def spread(self, count: int, seed: int = 0) -> Float[np.ndarray, "n 2"]:
        return even_directions(count, seed)

    def spiral(self, count: int) -> Float[np.ndarray, "n 2"]:
        return _spiral(count)

    def spacing(self, count: int) -> Float[np.ndarray, "2"]:
        return _spacing(count)

    def parameter_of(self, eye: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
        """Parameters of the view on the ray from the centre to ``eye``."""
        return _parameter_of(np.asarray(eye, np.float64) - self.centre, np.sin(np.deg2rad(self.lowest_deg)), 1.0)


class Circle(ViewSpace):
    """Views from a circle of an observation sphere, around ``axis`` at ``angle_deg`` from it, in one parameter."""

    centre: Float[np.ndarray, "3"]
    radius: float
    axis: Float[np.ndarray, "3"]
    angle_deg: float

    @property
    def dimension(self) -> int:
        """One: the angle along the circle."""
        return 1

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        return np.asarray(self.centre, np.float64)

    def pose(self, parameter: Float[Array, "1"]) -> Float[Array, "4 4"]:
        axis = self.axis / jnp.linalg.norm(self.axis)
        first = jnp.cross(axis, jnp.eye(3)[jnp.argmin(jnp.abs(axis))])
        first = first / jnp.linalg.norm(first)
        second = jnp.cross(axis, first)
        lift = jnp.deg2rad(self.angle_deg)
        around = jnp.cos(parameter[0]) * first + jnp.sin(parameter[0]) * second
        away = jnp.cos(lift) * axis + jnp.sin(lift) * around
        along = jnp.cos(parameter[0]) * second - jnp.sin(parameter[0]) * first
        return view_pose(self.radius * away, -away, along)

    def spread(self, count: int, seed: int = 0) -> Float[np.ndarray, "n 1"]:
        return (2 * np.pi * (np.arange(count) + np.random.default_rng(seed).random()) / count)[:, None]

    def spiral(self, count: int) -> Float[np.ndarray, "n 1"]:
        return self.spread(count)

    def spacing(self, count: int) -> Float[np.ndarray, "1"]:
        return np.array([2 * np.pi / count])


class FixedPoint(ViewSpace):
    """Pan and tilt of a sensor that stays at ``position`` (Figs 4.5 to 4.8): two parameters, as on a sphere."""

    position: Float[np.ndarray, "3"]

    @property
    def dimension(self) -> int:
        """Two: pan and tilt."""
        return 2

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        return np.asarray(self.position, np.float64)

    def pose(self, parameter: Float[Array, "2"]) -> Float[Array, "4 4"]:
        forward, right = direction_and_right(parameter[0], parameter[1], -1.0, 1.0)
        return view_pose(jnp.zeros(3), forward, -right)

    def spread(self, count: int, seed: int = 0) -> Float[np.ndarray, "n 2"]:
        return even_directions(count, seed)

    def spiral(self, count: int) -> Float[np.ndarray, "n 2"]:
        return _spiral(count)

    def spacing(self, count: int) -> Float[np.ndarray, "2"]:
        return _spacing(count)

    def parameter_of(self, forward: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
        """Parameters of the view along ``forward``."""
        return _parameter_of(np.asarray(forward, np.float64), -1.0, 1.0)


class Restricted:
    """A view space of which only some poses may be taken, as those an arm reaches.

    ``permits`` maps poses ``(n, 4, 4)`` to a mask ``(n,)``.
    """

    def __init__(self, space: Any, permits: Callable[[np.ndarray], np.ndarray]) -> None:
        self.space = space
        self.permits = permits

    def __getattr__(self, name: str) -> Any:
        return getattr(self.space, name)

    def allowed(self, poses: Float[np.ndarray, "n 4 4"]) -> Bool[np.ndarray, " n"]:
        """Poses allowed by the space and permitted here."""
        return np.asarray(self.space.allowed(poses)) & np.asarray(self.permits(poses))


def direction_and_right(azimuth: Any, height: Any, low: Any, high: Any) -> Any:
    """Unit direction whose z runs from ``low`` to ``high`` as the sine of ``height``, and the level direction east."""
    z = low + (high - low) * (1 + jnp.sin(height)) / 2
    # the root keeps its slope where the pole is reached: (1 - z)(1 + z) in terms of half angles
    level = jnp.sqrt(jnp.maximum((1 - z) * (1 + z), 1e-12))
    east = jnp.stack([-jnp.sin(azimuth), jnp.cos(azimuth), jnp.zeros_like(azimuth)])
    return jnp.stack([level * jnp.cos(azimuth), level * jnp.sin(azimuth), z]), east


def view_pose(eye, forward, right):
    rotation = jnp.stack([right, jnp.cross(forward, right), forward], axis=1)
    return jnp.concatenate([jnp.concatenate([rotation, eye[:, None]], axis=1), jnp.array([[0.0, 0.0, 0.0, 1.0]])])


def even_directions(count: int, seed: int) -> Float[np.ndarray, "n 2"]:
    """Fibonacci's lattice: even in z, golden angle in azimuth."""
    rank = np.arange(count)
    turn = 2 * np.pi * np.random.default_rng(seed).random()
    return np.stack([(rank * GOLDEN + turn) % (2 * np.pi), np.arcsin(1 - (2 * rank + 1) / count)], axis=1)


def _spiral(count: int) -> Float[np.ndarray, "n 2"]:
    """From the upper end to the lower, ``TURNS`` times around."""
    part = (np.arange(count) + 0.5) / count
    return np.stack([2 * np.pi * TURNS * part, np.arcsin(1 - 2 * part)], axis=1)


def _spacing(count: int) -> Float[np.ndarray, "2"]:
    return np.full(2, np.sqrt(4 * np.pi / count))


def _parameter_of(direction: Float[np.ndarray, "3"], low: float, high: float) -> Float[np.ndarray, "2"]:
    x, y, z = direction / np.linalg.norm(direction)
    return np.array([np.arctan2(y, x), np.arcsin(np.clip(2 * (z - low) / (high - low) - 1, -1, 1))])
