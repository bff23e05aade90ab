"""An object on its observation sphere: sensor, views, first map, and the surface that can be seen at all."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.errors import InputError
from jaxmodel.plan.coverage import reachable
from jaxmodel.plan.label_map import LabelMap, object_map
from jaxmodel.plan.surface_samples import SurfaceSamples, sample_surface
from jaxmodel.plan.viewpoints import ObservationSphere
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh
from jaxmodel.scan.virtual_scanner import scan_mesh

CLOSEST = 0.55
"""Least radius of an observation sphere, in diameters of the object: no sensor stands inside it."""


@dataclass(frozen=True)
class SceneOptions:
    """How the object is looked at.

    ``pixels`` across and ``field_of_view_deg`` of the sensor; ``distance`` of the sphere of views from the object's
    middle, in the diameters of the ball the object lies in; ``lowest_deg`` elevation of a view; ``nearest``,
    ``farthest`` reading, in the same diameters, None for no limit; ``cells`` of the map along an edge; ``samples``
    points on the surface and ``reaching`` views that coverage is counted with.
    """

    pixels: int = 200
    field_of_view_deg: float = 40.0
    distance: float = 1.6
    lowest_deg: float = -90.0
    nearest: float | None = None
    farthest: float | None = None
    cells: int = 64
    samples: int = 8000
    reaching: int = 1000

    def __post_init__(self) -> None:
        least = {"pixels": 8, "cells": 8, "samples": 100, "reaching": 1}
        for key, value in least.items():
            if getattr(self, key) < value:
                raise ValueError(f"{key} is {getattr(self, key)}, expected {value} or more")
        if not self.distance >= CLOSEST:
            raise ValueError(
                f"distance is {self.distance}, expected {CLOSEST} or more: nearer, the sensor is inside the object"
            )
        if not 0 < self.field_of_view_deg < 170:
            raise ValueError(f"field_of_view_deg is {self.field_of_view_deg}, expected more than 0 and less than 170")
        if not -90 <= self.lowest_deg < 90:
            raise ValueError(f"lowest_deg is {self.lowest_deg}, expected -90 or more and less than 90")
        if self.nearest is not None and self.farthest is not None and not self.nearest < self.farthest:
            raise ValueError(f"nearest is {self.nearest}, expected less than farthest, {self.farthest}")


class ObjectScene(NamedTuple):
    """``reachable (n,)`` samples of the surface that at least one of the views sees; ``size``: diameter of the ball
    around the object.
    """

    name: str
    mesh: ObjectMesh
    size: float
    sensor: Sensor
    sphere: ObservationSphere
    map: LabelMap
    samples: SurfaceSamples
    reachable: Bool[np.ndarray, " n"]

    def scan(self, T_world_sensor: Float[np.ndarray, "4 4"], noise: float, key: jax.Array) -> RangeImage:
        """The range image from a pose; ``noise`` (standard deviation along the ray) in the object's longest side."""
        model = Laser(sigma=noise) if noise > 0 else None
        vertices = np.asarray(self.mesh.vertices, np.float64)
        return scan_mesh(vertices, self.mesh.faces, self.sensor, T_world_sensor, model, key)


def object_scene(name: str, mesh: ObjectMesh, options: SceneOptions) -> ObjectScene:
    """An object made ready. Raises ``InputError`` where no view of the sphere sees anything of it."""
    vertices = np.asarray(mesh.vertices, np.float64)[np.unique(mesh.faces)]
    if len(vertices) == 0:
        raise InputError(f"{name}: the mesh has no triangles, so there is nothing to look at.")
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = 2 * float(np.linalg.norm(vertices - centre, axis=1).max())
    length = lambda share: None if share is None else share * size  # noqa: E731
    sensor = Sensor(
        options.pixels,
        options.pixels,
        field_of_view_deg=options.field_of_view_deg,
        minimum_range=length(options.nearest),
        maximum_range=length(options.farthest),
    )
    sphere = ObservationSphere(centre, options.distance * size, options.lowest_deg)
    samples = sample_surface(mesh, jax.random.key(0), options.samples)
    seen = reachable(samples, mesh, sphere.poses(sphere.spread(options.reaching)), sensor)
    if not seen.any():
        raise InputError(f"{name}: no view of the observation sphere sees any of it within the sensor's range.")
    return ObjectScene(name, mesh, size, sensor, sphere, object_map(centre, size, options.cells), samples, seen)
