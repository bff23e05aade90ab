"""Laws of mesh control points: the count is reached, snapped points are measured ones, units do not matter."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.control_points import mesh_control_points
from jaxmodel.errors import InputError
from jaxmodel.scan.range_image import RangeImage, to_cloud

ROWS, COLUMNS = 50, 60


def relief(scale: float = 1.0, offset: float = 0.0, flat: bool = False) -> RangeImage:
    """A height field seen from above with a hole: waves on its right half, a plane on its left."""
    x, y = np.meshgrid(np.arange(COLUMNS, dtype=float), np.arange(ROWS, dtype=float))
    bend = np.clip((x - COLUMNS / 2) / 8, 0.0, 1.0)
    z = np.zeros_like(x) if flat else 2.0 * bend * np.sin(x / 3.0) * np.cos(y / 4.0)
    valid = (x - 15) ** 2 + (y - 20) ** 2 > 36
    points = scale * np.stack([x, y, z], axis=-1) + offset
    points[~valid] = np.nan
    return RangeImage(points=points, valid=valid, eye=np.array([0.0, 0.0, 1.0, 0.0]))


@pytest.mark.parametrize("at", ["vertices", "centres"])
@pytest.mark.parametrize("snap", [True, False])
@pytest.mark.parametrize("count", [100, 300, 900])
def test_count_is_reached_within_two_percent(at: str, snap: bool, count: int) -> None:
    cloud = mesh_control_points(relief(), count, at=at, snap=snap)  # type: ignore[arg-type]
    assert abs(len(cloud) - count) <= 0.02 * count
    assert np.isfinite(cloud.points).all()


@pytest.mark.parametrize("at", ["vertices", "centres"])
def test_snapped_points_are_distinct_measured_points_with_their_normals_and_borders(at: str) -> None:
    image = relief()
    measured = to_cloud(image)
    cloud = mesh_control_points(image, 400, at=at)  # type: ignore[arg-type]
    distance, rows = map(np.asarray, KDTree(measured.points).query(cloud.points))
    assert distance.max() == 0.0
    assert np.unique(rows).shape == rows.shape == (len(cloud),)
    assert measured.normals is not None and measured.border is not None
    np.testing.assert_array_equal(cloud.normals, measured.normals[rows])
    np.testing.assert_array_equal(cloud.border, measured.border[rows])
    assert cloud.border is not None and cloud.border.any() and not cloud.border.all()


def test_unsnapped_vertices_move_off_the_measured_points_but_not_off_the_surface() -> None:
    image = relief()
    cloud = mesh_control_points(image, 400, snap=False)
    distance = KDTree(to_cloud(image).points).query(cloud.points)[0]
    assert distance.max() > 0.05
    assert distance.max() < 1.5


def test_vertices_gather_where_the_surface_bends() -> None:
    cloud = mesh_control_points(relief(), 300)
    assert cloud.border is not None
    inner = cloud.points[~cloud.border]
    waves = np.count_nonzero(inner[:, 0] > COLUMNS / 2)
    assert waves > 5 * (len(inner) - waves)


@pytest.mark.parametrize("at", ["vertices", "centres"])
def test_flat_surface_stays_on_its_plane(at: str) -> None:
    cloud = mesh_control_points(relief(flat=True), 200, at=at, snap=False)  # type: ignore[arg-type]
    assert np.abs(cloud.points[:, 2]).max() < 1e-9


def test_unit_and_origin_do_not_matter() -> None:
    plain = mesh_control_points(relief(), 300)
    small = mesh_control_points(relief(scale=1.0 / 1024.0), 300)
    far = mesh_control_points(relief(offset=1024.0), 300)
    np.testing.assert_allclose(small.points * 1024.0, plain.points, atol=1e-9)
    # Rounding far from the origin may turn a few ties of the collapse order.
    distance = KDTree(far.points - 1024.0).query(plain.points)[0]
    assert np.mean(distance < 1e-6) > 0.9


def test_same_image_gives_the_same_points() -> None:
    np.testing.assert_array_equal(mesh_control_points(relief(), 250).points, mesh_control_points(relief(), 250).points)


def test_more_than_the_mesh_has_gives_every_vertex() -> None:
    image = relief()
    cloud = mesh_control_points(image, 10_000)
    np.testing.assert_array_equal(cloud.points, image.points[image.valid])


def test_isolated_readings_are_left_out_or_refused() -> None:
    image = relief()
    valid = image.valid.copy()
    valid[:4] = False
    valid[1, 1] = True
    points = np.where(valid[..., None], image.points, np.nan)
    lonely = RangeImage(points=points, valid=valid, eye=image.eye)
    assert len(mesh_control_points(lonely, 10_000)) == valid.sum() - 1
    checker = valid & (np.add.outer(np.arange(ROWS), np.arange(COLUMNS)) % 3 == 0) & (np.arange(COLUMNS) % 2 == 0)
    apart = RangeImage(points=np.where(checker[..., None], image.points, np.nan), valid=checker, eye=image.eye)
    with pytest.raises(InputError, match="no triangle"):
        mesh_control_points(apart, 10)


@pytest.mark.parametrize("count", [-1, 0, 2])
def test_counts_below_three_are_refused(count: int) -> None:
    with pytest.raises(InputError, match=f"count is {count}"):
        mesh_control_points(relief(), count)


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize("name", ["bun000", "top3"])
def test_real_scan(data_dir: Path, name: str) -> None:
    from jaxmodel.io.scans import load_scan

    image = load_scan(data_dir / "stanford_bunny" / "data" / f"{name}.ply")
    assert isinstance(image, RangeImage)
    cloud = mesh_control_points(image, 2000)
    assert abs(len(cloud) - 2000) <= 40
    assert KDTree(image.points[image.valid]).query(cloud.points)[0].max() == 0.0
