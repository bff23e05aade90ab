"""Noise of range sensors: keyed, pure functions of an ideal range image.

Three models. ``Laser``: along the ray, growing with the incidence angle. ``Profilometer``: depth in steps.
``Stereo``: standard deviation growing with the square of the depth. Their lengths are fractions of the object's
size (``unit="object"``) or in the unit of the data (``unit="data"``).
"""

from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage


@dataclass(frozen=True)
class Laser:
    """Gaussian along the ray, ``sigma · (1 + growth · (1/cos θ - 1))`` at incidence θ.

    Pixels beyond ``grazing_deg`` give no reading, others fail with probability ``dropout``.
    """

    kind: Literal["laser"] = "laser"
    sigma: float = 0.0005
    growth: float = 0.5
    grazing_deg: float = 80.0
    dropout: float = 0.0
    unit: Literal["object", "data"] = "object"

    def __post_init__(self) -> None:
        _check(self, ("sigma", "growth"))


@dataclass(frozen=True)
class Profilometer:
    """Depth with a small Gaussian error ``sigma``, then rounded to a multiple of ``step``; none where step is 0."""

    kind: Literal["profilometer"] = "profilometer"
    step: float = 0.001
    sigma: float = 0.0002
    grazing_deg: float = 80.0
    dropout: float = 0.0
    unit: Literal["object", "data"] = "object"

    def __post_init__(self) -> None:
        _check(self, ("step", "sigma"))


@dataclass(frozen=True)
class Stereo:
    """Depth error ``sigma · z²`` (z and the error both in the model's unit): sigma is the error at depth 1.

    ``correlation_px`` is the Gaussian radius over which neighbouring pixels share their error (0: independent);
    the standard deviation is not changed by it.
    """

    kind: Literal["stereo"] = "stereo"
    sigma: float = 0.0003
    correlation_px: float = 0.0
    grazing_deg: float = 75.0
    dropout: float = 0.02
    unit: Literal["object", "data"] = "object"

    def __post_init__(self) -> None:
        _check(self, ("sigma", "correlation_px"))


Noise = Laser | Profilometer | Stereo


def with_noise(
    key: jax.Array, image: RangeImage, cos_incidence: Float[np.ndarray, "h w"], model: Noise, size: float = 1.0
) -> RangeImage:
    """``image`` as a real sensor would give it; the same key gives the same image.

    ``cos_incidence (h, w)`` is the cosine between the ray and the surface normal; ``size`` the object's size in
    the unit of the data, used where ``model.unit`` is ``object``. Points move along their pixel's ray, so the
    grid stays true; depth is measured along z.
    """
    rng = np.random.default_rng(np.asarray(jax.random.key_data(key)).ravel().tolist())
    unit = size if model.unit == "object" else 1.0
    # Drawn for every pixel, read or not, so a pixel's noise does not depend on what the others see.
    draw = rng.standard_normal(image.valid.shape)
    lost = rng.random(image.valid.shape) < model.dropout
    directions = _directions(image)
    cosine = np.clip(np.abs(cos_incidence), 1e-6, 1.0)
    match model:
        case Laser():
            step_along_ray = model.sigma * unit * (1 + model.growth * (1 / cosine - 1)) * draw
        case Profilometer():
            depth = image.points[..., 2]
            measured = depth + model.sigma * unit * draw
            if model.step > 0:
                measured = np.round(measured / (model.step * unit)) * (model.step * unit)
            step_along_ray = (measured - depth) / directions[..., 2]
        case Stereo():
            if model.correlation_px > 0:
                draw = _correlated(draw, model.correlation_px)
            error = model.sigma * (image.points[..., 2] / unit) ** 2 * unit * draw
            step_along_ray = error / directions[..., 2]
    kept = image.valid & ~lost & (cosine >= np.cos(np.deg2rad(model.grazing_deg)))
    points = image.points + step_along_ray[..., None] * directions
    return RangeImage(points=np.where(kept[..., None], points, np.nan), valid=kept, eye=image.eye)


def _directions(image: RangeImage) -> Float[np.ndarray, "h w 3"]:
    """Unit directions away from the sensor, at each pixel."""
    away = image.eye[3] * image.points - image.eye[:3]
    return away / np.linalg.norm(away, axis=-1, keepdims=True)


def _correlated(draw: Float[np.ndarray, "h w"], radius_px: float) -> Float[np.ndarray, "h w"]:
    """White noise smoothed by a Gaussian, brought back to unit standard deviation."""
    from scipy.ndimage import gaussian_filter

    impulse = np.zeros_like(draw)
    impulse[0, 0] = 1.0
    gain = np.sqrt(np.sum(gaussian_filter(impulse, radius_px, mode="wrap") ** 2))
    return gaussian_filter(draw, radius_px, mode="wrap") / gain


def _check(model: Noise, lengths: tuple[str, ...]) -> None:
    for name in lengths:
        if not getattr(model, name) >= 0:
            raise InputError(f"noise.{name}: expected a number of at least 0, got {getattr(model, name)}.")
    if not 0 <= model.dropout <= 1:
        raise InputError(f"noise.dropout: expected a probability, got {model.dropout}.")
    if not 0 < model.grazing_deg <= 90:
        raise InputError(f"noise.grazing_deg: expected an angle in (0, 90], got {model.grazing_deg}.")
    if model.unit not in ("object", "data"):
        raise InputError(f"noise.unit: expected object or data, got {model.unit!r}.")
