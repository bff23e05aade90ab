"""Views of solids whose edges are known, for the tests of edges."""

from functools import lru_cache
from typing import NamedTuple

import jax
import numpy as np

from jaxmodel.control_points.edge_score import EdgeTruth, edge_truth
from jaxmodel.scan.known_solids import before_a_wall, known_solid
from jaxmodel.scan.noise import Laser, with_noise
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays
from jaxmodel.scan.virtual_scanner import look_at, scan_mesh
from jaxmodel.scan.visible_edges import visible_edges

SENSOR = Sensor(width=200, height=200)


class View(NamedTuple):
    image: RangeImage
    truth: EdgeTruth


def pose(seed: int) -> np.ndarray:
    """A sensor three sizes away, anywhere between 20 and 65 degrees above, turned anyhow about its axis."""
    rng = np.random.default_rng([20, seed])
    around, up = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(20, 65))
    place = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    return look_at(3.0 * place, np.zeros(3), rng.normal(size=3))


def view(name: str, sigma: float, seed: int, wall: bool = False, sensor: Sensor = SENSOR) -> View:
    """A solid as a laser of that noise sees it, with its true edges."""
    return View(_scan(name, sigma, seed, wall, sensor), _truth(name, seed, wall, sensor))


def _scan(name: str, sigma: float, seed: int, wall: bool, sensor: Sensor) -> RangeImage:
    mesh = before_a_wall(known_solid(name)) if wall else known_solid(name)
    laser = Laser(sigma=sigma, unit="data")
    return scan_mesh(mesh.vertices, mesh.faces, sensor, pose(seed), laser, jax.random.key(seed))


@lru_cache
def _truth(name: str, seed: int, wall: bool, sensor: Sensor) -> EdgeTruth:
    mesh = before_a_wall(known_solid(name)) if wall else known_solid(name)
    edges = visible_edges(mesh, sensor, pose(seed))
    return edge_truth(_scan(name, 0.0, seed, wall, sensor), edges, 1 / sensor.focal_px)


def ball_image(sigma: float, seed: int, sensor: Sensor = SENSOR) -> RangeImage:
    """A true sphere of diameter 1, three away, with laser noise."""
    rays = pixel_rays(sensor)
    start = rays.origins - np.array([0.0, 0.0, 3.0])
    along = np.sum(start * rays.directions, axis=-1)
    left = along**2 - np.sum(start**2, axis=-1) + 0.25
    hit = left > 0
    distance = np.where(hit, -along - np.sqrt(np.where(hit, left, 0.0)), np.nan)
    points = rays.origins + distance[..., None] * rays.directions
    normals = 2 * (points - np.array([0.0, 0.0, 3.0]))
    cosine = np.where(hit, -np.sum(np.where(hit[..., None], normals, 0.0) * rays.directions, axis=-1), 1.0)
    clean = RangeImage(points, hit, sensor.eye)
    return with_noise(jax.random.key(seed), clean, cosine, Laser(sigma=sigma, unit="data"))
