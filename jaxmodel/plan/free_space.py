"""Views from anywhere a robot can go: five degrees of freedom in the empty, reachable part of a map (thesis §4.3.2)."""

from collections.abc import Sequence
from typing import Any, cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy import ndimage

from jaxmodel.errors import InputError
from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.plan.label_map import LabelMap
from jaxmodel.plan.labels import Label
from jaxmodel.plan.viewpoints import TURNS, ViewSpace, direction_and_right, even_directions, view_pose

ORIENTATIONS = 36
"""Orientations a position, as the earlier method had (thesis §4.3.2)."""


class FreeSpace(ViewSpace):
    """x, y, z, pan and tilt: the sensor in a box ``low`` to ``high`` (world), at voxels where ``free`` holds.

    Tilt runs from ``lowest_deg`` to ``highest_deg`` above the horizon. All five parameters are angles whose sines run
    through the bounds. Make one with :func:`free_space`.
    """

    grid: VoxelGrid
    free: Bool[np.ndarray, "x y z"]
    low: Float[np.ndarray, "3"]
    high: Float[np.ndarray, "3"]
    lowest_deg: float = -90.0
    highest_deg: float = 90.0

    @property
    def dimension(self) -> int:
        """Five."""
        return 5

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        return np.asarray(self.low, np.float64)

    def pose(self, parameter: Float[Array, "5"]) -> Float[Array, "4 4"]:
        place = (self.high - self.low) * (1 + jnp.sin(parameter[:3])) / 2
        low, high = jnp.sin(jnp.deg2rad(self.lowest_deg)), jnp.sin(jnp.deg2rad(self.highest_deg))
        forward, right = direction_and_right(parameter[3], parameter[4], low, high)
        return view_pose(place, forward, -right)

    def spread(self, count: int, seed: int = 0) -> Float[np.ndarray, "n 5"]:
        """Free voxels drawn evenly, each with orientations that together cover the sphere of directions."""
        random = np.random.default_rng(seed)
        keys = np.flatnonzero(self.free & self._in_box())
        if len(keys) == 0:
            return np.zeros((0, 5))
        places = -(-count // ORIENTATIONS)
        chosen = random.permutation(keys)[:places] if places < len(keys) else random.choice(keys, places)
        centres = self.grid.centres(np.sort(chosen))
        turned = [even_directions(ORIENTATIONS, seed * places + k) for k in range(places)]
        return np.concatenate([np.repeat(self.place_of(centres), ORIENTATIONS, axis=0), np.concatenate(turned)], 1)[
            :count
        ]

    def spiral(self, count: int) -> Float[np.ndarray, "n 5"]:
        """The thesis's spiral of orientations at free voxels taken in turn."""
        part = (np.arange(count) + 0.5) / count
        angles = np.stack([2 * np.pi * TURNS * part, np.arcsin(1 - 2 * part)], axis=1)
        keys = np.flatnonzero(self.free & self._in_box())
        if len(keys) == 0:
            return np.zeros((0, 5))
        return np.concatenate([self.place_of(self.grid.centres(keys[(part * len(keys)).astype(int)])), angles], axis=1)

    def spacing(self, count: int) -> Float[np.ndarray, "5"]:
        places = max(1, count // ORIENTATIONS)
        volume = max(float(np.sum(self.free & self._in_box())), 1.0) * self.grid.cell**3
        apart = (volume / places) ** (1 / 3)
        extent = np.maximum(np.asarray(self.high) - np.asarray(self.low), self.grid.cell)
        return np.concatenate(
            [np.minimum(2 * apart / extent, np.pi / 2), np.full(2, np.sqrt(4 * np.pi / ORIENTATIONS))]
        )

    def allowed(self, poses: Float[np.ndarray, "n 4 4"]) -> Bool[np.ndarray, " n"]:
        index = self.grid.indices(poses[:, :3, 3])
        there = self.grid.inside(index)
        result = np.zeros(len(poses), bool)
        result[there] = self.free[tuple(index[there].T)]
        return result

    def likeness(
        self, poses: Float[np.ndarray, "n 4 4"], taken: Sequence[Float[np.ndarray, "4 4"]]
    ) -> Float[np.ndarray, " n"]:
        """Zero: from elsewhere the same direction shows something else."""
        return np.zeros(len(poses))

    def place_of(self, eyes: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The three parameters of positions."""
        extent = np.asarray(self.high) - np.asarray(self.low)
        part = np.where(extent > 0, (eyes - self.low) / np.where(extent > 0, extent, 1), 0.5)
        return np.arcsin(np.clip(2 * part - 1, -1, 1))

    def near(self, eye: Float[np.ndarray, "3"], distance: float) -> "FreeSpace":
        """The part of this space within ``distance`` of a position."""
        centres = self.grid.centres(np.arange(self.free.size)).reshape(*self.free.shape, 3)
        return eqx.tree_at(lambda s: s.free, self, self.free & (np.linalg.norm(centres - eye, axis=-1) <= distance))

    def _in_box(self) -> Bool[np.ndarray, "x y z"]:
        """Voxels whose centre lies in the box, or that hold it where it is thinner than a voxel."""
        axes = []
        for axis in range(3):
            centre = self.grid.origin[axis] + (np.arange(self.grid.shape[axis]) + 0.5) * self.grid.cell
            half = self.grid.cell / 2
            axes.append((centre >= self.low[axis] - half) & (centre <= self.high[axis] + half))
        return axes[0][:, None, None] & axes[1][None, :, None] & axes[2][None, None, :]


def free_space(
    map: LabelMap,
    eye: Float[np.ndarray, "3"],
    low: Float[np.ndarray, "3"],
    high: Float[np.ndarray, "3"],
    clearance: float = 0.0,
    lowest_deg: float = -90.0,
    highest_deg: float = 90.0,
) -> FreeSpace:
    """The views a robot at ``eye`` can reach: empty voxels at least ``clearance`` from anything else, joined to it.

    Lengths in the unit of the data, the box ``low`` to ``high`` in the world frame. The robot's own voxel is free.
    Raises :class:`InputError` for a box turned inside out or a sensor inside something occupied.
    """
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low <= high).all()):
        raise InputError(f"The box a sensor may move in must run from its low to its high corner, not {low} to {high}.")
    if not clearance >= 0:
        raise InputError(f"The clearance of a sensor must be a length of zero or more, not {clearance}.")
    index = map.grid.indices(np.asarray(eye, np.float64)[None])[0]
    if not map.grid.inside(index[None])[0]:
        raise InputError(f"The sensor at {np.round(eye, 4).tolist()} is outside the map.")
    labels = map.labels
    here = tuple(index)
    if labels[here] in (Label.OCCUPIED, Label.BORDER):
        raise InputError(f"The sensor at {np.round(eye, 4).tolist()} is inside something the map holds as occupied.")
    empty = labels == Label.EMPTY
    empty[here] = True
    # beyond the map nothing is known to be in the way
    room = np.asarray(ndimage.distance_transform_edt(np.pad(empty, 1, constant_values=map.open_outside)))
    room = room[1:-1, 1:-1, 1:-1]
    wide = empty & (room * map.grid.cell > clearance)
    passable = wide
    if not wide[here]:
        # a robot that stands too close to something may still leave, never closer than it stands
        close = np.zeros_like(empty)
        reach = int(np.ceil(clearance / map.grid.cell)) + 1
        close[tuple(slice(max(0, i - reach), i + reach + 1) for i in here)] = True
        passable = wide | (empty & close & (room >= room[here]))
        wide[here] = True
    component = np.asarray(cast(Any, ndimage.label(passable))[0])
    return FreeSpace(map.grid, wide & (component == component[here]), low, high, lowest_deg, highest_deg)
