"""Laws of split meshes and their control points."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from edge_maps import height_field
from scipy.spatial import KDTree
from split_scenes import roof_heights, scanned, terrace_heights, transposed, waves

from jaxmodel.control_points.split_mesh import SplitMesh, split_control_points, split_mesh
from jaxmodel.control_points.triangle_splitting import SplitOptions
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.range_image import RangeImage, Scan, grid_triangles, to_cloud, to_sensor


def pixel_area(mesh: SplitMesh) -> np.ndarray:
    a, b, c = (mesh.pixels[mesh.triangles[:, k]] for k in range(3))
    return np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


def edges(mesh: SplitMesh) -> set[tuple[int, int]]:
    """Edges of the mesh as pairs of flat pixels (1000 a row), the smaller one first."""
    flat = (mesh.pixels @ [1000, 1])[mesh.triangles]
    ends = np.sort(flat[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return set(map(tuple, ends.tolist()))


@pytest.mark.parametrize("name", ["block_steps", "boulder"])
@pytest.mark.parametrize("noise", [None, Laser(sigma=0.002, dropout=0.05)])
def test_vertices_are_measured_points_and_triangles_face_the_sensor(name: str, noise: Laser | None) -> None:
    image = scanned(name, 100, noise)
    mesh = split_mesh(image, count=300)
    assert image.valid[mesh.pixels[:, 0], mesh.pixels[:, 1]].all()
    np.testing.assert_array_equal(mesh.vertices, image.points[mesh.pixels[:, 0], mesh.pixels[:, 1]])
    np.testing.assert_array_equal(mesh.pixels, np.unique(mesh.pixels, axis=0))
    assert np.unique(mesh.triangles).tolist() == list(range(len(mesh.vertices)))
    corner = mesh.vertices[mesh.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    facing = np.sum(normal * to_sensor(image, corner.mean(axis=1)), axis=1) > 0
    assert facing.all()
    assert len(mesh.error) == len(mesh.triangles) and (mesh.error >= 0).all()


def test_triangles_turn_as_those_of_the_grid() -> None:
    image = waves()
    mesh = split_mesh(image, count=200)
    cloud, faces = image.points[image.valid], grid_triangles(image)
    for points, triangles in ((cloud, faces), (mesh.vertices, mesh.triangles)):
        corner = points[triangles]
        assert (np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2] > 0).all()


def test_kept_triangles_do_not_overlap() -> None:
    mesh = split_mesh(scanned("block_steps", 100), count=400)
    ends = np.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert np.unique(ends, axis=0, return_counts=True)[1].max() <= 2
    covered = np.zeros((100, 100), dtype=int)
    row, column = np.indices((100, 100))
    for corner in mesh.pixels[mesh.triangles]:
        sides = [
            (corner[k, 0] - corner[k - 1, 0]) * (column - corner[k - 1, 1])
            - (corner[k, 1] - corner[k - 1, 1]) * (row - corner[k - 1, 0])
            for k in range(3)
        ]
        covered += np.all(np.array(sides) > 0, axis=0) | np.all(np.array(sides) < 0, axis=0)
    assert covered.max() == 1


def test_a_plane_is_two_triangles() -> None:
    mesh = split_mesh(height_field(np.zeros((40, 60))), options=SplitOptions(bound=1e-3))
    np.testing.assert_array_equal(mesh.pixels, [[0, 0], [0, 59], [39, 0], [39, 59]])
    assert pixel_area(mesh).sum() == 39 * 59
    assert mesh.bound < 1e-3 and mesh.noise == 0.0 and mesh.at_horizon > 0


def test_vertices_gather_at_creases() -> None:
    mesh = split_mesh(height_field(roof_heights()), count=60)
    assert np.median(np.abs(mesh.pixels[:, 1] - 40)) <= 3


@pytest.mark.parametrize("options", [{"bound": 0.1}, {"bound": 1.0}])
def test_no_triangle_bridges_a_jump_and_both_levels_are_covered(options: dict[str, float]) -> None:
    z = terrace_heights()
    mesh = split_mesh(height_field(z), options=SplitOptions(**options))
    level = mesh.vertices[mesh.triangles][:, :, 2]
    assert np.ptp(level, axis=1).max() == 0
    area = pixel_area(mesh)
    assert area[level[:, 0] > 0].sum() > 0.9 * 29 * 39
    assert area[level[:, 0] == 0].sum() > 0.9 * (59 * 79 - 31 * 41)
    # on both sides of the jump there are vertices all along it
    for pixels in (mesh.pixels[mesh.vertices[:, 2] > 0], mesh.pixels[mesh.vertices[:, 2] == 0]):
        rim = np.argwhere((z > 0) == (z[pixels[0, 0], pixels[0, 1]] > 0))
        beside = np.asarray(KDTree(np.argwhere((z > 0) != (z[pixels[0, 0], pixels[0, 1]] > 0))).query(rim)[0]) <= 1
        assert np.asarray(KDTree(pixels).query(rim[beside])[0]).max() < 12


@pytest.mark.parametrize("count", [None, 150, 600])
def test_a_round_hole_stays_a_hole(count: int | None) -> None:
    mesh = split_mesh(waves(), count=count)
    row, column = np.indices((50, 60)).reshape(2, -1)
    hole = (column - 15) ** 2 + (row - 20) ** 2 <= 16
    covered = np.zeros(hole.sum(), dtype=bool)
    for corner in mesh.pixels[mesh.triangles]:
        turns = [
            (corner[k, 0] - corner[k - 1, 0]) * (column[hole] - corner[k - 1, 1])
            - (corner[k, 1] - corner[k - 1, 1]) * (row[hole] - corner[k - 1, 0])
            for k in range(3)
        ]
        covered |= np.all(np.array(turns) >= 0, axis=0) | np.all(np.array(turns) <= 0, axis=0)
    assert not covered.any()
    assert pixel_area(mesh).sum() > 0.93 * 49 * 59 - np.pi * 49


@pytest.mark.parametrize("at", ["vertices", "centres"])
@pytest.mark.parametrize("contours", [False, True])
@pytest.mark.parametrize("count", [350, 1000, 2000])
@pytest.mark.parametrize("name", ["block_steps", "gourd"])
def test_count_is_reached_within_five_percent(name: str, count: int, contours: bool, at: str) -> None:
    image = scanned(name, 200, Laser(sigma=0.001))
    cloud = split_control_points(image, count, at=at, contours=contours)  # type: ignore[arg-type]
    assert abs(len(cloud) - count) <= 0.05 * count
    measured = to_cloud(image)
    distance, rows = map(np.asarray, KDTree(measured.points).query(cloud.points))
    assert distance.max() == 0.0
    assert (np.diff(rows) > 0).all()  # distinct, row-major
    assert measured.normals is not None and measured.border is not None
    np.testing.assert_array_equal(cloud.normals, measured.normals[rows])
    np.testing.assert_array_equal(cloud.border, measured.border[rows])


def test_more_than_the_image_has_gives_what_it_has() -> None:
    image = waves()
    np.testing.assert_array_equal(split_control_points(image, 10**6).points, image.points[image.valid])


def test_segments_are_chains_of_edges() -> None:
    z = roof_heights()
    segments = np.array([[[0, 40], [59, 40]], [[5, 3], [50, 33]]])
    mesh = split_mesh(height_field(z), segments, options=SplitOptions(bound=0.5))
    found = edges(mesh)
    on_ridge = mesh.pixels[mesh.pixels[:, 1] == 40][:, 0]
    assert on_ridge[0] == 0 and on_ridge[-1] == 59
    assert all((1000 * a + 40, 1000 * b + 40) in found for a, b in pairwise(on_ridge.tolist()))
    assert mesh.lost_segments == 0
    # with the ridge given, the roof is planes: no reading is off its triangle
    assert mesh.error.max() < 1e-6 and len(mesh.vertices) < 20


@pytest.mark.parametrize("scale", [1024.0, 1.0 / 1024.0])
@pytest.mark.parametrize("contours", [False, True])
def test_units_do_not_matter(scale: float, contours: bool) -> None:
    plain = split_control_points(waves(), 300, contours=contours)
    scaled = split_control_points(waves(scale), 300, contours=contours)
    np.testing.assert_allclose(scaled.points / scale, plain.points, atol=1e-9)


def test_metres_and_millimetres_agree_up_to_ties() -> None:
    image = scanned("boulder", 100, Laser(sigma=0.001))
    metres = split_mesh(image, count=300)
    millimetres = split_mesh(RangeImage(1000.0 * image.points, image.valid, image.eye), count=300)
    shared = set(map(tuple, metres.pixels.tolist())) & set(map(tuple, millimetres.pixels.tolist()))
    assert len(shared) > 0.95 * len(metres.pixels)
    assert millimetres.noise == pytest.approx(1000 * metres.noise)


def test_a_transposed_image_gives_as_good_a_mesh() -> None:
    image = scanned("boulder", 100, Laser(sigma=0.001))
    for bound in (0.5, 0.1):
        plain = split_mesh(image, options=SplitOptions(bound=bound))
        turned = split_mesh(transposed(image), options=SplitOptions(bound=bound))
        assert len(turned.vertices) == pytest.approx(len(plain.vertices), rel=0.1)
        assert pixel_area(turned).sum() == pytest.approx(pixel_area(plain).sum(), rel=0.02)


def test_same_image_gives_the_same_points() -> None:
    image = scanned("block_steps", 100)
    np.testing.assert_array_equal(split_control_points(image, 250).points, split_control_points(image, 250).points)


def test_contours_put_vertices_on_the_creases() -> None:
    image = scanned("block_steps", 150)
    plain = split_mesh(image, count=300)
    cloud = split_control_points(image, 300)
    assert len(cloud) == pytest.approx(300, rel=0.05)
    # the faces are planes: most of their vertices are where they end
    from jaxmodel.control_points.edges import EdgeKind, find_edges

    edge = KDTree(np.argwhere(find_edges(image).kind != EdgeKind.NONE))
    row = np.flatnonzero(image.valid)[np.asarray(KDTree(image.points[image.valid]).query(cloud.points)[1])]
    with_contours = np.mean(np.asarray(edge.query(np.stack(np.divmod(row, 150), axis=1))[0]) <= 1)
    without = np.mean(np.asarray(edge.query(plain.pixels)[0]) <= 1)
    assert with_contours > without and with_contours > 0.5


@pytest.mark.parametrize(
    ("image", "says"),
    [
        (Cloud(np.eye(3)), "needs a range image"),
        (height_field(np.zeros((1, 30))), "1 x 30"),
        (height_field(np.full((20, 30), np.nan)), "no valid pixel"),
    ],
)
def test_bad_scans_are_refused(image: Scan, says: str) -> None:
    with pytest.raises(InputError, match=says):
        split_mesh(image)
    with pytest.raises(InputError, match=says):
        split_control_points(image, 100)


@pytest.mark.parametrize("count", [-5, 0, 2])
def test_counts_below_three_are_refused(count: int) -> None:
    with pytest.raises(InputError, match=f"count is {count}"):
        split_mesh(waves(), count=count)
    with pytest.raises(InputError, match=f"count is {count}"):
        split_control_points(waves(), count)


def test_readings_in_a_line_make_no_mesh() -> None:
    z = np.full((20, 30), np.nan)
    z[8] = 0.0
    image = height_field(z)
    assert len(split_mesh(image).triangles) == 0
    with pytest.raises(InputError, match="no surface"):
        split_control_points(image, 10)


@pytest.mark.data
@pytest.mark.parametrize("name", ["bun000", "top3"])
def test_real_scan(data_dir: Path, name: str) -> None:
    from jaxmodel.io.scans import load_scan

    image = load_scan(data_dir / "stanford_bunny" / "data" / f"{name}.ply")
    assert isinstance(image, RangeImage)
    for count in (350, 2000):
        cloud = split_control_points(image, count)
        assert abs(len(cloud) - count) <= 0.05 * count
        assert KDTree(image.points[image.valid]).query(cloud.points)[0].max() == 0.0
