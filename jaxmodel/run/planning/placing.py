"""Views registered onto the model of those before them, from a pose that is known only roughly."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jaxmodel.plan.explore import Placed
from jaxmodel.register.onto_model import FitOutcome, Model, fit_onto, model_of, parts_of
from jaxmodel.scan.range_image import RangeImage

SURE_DEG, SURE_SHIFT = 1.0, 0.01
"""A view is placed right when it is turned by less and its middle lies off by less, in the object's size."""
BELIEVED_DEG, BELIEVED_SHIFT = 2.0, 0.02
"""It is believed to be when the standard deviations of its fit, which are cautious, are smaller than these."""


class Placement(NamedTuple):
    """Errors against the truth before and after the registration: degrees, and the way of the scan's middle in the
    object's size.
    """

    start_deg: float
    start_shift: float
    error_deg: float
    error_shift: float

    @property
    def right(self) -> bool:
        """Whether the view lies where it was taken."""
        return self.error_deg < SURE_DEG and self.error_shift < SURE_SHIFT


class Placer:
    """Registers view after view; each call starts from the true pose turned by ``degrees`` and shifted by ``shift``.

    The axis of the turn, about the middle of what is seen, and the direction of the shift are drawn from ``rng``;
    lengths in ``size``. What is believed is decided by the fit alone; the truth only tells how far off it is.
    """

    def __init__(self, degrees: float, shift: float, size: float, rng: np.random.Generator) -> None:
        self.degrees, self.shift, self.size, self.rng = degrees, shift, size, rng
        self.model: Model | None = None

    def first(self, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"]) -> None:
        """Take the first view as it is: it makes the frame of the model. A view without readings makes none."""
        if image.valid.any():
            self.model = model_of(parts_of(image).moved(T_world_sensor))

    def __call__(self, image: RangeImage, T_world_sensor: Float[np.ndarray, "4 4"]) -> Placed:
        """Where the view came to lie. One whose fit leaves too much open is not sure and is left out of the model."""
        if self.model is None or not image.valid.any():
            return Placed(T_world_sensor, sure=False, report=Placement(*[np.nan] * 4))
        view = parts_of(image)
        centre = view.moved(T_world_sensor).points.mean(axis=0)
        start = self._off(centre) @ T_world_sensor
        fit = fit_onto(self.model, view, start, self.size)
        T = fit.T_model_view
        report = Placement(*self._apart(start, T_world_sensor, centre), *self._apart(T, T_world_sensor, centre))
        turn, shift = fit.deviations
        sure = turn < BELIEVED_DEG and shift < BELIEVED_SHIFT * self.size
        sure = sure and fit.outcome is not FitOutcome.LITTLE_SHARED
        if sure:
            self.model = self.model.with_view(view, T)
        return Placed(T, sure=sure, report=report)

    def _off(self, centre: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
        axis, way = (v / np.linalg.norm(v) for v in self.rng.normal(size=(2, 3)))
        R = Rotation.from_rotvec(np.deg2rad(self.degrees) * axis).as_matrix()
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, centre - R @ centre + self.shift * self.size * way
        return T

    def _apart(self, T: np.ndarray, truth: np.ndarray, centre: np.ndarray) -> tuple[float, float]:
        """Turn in degrees, and the way of ``centre`` (world) in the size, between a pose and the truth."""
        there = np.linalg.inv(truth) @ np.append(centre, 1.0)
        turn = Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T).magnitude()
        return float(np.rad2deg(turn)), float(np.linalg.norm((T - truth)[:3] @ there)) / self.size
