"""Sheets that cross are told apart, edges and junctions are not; the thesis's scenes of overlapping views."""

import numpy as np
import pytest

from jaxmodel.mesh import Pivoting, ball_pivoting, quality, segment
from jaxmodel.mesh.crossings import crossing_sheets
from jaxmodel.mesh.from_meshes import pivot_views
from jaxmodel.scan.plane_scenes import PlaneScene, crossing_planes, one_plane
from jaxmodel.scan.triangle_mesh import ObjectMesh, icosphere

GRID = np.stack(np.meshgrid(np.arange(-10.0, 11.0), np.arange(-10.0, 11.0), indexing="ij"), axis=-1).reshape(-1, 2)
FLOOR = np.c_[GRID, 0 * GRID[:, 0]]
WALL = np.c_[0 * GRID[:, 0] + 0.5, GRID[:, 0], GRID[:, 1] + 0.5]
UP, ALONG = np.tile([0, 0, 1.0], (len(GRID), 1)), np.tile([1.0, 0, 0], (len(GRID), 1))


@pytest.mark.parametrize("lift", [0.0, 5.0])
def test_planes_through_one_another_are_two_sheets(lift: float) -> None:
    points, normals = np.concatenate([FLOOR, np.add(WALL, [0, 0, lift])]), np.concatenate([UP, ALONG])
    sheet = crossing_sheets(points, normals, 1.0)
    assert set(sheet[: len(GRID)]).isdisjoint(sheet[len(GRID) :])
    assert len(np.unique(sheet)) == 2


@pytest.mark.parametrize(
    "lower",
    [np.add(WALL, [0, 0, 10.0]), np.add(WALL, [10.0, 0, 10.0]), np.add(WALL, [40.0, 0, 0])],
    ids=["wall on floor", "edge", "apart"],
)
def test_what_only_meets_stays_together(lower: np.ndarray) -> None:
    assert (crossing_sheets(np.concatenate([FLOOR, lower]), np.concatenate([UP, ALONG]), 1.0) == 0).all()


def test_a_smooth_surface_is_one_sheet() -> None:
    points = icosphere(4).vertices
    assert (crossing_sheets(points, points, 0.07) == 0).all()


def from_views(scene: PlaneScene) -> Pivoting:
    """The scene's mesh from its views' own meshes."""
    views = []
    for view in range(scene.view.max() + 1):
        rows = np.flatnonzero(scene.view == view)
        faces = scene.faces[(scene.view[scene.faces] == view).all(axis=1)]
        views.append(ObjectMesh(scene.points[rows], faces - rows[0]))
    return pivot_views(views)


@pytest.mark.parametrize("seed", range(4))
def test_four_views_of_a_plane_are_one_sheet_and_one_segment(seed: int) -> None:
    scene = one_plane(seed=seed)
    assert (len(scene.points), len(scene.faces)) == (320, 504)
    for made in (from_views(scene), ball_pivoting(scene.points, scene.normals)):
        found = quality(made.mesh)
        assert (found.components, found.border_loops, found.euler, found.crowded_edges) == (1, 1, 1, 0)
        corners = made.mesh.vertices[made.mesh.faces]
        shadow = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
        assert (shadow > 0).all()  # no triangle over another: one disk without folds
        assert len(segment(made.mesh).primitives) == 1


@pytest.mark.parametrize("seed", range(4))
def test_views_of_two_planes_that_cross_are_two_sheets_and_two_segments(seed: int) -> None:
    scene = crossing_planes(seed=seed)
    made = from_views(scene)
    found = quality(made.mesh)
    assert (found.components, found.border_loops, found.euler, found.crowded_edges) == (2, 2, 2, 0)
    plane = scene.plane[made.source][made.mesh.faces]
    assert (plane == plane[:, :1]).all()
    segments = segment(made.mesh)
    assert len(segments.primitives) == 2
    assert all(len(np.unique(plane[one.faces])) == 1 for one in segments.primitives)
