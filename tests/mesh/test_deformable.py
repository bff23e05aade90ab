"""The deformable surface on clouds whose surface is known, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.hoppe import read_hoppe
from jaxmodel.mesh.deformable import DeformableOptions, DeformableOutcome, deform
from jaxmodel.mesh.distance import distance_to_points, sample_surface, surface_distance
from jaxmodel.mesh.quality import quality
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere

COARSE = 4  # 1280 triangles: one compiled program for most tests


@pytest.fixture(scope="module")
def pear() -> ObjectMesh:
    """A smooth closed surface without deep concavities."""
    ball = icosphere(4)
    x, y, _ = ball.vertices.T
    return ObjectMesh(ball.vertices * (1 + 0.25 * np.sin(2 * x) * np.cos(y))[:, None], ball.faces)


@pytest.mark.parametrize("start", ["outside", "inside"])
def test_it_comes_to_rest_on_a_smooth_surface(pear: ObjectMesh, start) -> None:
    cloud = sample_surface(pear, 4000)
    found = deform(cloud, COARSE, start)
    measured = quality(found.mesh)
    assert found.outcome is DeformableOutcome.CONVERGED
    assert measured.closed and measured.euler == 2 and measured.triangles == 1280
    spacing = np.sqrt(quality(pear).area / 4000)
    assert surface_distance(found.mesh, pear, 5000).mean < spacing  # facets cut the curvature's corners
    assert found.error < spacing
    assert measured.Q_equ > 0.8 and measured.Q_nor > 0.98


@pytest.mark.parametrize(("order", "triangles"), [(1, 20), (4, 1280)])
def test_the_order_is_the_thesis_s(pear: ObjectMesh, order: int, triangles: int) -> None:
    found = deform(sample_surface(pear, 500), order, options=DeformableOptions(max_steps=3))
    assert len(found.mesh.faces) == triangles
    assert found.outcome is DeformableOutcome.MAX_STEPS and found.steps == 3


def test_the_unit_and_the_origin_do_not_matter(pear: ObjectMesh) -> None:
    cloud = sample_surface(pear, 4000)
    plain, far = deform(cloud, COARSE), deform(1000.0 * cloud + 5e4, COARSE)
    np.testing.assert_allclose((far.mesh.vertices - 5e4) / 1000.0, plain.mesh.vertices, atol=2e-3)
    assert far.error == pytest.approx(1000.0 * plain.error, rel=0.02)


def test_corners_stay_rounded_and_faces_flat() -> None:
    cube = box((-1, -1, -1), (1, 1, 1))
    found = deform(sample_surface(cube, 6000), COARSE)
    away = surface_distance(found.mesh, cube, 5000)
    assert away.there.percentile_95 < 0.06 and away.back.largest < 0.5


def test_a_cloud_open_below_is_closed_by_the_surface(pear: ObjectMesh) -> None:
    cloud = sample_surface(pear, 4000)
    cloud = cloud[cloud[:, 2] > -0.7]
    found = deform(cloud, COARSE)
    assert quality(found.mesh).closed
    assert distance_to_points(cloud, found.mesh.vertices).mean() < 0.12


def test_a_cat_as_in_table_3_2(data_dir: Path) -> None:
    path = data_dir / "hoppe_points" / "cat10.10000.pts"
    cloud = read_hoppe(path.read_text(), path)
    found = deform(cloud, 5)
    measured = quality(found.mesh)
    assert measured.triangles == 5120 and measured.vertices == 2562
    assert found.error < 0.01 * np.ptp(cloud, axis=0).max()
    assert measured.Q_equ > 0.6 and measured.Q_nor > 0.9  # published: 0.6465 and 0.9282


@pytest.mark.parametrize(
    ("points", "order", "message"),
    [
        (np.zeros((3, 3)), 5, "3 points"),
        (np.zeros((9, 3)), 5, "one spot"),
        (np.full((9, 3), np.nan), 5, "Point 0"),
        (np.eye(4)[:, :3], 0, "order is 0"),
    ],
)
def test_bad_input(points: np.ndarray, order: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        deform(points, order)
