"""What the grid of a range image tells: spacing, borders, normals, triangles."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.io.datasets import StanfordBunny
from jaxmodel.io.meshes import load_mesh
from jaxmodel.scan.range_image import (
    RangeImage,
    borders,
    grid_triangles,
    normals,
    spacing,
    to_cloud,
    to_sensor,
)

ABOVE = np.array([0.0, 0.0, 1.0, 0.0])


def plane_image(h: int = 12, w: int = 15, slope: tuple[float, float] = (0.3, -0.2), scale: float = 1.0) -> RangeImage:
    """The plane z = slope . (x, y) on a unit grid, seen from +z."""
    y, x = np.mgrid[0:h, 0:w] * scale
    points = np.stack([x, y, slope[0] * x + slope[1] * y], axis=-1)
    return RangeImage(points, np.ones((h, w), dtype=bool), ABOVE)


def two_levels(h: int = 10, w: int = 12, step: float = 30.0) -> RangeImage:
    """Level ground with a jump after column w / 2."""
    image = plane_image(h, w, (0.0, 0.0))
    points = image.points.copy()
    points[:, w // 2 :, 2] += step
    return RangeImage(points, image.valid, ABOVE)


def without(image: RangeImage, mask: np.ndarray) -> RangeImage:
    valid = image.valid & ~mask
    return RangeImage(np.where(valid[..., None], image.points, np.nan), valid, image.eye)


@pytest.mark.parametrize("radius", [1, 2, 4])
def test_normals_of_a_plane_are_exact_and_face_the_sensor(radius):
    image = plane_image()
    expected = np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([-0.3, 0.2, 1.0])
    np.testing.assert_allclose(normals(image, radius), np.broadcast_to(expected, image.points.shape), atol=1e-12)
    below = RangeImage(image.points, image.valid, -ABOVE)
    np.testing.assert_allclose(normals(below, radius), -normals(image, radius), atol=1e-12)


def test_normals_do_not_mix_the_two_sides_of_a_jump():
    np.testing.assert_allclose(normals(two_levels()), np.broadcast_to([0, 0, 1.0], (10, 12, 3)), atol=1e-12)


def test_a_lone_pixel_has_the_direction_to_the_sensor_as_normal():
    image = plane_image(5, 5)
    lone = without(image, np.arange(25).reshape(5, 5) != 12)
    np.testing.assert_array_equal(normals(lone)[2, 2], [0, 0, 1])
    assert np.isnan(normals(lone)[0, 0]).all()
    assert borders(lone)[2, 2]


def test_normals_are_equivariant_under_rigid_motion_of_the_whole_frame():
    rng = np.random.default_rng(0)
    image = plane_image()
    rough = RangeImage(image.points + 0.1 * rng.normal(size=image.points.shape), image.valid, ABOVE)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    R = R * np.sign(np.linalg.det(R))
    turned = RangeImage(rough.points @ R.T + [1, 2, 3], rough.valid, np.append(R @ ABOVE[:3], 0.0))
    np.testing.assert_allclose(normals(turned), normals(rough) @ R.T, atol=1e-9)
    np.testing.assert_array_equal(borders(turned), borders(rough))


def test_pinhole_directions_point_at_the_origin():
    image = RangeImage(plane_image().points + np.array([1.0, 2.0, 9.0]), np.ones((12, 15), dtype=bool))
    points = image.points.reshape(-1, 3)
    np.testing.assert_allclose(
        to_sensor(image, points), -points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-15
    )


def test_borders_of_a_full_plane_are_the_image_edge():
    frame = np.ones((12, 15), dtype=bool)
    frame[1:-1, 1:-1] = False
    np.testing.assert_array_equal(borders(plane_image()), frame)


def test_borders_lie_along_jumps_and_around_missing_readings():
    marked = borders(two_levels())
    inner = marked[1:-1, 1:-1]
    assert inner[:, [4, 5]].all() and inner.sum() == 2 * inner.shape[0]
    hole = np.zeros((12, 15), dtype=bool)
    hole[5, 6] = True
    marked = borders(without(plane_image(), hole))[1:-1, 1:-1]
    assert {tuple(p) for p in np.argwhere(marked).tolist()} == {(3, 5), (5, 5), (4, 4), (4, 6)}


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_nothing_depends_on_the_unit(scale):
    image = two_levels()
    scaled = RangeImage(image.points * scale, image.valid, ABOVE)
    np.testing.assert_array_equal(borders(scaled), borders(image))
    np.testing.assert_array_equal(grid_triangles(scaled), grid_triangles(image))
    np.testing.assert_allclose(spacing(scaled), scale * spacing(image))


def test_grid_triangles_tile_the_plane_and_face_the_sensor():
    image = plane_image(slope=(0.0, 0.0))
    points, faces = to_cloud(image).points, grid_triangles(image)
    area = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]) / 2
    assert len(faces) == 2 * 11 * 14
    np.testing.assert_allclose(area, np.broadcast_to([0, 0, 0.5], area.shape))
    below = grid_triangles(RangeImage(image.points, image.valid, -ABOVE))
    np.testing.assert_array_equal(below, faces[:, ::-1])


def test_cells_are_split_along_the_shorter_diagonal():
    image = plane_image(2, 2, (1.0, 1.0))  # heights 0 1 / 1 2: the level diagonal joins the two ones
    faces = grid_triangles(image)
    assert len(faces) == 2 and all({1, 2} <= set(face) for face in faces.tolist())
    image = plane_image(2, 2, (1.0, -1.0))
    assert all({0, 3} <= set(face) for face in grid_triangles(image).tolist())


@pytest.mark.parametrize("missing", [0, 1, 2, 3])
def test_three_readings_of_a_cell_give_one_triangle(missing):
    image = plane_image(2, 2, (0.0, 0.0))
    faces = grid_triangles(without(image, np.arange(4).reshape(2, 2) == missing))
    assert len(faces) == 1 and sorted(faces[0].tolist()) == [0, 1, 2]


def test_no_triangle_crosses_a_jump():
    image = two_levels()
    height = to_cloud(image).points[grid_triangles(image)][..., 2]
    assert (height.min(axis=1) == height.max(axis=1)).all()
    assert len(height) == 2 * 9 * (5 + 5)


def test_an_image_without_readings_has_nothing():
    image = without(plane_image(), np.ones((12, 15), dtype=bool))
    assert len(to_cloud(image)) == 0 and len(grid_triangles(image)) == 0 and not borders(image).any()


def test_a_one_pixel_row_has_borders_and_no_triangles():
    image = plane_image(1, 6)
    assert borders(image).all() and grid_triangles(image).shape == (0, 3)


@pytest.mark.data
def test_the_bunny_scan_is_seen_from_plus_z(data_dir):
    """The published reconstruction is oriented outward and lies in the frame of bun000."""
    cloud = to_cloud(StanfordBunny(data_dir).scan("bun000"))
    assert cloud.normals is not None
    mesh = load_mesh(data_dir / "stanford_bunny" / "reconstruction" / "bun_zipper_res2.ply")
    corner = mesh.vertices[mesh.faces]
    outward = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    _, nearest = KDTree(corner.mean(axis=1)).query(cloud.points)
    agreement = np.sum(cloud.normals * outward[nearest], axis=1)
    assert np.median(agreement) > 0.99 and np.mean(agreement > 0) > 0.995
    assert (cloud.normals[:, 2] >= 0).all()


@pytest.mark.data
def test_the_bunny_grid_has_the_scanners_column_step(data_dir):
    image = StanfordBunny(data_dir).scan("bun000")
    step = np.diff(image.points, axis=1)
    assert np.nanmax(np.abs(step[..., 0] - 0.0005)) < 1e-6 + 1e-5  # six digits in the file
    assert abs(np.nanmedian(np.diff(image.points, axis=0)[..., 1]) - 0.0007) < 2e-5
    share = borders(image).sum() / image.valid.sum()
    assert 0.02 < share < 0.10
