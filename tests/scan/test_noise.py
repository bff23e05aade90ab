"""Noise models: keyed, along the ray, with the spread they state."""

import jax
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.scan.noise import Laser, Profilometer, Stereo, with_noise
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor, pixel_rays

SENSOR = Sensor(width=150, height=120, field_of_view_deg=40.0)
FACING = np.ones((SENSOR.height, SENSOR.width))
MODELS = [Laser(sigma=0.01), Profilometer(step=0.05, sigma=0.01), Stereo(sigma=0.001, correlation_px=1.5)]


def wall(depth: float) -> RangeImage:
    """A wall facing the sensor at the given depth."""
    directions = pixel_rays(SENSOR).directions
    return RangeImage(depth * directions / directions[..., 2:], FACING > 0, SENSOR.eye)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.kind)
def test_the_same_key_gives_the_same_image_and_another_key_another(model):
    key = jax.random.key(4)
    first, second = (with_noise(key, wall(2.0), FACING, model) for _ in range(2))
    np.testing.assert_array_equal(first.points, second.points)
    other = with_noise(jax.random.fold_in(key, 1), wall(2.0), FACING, model)
    assert not np.array_equal(first.points, other.points, equal_nan=True)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.kind)
def test_points_stay_on_their_pixels_rays(model):
    noisy = with_noise(jax.random.key(0), wall(2.0), FACING, model)
    off = np.linalg.norm(np.cross(noisy.points, pixel_rays(SENSOR).directions), axis=-1)
    assert np.nanmax(off) < 1e-12
    assert np.isnan(noisy.points[~noisy.valid]).all() and np.isfinite(noisy.points[noisy.valid]).all()


@pytest.mark.parametrize(
    "model", [Laser(sigma=0.0), Profilometer(step=0.0, sigma=0.0), Stereo(sigma=0.0, dropout=0.0)], ids=lambda m: m.kind
)
def test_no_noise_changes_nothing(model):
    np.testing.assert_array_equal(with_noise(jax.random.key(0), wall(2.0), FACING, model).points, wall(2.0).points)


def test_laser_spread_is_sigma_along_the_ray_and_grows_with_incidence():
    def spread(cosine: float) -> float:
        noisy = with_noise(jax.random.key(1), wall(3.0), cosine * FACING, Laser(sigma=0.01, growth=0.5))
        return float(np.std(np.linalg.norm(noisy.points, axis=-1) - np.linalg.norm(wall(3.0).points, axis=-1)))

    assert spread(1.0) == pytest.approx(0.01, rel=0.02)
    assert spread(0.5) == pytest.approx(1.5 * spread(1.0), rel=1e-9)  # 1 + 0.5 (2 - 1)


def test_grazing_pixels_give_no_reading():
    angle = np.linspace(0, 89, FACING.size).reshape(FACING.shape)
    noisy = with_noise(jax.random.key(1), wall(3.0), np.cos(np.deg2rad(angle)), Laser(grazing_deg=70.0))
    np.testing.assert_array_equal(noisy.valid, angle <= 70.0)


def test_dropouts_come_at_the_stated_rate():
    noisy = with_noise(jax.random.key(2), wall(3.0), FACING, Laser(dropout=0.2))
    assert noisy.valid.mean() == pytest.approx(0.8, abs=0.012)  # four standard deviations


def test_profilometer_depths_are_multiples_of_the_step():
    model = Profilometer(step=0.05, sigma=0.03)
    ratio = with_noise(jax.random.key(3), wall(2.013), FACING, model).points[..., 2] / 0.05
    np.testing.assert_allclose(ratio, np.round(ratio), atol=1e-9)
    assert len(np.unique(np.round(ratio))) > 2


@pytest.mark.parametrize("correlation_px", [0.0, 2.0])
def test_stereo_spread_grows_with_the_square_of_depth(correlation_px):
    model = Stereo(sigma=0.001, correlation_px=correlation_px, dropout=0.0)
    depths = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
    spread = [
        np.std(with_noise(jax.random.key(i), wall(z), FACING, model).points[..., 2]) for i, z in enumerate(depths)
    ]
    slope, level = np.polyfit(np.log(depths), np.log(spread), 1)
    assert slope == pytest.approx(2.0, abs=0.05)
    assert np.exp(level) == pytest.approx(0.001, rel=0.08)


def test_correlation_makes_neighbours_alike():
    def likeness(radius: float) -> float:
        model = Stereo(correlation_px=radius, dropout=0.0)
        depth = with_noise(jax.random.key(5), wall(2.0), FACING, model).points[..., 2]
        error = depth - depth.mean()
        return float(np.mean(error[:, 1:] * error[:, :-1]) / np.mean(error**2))

    assert abs(likeness(0.0)) < 0.04
    # Two Gaussians of radius r one pixel apart: exp(-1 / 4 r^2).
    assert likeness(2.0) == pytest.approx(np.exp(-1 / 16), abs=0.03)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.kind)
def test_fractions_of_the_object_scale_with_it(model):
    key = jax.random.key(6)
    image, size = wall(2.0), 250.0
    large = RangeImage(size * image.points, image.valid, image.eye)
    np.testing.assert_allclose(
        with_noise(key, large, FACING, model, size).points,
        size * with_noise(key, image, FACING, model).points,
        rtol=1e-9,
    )


def test_lengths_in_the_unit_of_the_data_ignore_the_size():
    model = Laser(sigma=0.01, unit="data")
    first, second = (with_noise(jax.random.key(7), wall(2.0), FACING, model, size).points for size in (1.0, 250.0))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Laser(sigma=-1.0), "noise.sigma"),
        (lambda: Laser(sigma=float("nan")), "noise.sigma"),
        (lambda: Profilometer(step=-0.1), "noise.step"),
        (lambda: Stereo(dropout=1.5), "noise.dropout"),
        (lambda: Laser(grazing_deg=120.0), "noise.grazing_deg"),
    ],
)
def test_values_that_make_no_model_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
