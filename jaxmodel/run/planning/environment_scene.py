"""An environment seen from inside: sensor, map, where the sensor may go, and the surface that can be seen at all."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.plan.coverage import reachable
from jaxmodel.plan.free_space import free_space
from jaxmodel.plan.label_map import LabelMap, unknown_map
from jaxmodel.plan.surface_samples import SurfaceSamples, sample_surface
from jaxmodel.plan.viewpoints import FixedPoint, even_directions
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.rooms import Environment, cube_room, two_rooms
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import scan_mesh

MARGIN = 2
"""Voxels around the environment."""
TRUE_PLACES, TRUE_DIRECTIONS = 150, 20
"""Views that tell which surface can be seen at all: places in the free space, directions at each."""


@dataclass(frozen=True)
class PlaceOptions:
    """How the environment is looked at.

    ``sensor_at``: where it stands in the cube, in edges from the middle. In the rooms: ``heights`` the sensor may take
    and its ``clearance`` from anything, metres; ``lowest_deg``, ``highest_deg`` of its tilt. ``noise`` of a reading in
    the environment's longest side.
    """

    pixels: int = 160
    field_of_view_deg: float = 60.0
    sensor_at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heights: tuple[float, float] = (0.5, 2.0)
    clearance: float = 0.3
    lowest_deg: float = -60.0
    highest_deg: float = 75.0
    noise: float = 0.0
    samples: int = 12000

    def __post_init__(self) -> None:
        if not 8 <= self.pixels <= 2000:
            raise ValueError(f"pixels is {self.pixels}, expected 8 to 2000")
        if not 0 < self.field_of_view_deg < 170:
            raise ValueError(f"field_of_view_deg is {self.field_of_view_deg}, expected more than 0 and less than 170")
        if not self.heights[0] <= self.heights[1]:
            raise ValueError(f"heights is {self.heights}, expected the lower one first")
        if not self.clearance >= 0:
            raise ValueError(f"clearance is {self.clearance}, expected 0 or more")
        if not -90 <= self.lowest_deg < self.highest_deg <= 90:
            raise ValueError(f"lowest_deg, highest_deg are {self.lowest_deg}, {self.highest_deg}, expected to rise")
        if not 0 <= self.noise < 0.1:
            raise ValueError(f"noise is {self.noise}, expected 0 or more and less than 0.1")
        if self.samples < 100:
            raise ValueError(f"samples is {self.samples}, expected 100 or more")


class EnvironmentScene(NamedTuple):
    """``reachable (n,)``: samples that a sensor anywhere it may go would see."""

    name: str
    environment: Environment
    options: PlaceOptions
    sensor: Sensor
    samples: SurfaceSamples
    reachable: Bool[np.ndarray, " n"]

    def scan(self, T_world_sensor: Float[np.ndarray, "4 4"], key: jax.Array) -> RangeImage:
        """The range image from a pose."""
        mesh, noise = self.environment.mesh, self.options.noise
        vertices = np.asarray(mesh.vertices, np.float64)
        return scan_mesh(vertices, mesh.faces, self.sensor, T_world_sensor, Laser(sigma=noise) if noise else None, key)

    def map(self, voxel: float) -> LabelMap:
        """Nothing known yet, voxels of an edge ``voxel``."""
        vertices = np.asarray(self.environment.mesh.vertices, np.float64)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        x, y, z = (int(np.ceil(side / voxel)) + 2 * MARGIN for side in high - low)
        middle = (low + high) / 2
        return unknown_map(VoxelGrid(middle - voxel * np.array([x, y, z]) / 2, voxel, (x, y, z)))

    def views_at(self, map: LabelMap, T_world_sensor: Float[np.ndarray, "4 4"]) -> Any:
        """The views the sensor can take from where it stands."""
        if self.name == "cube":
            return FixedPoint(T_world_sensor[:3, 3])
        of = self.options
        low, high = self._box()
        return free_space(map, T_world_sensor[:3, 3], low, high, of.clearance, of.lowest_deg, of.highest_deg)

    def _box(self) -> tuple[np.ndarray, np.ndarray]:
        vertices = np.asarray(self.environment.mesh.vertices, np.float64)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        low[2], high[2] = self.options.heights
        return low, high


def environment_scene(name: str, options: PlaceOptions) -> EnvironmentScene:
    """The ``cube`` or the ``two_rooms`` made ready."""
    environment = cube_room(1.0, options.sensor_at) if name == "cube" else two_rooms()
    sensor = Sensor(options.pixels, options.pixels, field_of_view_deg=options.field_of_view_deg)
    samples = sample_surface(environment.mesh, jax.random.key(0), options.samples)
    scene = EnvironmentScene(name, environment, options, sensor, samples, np.ones(len(samples.points), bool))
    poses = _true_views(scene)
    wide = Sensor(options.pixels, options.pixels, field_of_view_deg=90.0)
    return scene._replace(reachable=reachable(samples, environment.mesh, poses, wide))


def _true_views(scene: EnvironmentScene) -> Float[np.ndarray, "v 4 4"]:
    """Views all around from places the sensor could take if it knew the environment."""
    start = scene.environment.T_world_start
    around = FixedPoint(np.zeros(3)).poses(even_directions(TRUE_DIRECTIONS, 0))
    eyes = start[None, :3, 3]
    if scene.name != "cube":
        low, high = scene._box()
        drawn = np.random.default_rng(0).uniform(low, high, (20 * TRUE_PLACES, 3))
        clear = scene.options.clearance
        near = drawn[:, None] + clear * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        free = scene.environment.inside(near.reshape(-1, 3)).reshape(len(drawn), -1).all(axis=1)
        eyes = np.concatenate([eyes, drawn[free][:TRUE_PLACES]])
    poses = np.repeat(around[None], len(eyes), axis=0)
    poses[:, :, :3, 3] += eyes[:, None]
    return poses.reshape(-1, 4, 4)
