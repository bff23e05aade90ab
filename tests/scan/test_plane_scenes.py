"""The scenes of Figs 3.10 and 3.11: their counts, their planes, and that a clean mesh of them has as many segments."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.mesh import segment
from jaxmodel.scan.plane_scenes import PlaneScene, crossing_planes, one_plane
from jaxmodel.scan.polyhedron import subdivided
from jaxmodel.scan.triangle_mesh import ObjectMesh, join


@pytest.mark.parametrize(
    ("scene", "points", "triangles", "views", "planes"),
    [(one_plane(), 320, 504, 4, 1), (crossing_planes(), 480, 756, 6, 2)],
)
def test_the_counts_are_the_thesis_s(scene: PlaneScene, points: int, triangles: int, views: int, planes: int) -> None:
    assert scene.points.shape == scene.normals.shape == (points, 3)
    assert scene.faces.shape == (triangles, 3)
    assert len(scene.T_world_view) == views and len(scene.planes) == planes
    assert (np.bincount(scene.view) == 80).all()
    assert (scene.view[scene.faces] == scene.view[scene.faces[:, :1]]).all()


@pytest.mark.parametrize("make", [one_plane, crossing_planes])
def test_views_are_off_by_their_registration_alone(make) -> None:
    offset = 0.2
    exact, scene = make(0.0, 0.0), make(offset, 1.0, seed=3)
    for view, T in enumerate(scene.T_world_view):
        own = scene.view == view
        np.testing.assert_allclose(scene.points[own], exact.points[own] @ T[:3, :3].T + T[:3, 3], atol=1e-12)
        np.testing.assert_allclose(scene.normals[own], exact.normals[own] @ T[:3, :3].T, atol=1e-12)
        plane = scene.planes[scene.plane[own][0]]
        assert np.abs((exact.points[own] - plane[0]) @ plane[1]).max() < 1e-12
        assert np.abs((scene.points[own] - plane[0]) @ plane[1]).mean() == pytest.approx(offset, rel=0.2)
    again = make(offset, 1.0, seed=3)
    np.testing.assert_array_equal(scene.points, again.points)


def test_views_overlap_and_the_planes_cross_at_right_angles() -> None:
    scene = crossing_planes(0.0, 0.0)
    assert scene.planes[0, 1] @ scene.planes[1, 1] == 0
    boxes = [(scene.points[scene.view == v].min(axis=0), scene.points[scene.view == v].max(axis=0)) for v in range(6)]
    for one, other in [(0, 1), (0, 2), (1, 3), (2, 3), (4, 5)]:
        low, high = np.maximum(boxes[one][0], boxes[other][0]), np.minimum(boxes[one][1], boxes[other][1])
        assert (high - low > -1e-12).all() and sorted(high - low)[1] > 1
    side = (scene.points[scene.plane == 0] - scene.planes[1, 0]) @ scene.planes[1, 1]
    assert side.min() < -1 and side.max() > 1


@pytest.mark.parametrize(("make", "segments"), [(one_plane, 1), (crossing_planes, 2)])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_clean_mesh_has_as_many_segments(make, segments: int, seed: int) -> None:
    scene = make(0.0, 0.0)
    sheets = []
    for number, (point, normal) in enumerate(scene.planes):
        own = scene.points[scene.plane == number]
        low, high = own.min(axis=0), own.max(axis=0)
        axes = np.flatnonzero(np.abs(normal) < 0.5)
        corners = np.repeat(point[None], 4, axis=0)
        corners[:, axes] = [
            [low[axes[0]], low[axes[1]]],
            [high[axes[0]], low[axes[1]]],
            [high[axes[0]], high[axes[1]]],
            [low[axes[0]], high[axes[1]]],
        ]
        sheets.append(subdivided(ObjectMesh(corners, np.array([[0, 1, 2], [0, 2, 3]])), 4))
    mesh = join(*sheets)
    scatter = 0.05 * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    found = segment(ObjectMesh(mesh.vertices + scatter, mesh.faces))
    assert found.count("plane") == len(found.primitives) == segments


@pytest.mark.parametrize("wrong", [(-0.1, 0.5), (0.1, -1.0), (np.nan, 0.5)])
def test_a_negative_error_is_refused(wrong: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="offset and tilt"):
        one_plane(*wrong)
