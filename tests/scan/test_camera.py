"""The camera against OpenCV's own projection, its rays back to pixels, and what it refuses."""

import cv2
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.scan.camera import Camera

K = np.array([[620.0, 0, 324.5], [0, 615.0, 236.0], [0, 0, 1]])
LENSES = {
    "none": [],
    "one": [-0.2],
    "four": [-0.28, 0.07, 2e-3, -1e-3],
    "five": [-0.12, 0.05, 1e-3, -5e-4, 0.02],
    "rational": [0.4, -0.1, 1e-3, 5e-4, 0.03, 0.6, -0.05, 0.02],
}


@pytest.fixture(params=LENSES)
def camera(request) -> Camera:
    return Camera(K, np.array(LENSES[request.param]), 640, 480)


def pixels_of(camera: Camera) -> np.ndarray:
    columns, rows = np.meshgrid(np.linspace(-0.5, camera.width - 0.5, 33), np.linspace(-0.5, camera.height - 0.5, 25))
    return np.stack([columns, rows], axis=-1).reshape(-1, 2)


def test_projection_is_opencvs(camera):
    rng = np.random.default_rng(0)
    points = np.append(rng.uniform(-0.5, 0.5, (200, 2)), np.ones((200, 1)), axis=1) * rng.uniform(0.1, 9.0, (200, 1))
    oracle = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0].reshape(-1, 2)
    np.testing.assert_allclose(camera.project(points), oracle, atol=1e-9)


def test_a_pixels_ray_projects_to_that_pixel_at_any_depth(camera):
    pixels = pixels_of(camera)
    rays = np.append(camera.undistort(pixels), np.ones((len(pixels), 1)), axis=1)
    for depth in (1e-3, 1.0, 1e3):
        np.testing.assert_allclose(camera.project(depth * rays), pixels, atol=1e-6)


def test_rays_are_opencvs(camera):
    pixels = pixels_of(camera)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-13)
    oracle = cv2.undistortPointsIter(pixels, camera.K, camera.distortion, np.eye(3), np.eye(3), criteria)
    oracle = oracle.reshape(-1, 2)
    np.testing.assert_allclose(camera.undistort(pixels), oracle, atol=1e-9)


def test_pixels_beyond_the_fold_of_a_lens_have_no_ray():
    """With k1 = -0.5 no ray arrives further than r (1 - r^2 / 2) = 0.544 from the centre, at r = sqrt(2 / 3)."""
    camera = Camera(K, np.array([-0.5]), 640, 480)
    largest = np.sqrt(2 / 3) * (2 / 3)
    distance = np.linalg.norm((pixels_of(camera) - K[:2, 2]) / np.diag(K)[:2], axis=1)
    rays = camera.undistort(pixels_of(camera))
    assert (distance > largest).any()
    assert np.isnan(rays[distance > largest]).all()
    near = distance < 0.97 * largest
    again = camera.project(np.append(rays, np.ones((len(rays), 1)), axis=1))
    np.testing.assert_allclose(again[near], pixels_of(camera)[near], atol=1e-6)


def test_an_absent_pixel_has_no_ray_and_changes_no_other(camera):
    pixels = pixels_of(camera)
    holed = pixels.copy()
    holed[7] = np.nan
    rays = camera.undistort(holed)
    assert np.isnan(rays[7]).all()
    np.testing.assert_array_equal(np.delete(rays, 7, axis=0), np.delete(camera.undistort(pixels), 7, axis=0))


def test_only_what_is_in_front_is_seen(camera):
    points = np.array([[0.1, 0.2, 1.0], [0.1, 0.2, -1.0], [0.1, 0.2, 0.0], [0.0, 0.0, 1e-300]])
    np.testing.assert_array_equal(np.isnan(camera.project(points)).any(axis=1), [False, True, True, False])
    np.testing.assert_allclose(camera.project(points[3:]), K[None, :2, 2])


@pytest.mark.parametrize(("given", "kept"), [(0, 0), (1, 4), (4, 4), (5, 5), (6, 8), (8, 8)])
def test_distortion_keeps_opencvs_lengths_and_drops_zeros_behind(given, kept):
    distortion = np.concatenate([np.linspace(0.01, 0.02, given), np.zeros(14 - given)])
    assert Camera(K, distortion).distortion.shape == (kept,)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((np.diag([620.0, np.nan, 1.0]),), "must be 3 x 3 finite numbers"),
        ((np.diag([620.0, -615.0, 1.0]),), "with fx, fy > 0"),
        ((np.diag([620.0, 615.0, 2.0]),), "with fx, fy > 0"),
        ((K + np.array([[0, 0.1, 0], [0, 0, 0], [0, 0, 0]]),), "fx 0 cx; 0 fy cy"),
        ((K, np.array([0.1, np.inf])), "list of finite numbers"),
        ((K, np.append(np.zeros(8), 1e-3)), "thin-prism and tilt"),
        ((K, np.zeros(0), 0, 480), "at least 1 x 1 pixel, not 0 x 480"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        Camera(*values)
