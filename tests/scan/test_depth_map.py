"""What a range image says of points: in front of a reading, behind it, in the empty, out of its field."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.scan.depth_map import DepthMap, depth_map, no_depth_map
from jaxmodel.scan.range_image import RangeImage


def _image(eye: tuple[float, ...]) -> RangeImage:
    """A square at depth 2 (z = -2), 40 x 40 pixels of a field of 60 x 60."""
    row, column = np.mgrid[:60, :60]
    u, v = (column - 29.5) * 0.02, (row - 29.5) * 0.02
    scale = 2.0 if eye[3] else 1.0
    points = np.stack([u * scale, v * scale, np.full(u.shape, -2.0)], axis=-1)
    valid = (np.abs(column - 29.5) < 20) & (np.abs(row - 29.5) < 20)
    points[~valid] = np.nan
    return RangeImage(points, valid, np.array(eye))


def _see(image: RangeImage, points: list[tuple[float, float, float]], origin: np.ndarray) -> dict[str, list]:
    seen = depth_map(image, origin).see(jnp.asarray((np.array(points) - origin).T, jnp.float32))
    return {name: np.asarray(value).tolist() for name, value in seen._asdict().items()}


@pytest.mark.parametrize("origin", [np.zeros(3), np.array([0.3, -0.2, -2.0])])
@pytest.mark.parametrize("eye", [(0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0)])
def test_in_front_behind_empty_and_outside(eye, origin):
    scale = 2.0 if eye[3] else 1.0
    seen = _see(_image(eye), [(0, 0, -1.5), (0.1, 0, -2.25), (0.5 * scale, 0, -2.0), (2 * scale, 0, -2.0)], origin)
    assert seen["known"] == [True, True, False, False]
    assert seen["empty"] == [False, False, True, False]
    assert np.allclose(seen["depth"][:2], [0.5, -0.25], atol=1e-5)


def test_nothing_is_known_behind_a_pinhole():
    seen = _see(_image((0.0, 0.0, 0.0, 1.0)), [(0, 0, 1.5)], np.zeros(3))
    assert seen["known"] == [False] and seen["empty"] == [False]


def test_at_a_depth_jump_the_nearer_surface_counts():
    image = _image((0.0, 0.0, 1.0, 0.0))
    points = image.points.copy()
    points[:, 30:, 2] -= 1.0
    seen = _see(RangeImage(points, image.valid, image.eye), [(0.005, 0, -2.5), (0.3, 0, -2.5)], np.zeros(3))
    assert np.allclose(seen["depth"], [-0.5, 0.5], atol=1e-5)  # beside the edge: behind the nearer, not before the far


def test_a_cloud_without_a_sensor_knows_nothing():
    seen = no_depth_map().see(jnp.zeros((3, 4)))
    assert isinstance(no_depth_map(), DepthMap)
    assert not np.asarray(seen.known).any() and not np.asarray(seen.empty).any()
