"""Rays and pixels of the ideal sensor are each other's inverse."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.errors import InputError
from jaxmodel.scan.sensor import Sensor, pixel_rays, project


@given(
    width=st.integers(1, 40),
    height=st.integers(1, 40),
    projection=st.sampled_from(["pinhole", "orthographic"]),
    angle=st.floats(1.0, 170.0),
    depth=st.floats(1e-3, 1e3),
)
def test_a_point_on_a_pixels_ray_projects_to_that_pixel(width, height, projection, angle, depth):
    sensor = Sensor(width, height, projection, field_of_view_deg=angle, window=angle)
    rays = pixel_rays(sensor)
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=-1), 1.0, atol=1e-12)
    row, column = np.mgrid[0:height, 0:width]
    pixels = project(sensor, rays.origins + depth * rays.directions)
    np.testing.assert_allclose(pixels, np.stack([column, row], axis=-1), atol=1e-9 * max(width, height))


def test_the_image_edges_span_the_field_of_view():
    sensor = Sensor(width=64, height=48, field_of_view_deg=60.0)
    half = np.tan(np.deg2rad(30.0))
    pixels = project(sensor, np.array([[-half, 0.0, 1.0], [half, 0.0, 1.0]]))
    np.testing.assert_allclose(pixels[:, 0], [-0.5, 63.5], atol=1e-12)
    sensor = Sensor(width=64, height=48, projection="orthographic", window=3.0)
    pixels = project(sensor, np.array([[-1.5, 0.0, 7.0], [1.5, 0.0, 7.0]]))
    np.testing.assert_allclose(pixels[:, 0], [-0.5, 63.5], atol=1e-12)


def test_x_is_right_and_y_is_down():
    pixels = project(Sensor(), np.array([[0.1, 0.0, 1.0], [0.0, 0.1, 1.0], [0.0, 0.0, 1.0]]))
    assert pixels[0, 0] > pixels[2, 0] and pixels[1, 1] > pixels[2, 1]


def test_a_point_behind_the_sensor_has_no_pixel():
    for projection in ("pinhole", "orthographic"):
        assert np.isnan(project(Sensor(projection=projection), np.array([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0]]))).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 0}, "width"),
        ({"height": -4}, "height"),
        ({"field_of_view_deg": 180.0}, "field_of_view_deg"),
        ({"window": 0.0}, "window"),
        ({"minimum_range": 2.0, "maximum_range": 1.0}, "minimum_range"),
    ],
)
def test_values_that_make_no_sensor_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        Sensor(**options)
