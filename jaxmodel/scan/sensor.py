"""An ideal range sensor: which ray each pixel looks along, and which pixel a point falls on.

Sensor frame: x to the right (columns), y down (rows), z forward, away from the sensor. Pixels are (column, row),
integers at pixel centres, the image spanning [-0.5, width - 0.5] x [-0.5, height - 0.5]; pixels are square.
"""

from dataclasses import dataclass
from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError


@dataclass(frozen=True)
class Sensor:
    """``width x height`` pixels, pinhole or orthographic.

    ``field_of_view_deg`` is the pinhole's horizontal angle; ``window`` the horizontal extent an orthographic
    sensor sees, in the unit of the data. Readings nearer than ``minimum_range`` or beyond ``maximum_range``
    (distance along the ray, unit of the data; None: no limit) are not given. Raises :class:`InputError` for
    values that make no sensor.
    """

    width: int = 200
    height: int = 200
    projection: Literal["pinhole", "orthographic"] = "pinhole"
    field_of_view_deg: float = 28.0
    window: float = 1.6
    minimum_range: float | None = None
    maximum_range: float | None = None

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InputError(f"sensor: expected width and height of at least 1, got {self.width} x {self.height}.")
        if self.projection not in ("pinhole", "orthographic"):
            raise InputError(f"sensor.projection: expected pinhole or orthographic, got {self.projection!r}.")
        if not 0 < self.field_of_view_deg < 180:
            raise InputError(f"sensor.field_of_view_deg: expected between 0 and 180, got {self.field_of_view_deg}.")
        if not self.window > 0:
            raise InputError(f"sensor.window: expected a positive length, got {self.window}.")
        low, high = self.minimum_range or 0.0, np.inf if self.maximum_range is None else self.maximum_range
        if not 0 <= low < high:
            raise InputError(f"sensor: expected 0 <= minimum_range < maximum_range, got {low} and {high}.")

    @property
    def focal_px(self) -> float:
        """Pixels for a pinhole's tangent of 1; pixels for an orthographic length of 1."""
        if self.projection == "orthographic":
            return self.width / self.window
        return self.width / (2 * float(np.tan(np.deg2rad(self.field_of_view_deg) / 2)))

    @property
    def eye(self) -> Float[np.ndarray, "4"]:
        """The sensor as a homogeneous point of its own frame, as :class:`RangeImage` keeps it."""
        return np.array([0.0, 0.0, 0.0, 1.0] if self.projection == "pinhole" else [0.0, 0.0, -1.0, 0.0])


class Rays(eqx.Module):
    """Rays in the sensor frame: ``origins (h, w, 3)``, unit ``directions (h, w, 3)``."""

    origins: Float[np.ndarray, "h w 3"]
    directions: Float[np.ndarray, "h w 3"]


def pixel_rays(sensor: Sensor) -> Rays:
    """The ray through each pixel centre, in the sensor frame."""
    column, row = np.meshgrid(np.arange(sensor.width), np.arange(sensor.height))
    x = (column - (sensor.width - 1) / 2) / sensor.focal_px
    y = (row - (sensor.height - 1) / 2) / sensor.focal_px
    zero, one = np.zeros_like(x), np.ones_like(x)
    if sensor.projection == "orthographic":
        return Rays(origins=np.stack([x, y, zero], axis=-1), directions=np.stack([zero, zero, one], axis=-1))
    directions = np.stack([x, y, one], axis=-1)
    return Rays(np.zeros_like(directions), directions / np.linalg.norm(directions, axis=-1, keepdims=True))


def project(sensor: Sensor, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
    """Pixels (column, row), not rounded, of points of the sensor frame; the inverse of :func:`pixel_rays`.

    NaN where a point is not in front of the sensor; pixels may lie outside the image.
    """
    front = points[..., 2] > 0
    depth = np.where(front, points[..., 2], np.nan)
    scale = sensor.focal_px / depth if sensor.projection == "pinhole" else sensor.focal_px * (depth / depth)
    centre = np.array([(sensor.width - 1) / 2, (sensor.height - 1) / 2])
    return points[..., :2] * scale[..., None] + centre
