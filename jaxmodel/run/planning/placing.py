"""Views registered onto the model of those before them, from a pose that is known only roughly."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.control_points import Subsample, select
from jaxmodel.plan.explore import Placed
from jaxmodel.register import register
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.range_image import RangeImage

METHOD = "thesis_2005"
CONTROL_POINTS = 2000
SURE_DEG, SURE_SHIFT = 1.0, 0.01
"""A view is registered right when it is turned by less and its middle lies off by less, in the object's size."""


class Placement(NamedTuple):
    """Errors against the truth before and after the registration: degrees, and the way of the scan's middle."""

    start_deg: float
    start_shift: float
    error_deg: float
    error_shift: float


class Placer:
    """Registers view after view; each call starts from the true pose turned by ``degrees`` and shifted by ``shift``.

    The axis of the turn, about the middle of what is seen, and the direction of the shift are drawn from ``rng``.
    """

    def __init__(self, degrees: float, shift: float, size: float, rng: np.random.Generator) -> None:
        self.degrees, self.shift, self.size, self.rng = degrees, shift, size, rng
        self.model: list[np.ndarray] = []

    def first(self, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"]) -> None:
        """Take the first view as it is: it makes the frame of the model."""
        self.model.append(as_cloud(image).moved(T_world_sensor).points)

    def __call__(self, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"]) -> Placed:
        """Where the view came to lie. One that lies wrong is said not to be sure and is left out of the model."""
        if not image.valid.any():
            return Placed(T_world_sensor, sure=False, report=Placement(*[np.nan] * 4))
        cloud = as_cloud(image)
        centre = T_world_sensor[:3, :3] @ np.asarray(cloud.points, np.float64).mean(axis=0) + T_world_sensor[:3, 3]
        start = self._off(centre) @ T_world_sensor
        target = select(np.concatenate(self.model), Subsample(count=CONTROL_POINTS))
        found = register(target, select(image, Subsample(count=CONTROL_POINTS)), start, METHOD)
        T = np.asarray(found.T_target_source, np.float64)
        report = Placement(*_apart(start, T_world_sensor, centre), *_apart(T, T_world_sensor, centre))
        sure = report.error_deg < SURE_DEG and report.error_shift < SURE_SHIFT * self.size
        if sure:
            self.model.append(cloud.moved(T).points)
        return Placed(T, sure=bool(sure), report=report)

    def _off(self, centre: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
        axis, way = (v / np.linalg.norm(v) for v in self.rng.normal(size=(2, 3)))
        R = Rotation.from_rotvec(np.deg2rad(self.degrees) * axis).as_matrix()
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, centre - R @ centre + self.shift * self.size * way
        return T


def _apart(T: np.ndarray, truth: np.ndarray, centre: np.ndarray) -> tuple[float, float]:
    """Turn in degrees, and the way of ``centre`` (world), between a pose and the truth."""
    there = np.linalg.inv(truth) @ np.append(centre, 1.0)
    turn = Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).magnitude()
    return float(np.rad2deg(turn)), float(np.linalg.norm((T - truth)[:3] @ there))
