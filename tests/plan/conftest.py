"""Maps along a modelling run, made once."""

import numpy as np
import pytest

from jaxmodel.plan.label_map import LabelMap, object_map
from jaxmodel.plan.map_update import update
from jaxmodel.plan.viewpoints import ObservationSphere
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import scan_mesh

SENSOR = Sensor(60, 60, field_of_view_deg=40.0)


class Modelled:
    """An object, its observation sphere, and the map after each of a few even views."""

    def __init__(self, name: str, views: int) -> None:
        self.mesh = object_mesh(name)
        vertices = np.asarray(self.mesh.vertices, np.float64)
        centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        self.size = 2 * float(np.linalg.norm(vertices - centre, axis=1).max())
        self.sensor = SENSOR
        self.sphere = ObservationSphere(centre, 1.6 * self.size)
        self.taken = list(self.sphere.poses(self.sphere.spread(7))[:views])
        self.maps: list[LabelMap] = [object_map(centre, self.size, 32)]
        for T in self.taken:
            self.maps.append(update(self.maps[-1], self.scan(T), T, SENSOR))

    def scan(self, T_world_sensor: np.ndarray, number: int = 0):
        return scan_mesh(np.asarray(self.mesh.vertices, np.float64), self.mesh.faces, SENSOR, T_world_sensor)


@pytest.fixture(scope="session")
def valve() -> Modelled:
    """The valve after none, one and two views."""
    return Modelled("valve", 2)
