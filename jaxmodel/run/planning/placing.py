"""Views registered onto the model of those before them, from a pose that is known only roughly."""

from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jaxmodel.control_points import Subsample, select
from jaxmodel.plan.explore import Placed
from jaxmodel.register import IcpMethod, Strategy, register
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.range_image import RangeImage

CONTROL_POINTS = 3000
LIMITS = (0.05, 0.015)
"""Pass by pass: the longest pair, in the model's size."""
REACHES = (0.05, 0.02)
"""Pass by pass: how near the model a point of the view must lie to count as shared, in the object's size."""
ALIKE, FEWEST = 0.7, 100
"""Least cosine between the normals of a shared point and the model; fewest shared points that place a view."""
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

    The axis of the turn, about the middle of what is seen, and the direction of the shift are drawn from ``rng``;
    lengths in ``size``. Distances to tangent planes are used (Chen and Medioni 1992), between the points that the view
    shares with the model: the thesis's method, which looks for its pairs far away, slides views of little overlap over
    one another.
    """

    def __init__(self, degrees: float, shift: float, size: float, rng: np.random.Generator) -> None:
        self.degrees, self.shift, self.size, self.rng = degrees, shift, size, rng
        self.model: list[Cloud] = []

    def first(self, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"]) -> None:
        """Take the first view as it is: it makes the frame of the model."""
        self.model.append(as_cloud(image).moved(T_world_sensor))

    def __call__(self, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"]) -> Placed:
        """Where the view came to lie. One that lies wrong is said not to be sure and is left out of the model."""
        if not image.valid.any():
            return Placed(T_world_sensor, sure=False, report=Placement(*[np.nan] * 4))
        cloud = as_cloud(image)
        centre = T_world_sensor[:3, :3] @ np.asarray(cloud.points, np.float64).mean(axis=0) + T_world_sensor[:3, 3]
        start = self._off(centre) @ T_world_sensor
        T = registered(self.model, cloud, start, self.size)
        report = Placement(*_apart(start, T_world_sensor, centre), *_apart(T, T_world_sensor, centre))
        sure = report.error_deg < SURE_DEG and report.error_shift < SURE_SHIFT * self.size
        if sure:
            self.model.append(cloud.moved(T))
        return Placed(T, sure=sure, report=report)

    def _off(self, centre: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
        axis, way = (v / np.linalg.norm(v) for v in self.rng.normal(size=(2, 3)))
        R = Rotation.from_rotvec(np.deg2rad(self.degrees) * axis).as_matrix()
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, centre - R @ centre + self.shift * self.size * way
        return T


def registered(
    model: list[Cloud], view: Cloud, T_model_view: Float[np.ndarray, "4 4"], size: float
) -> Float[np.ndarray, "4 4"]:
    """``T_model_view`` after registration; as it was where the view shares too little with the model."""
    points, normals = (
        np.concatenate([np.asarray(getattr(part, name)) for part in model]) for name in ("points", "normals")
    )
    target, T = select(Cloud(points, normals), Subsample(count=CONTROL_POINTS)), T_model_view
    for limit, reach in zip(LIMITS, REACHES, strict=True):
        source = shared(target, view, T, reach * size)
        if source is None:
            break
        method = IcpMethod(
            (Strategy(statistical_filter=False),), objective="point_to_plane", stop="motion", max_distance=limit
        )
        T = np.asarray(register(target, source, T, method).T_target_source, np.float64)
    return T


def shared(target: Cloud, view: Cloud, T_target_view: Float[np.ndarray, "4 4"], reach: float) -> Cloud | None:
    """Control points of a view that the model seems to hold too: near it and facing alike; None for too few."""
    moved = view.moved(T_target_view)
    away, nearest = KDTree(target.points).query(moved.points)
    facing = np.einsum("na,na->n", cast(np.ndarray, moved.normals), cast(np.ndarray, target.normals)[nearest])
    held = (away < reach) & (facing > ALIKE)
    return select(view.take(held), Subsample(count=CONTROL_POINTS)) if held.sum() >= FEWEST else None


def _apart(T: np.ndarray, truth: np.ndarray, centre: np.ndarray) -> tuple[float, float]:
    """Turn in degrees, and the way of ``centre`` (world), between a pose and the truth."""
    there = np.linalg.inv(truth) @ np.append(centre, 1.0)
    turn = Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).magnitude()
    return float(np.rad2deg(turn)), float(np.linalg.norm((T - truth)[:3] @ there))
