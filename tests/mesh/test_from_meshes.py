"""Pivoting from local meshes and from the border of a mesh."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.mesh.from_meshes import border_radius, close_border, pivot_views, vertex_normals
from jaxmodel.mesh.growth import rests
from jaxmodel.mesh.quality import quality
from jaxmodel.scan.triangle_mesh import ObjectMesh, icosphere, ring

SPHERE = icosphere(4)


def patch(mesh: ObjectMesh, keep: np.ndarray) -> ObjectMesh:
    """The triangles ``keep`` as a mesh of their own."""
    used, faces = np.unique(mesh.faces[keep], return_inverse=True)
    return ObjectMesh(mesh.vertices[used], faces.reshape(-1, 3))


def middles(mesh: ObjectMesh) -> np.ndarray:
    return mesh.vertices[mesh.faces].mean(axis=1)


def test_vertex_normals_of_a_sphere() -> None:
    assert np.einsum("na,na->n", vertex_normals(SPHERE), SPHERE.vertices).min() > 0.999


def test_a_ball_rests_on_the_outside_of_a_convex_mesh_only() -> None:
    assert rests(SPHERE.vertices, SPHERE.vertices, SPHERE.faces, 0.3).all()
    lifted = np.concatenate([SPHERE.vertices, [1.02 * middles(SPHERE)[0]]])
    ball = rests(lifted, lifted, SPHERE.faces, 0.3)
    assert not ball[0] and ball.sum() > 0.9 * len(ball)
    assert not rests(SPHERE.vertices, SPHERE.vertices, SPHERE.faces, 0.02).any()  # falls through


def test_views_that_agree_are_joined_with_their_own_triangles() -> None:
    z = middles(SPHERE)[:, 2]
    made = pivot_views([patch(SPHERE, z > -0.3), patch(SPHERE, z < 0.3)])
    found = quality(made.mesh)
    assert found.closed and found.euler == 2
    assert found.vertices == len(SPHERE.vertices)  # what both views have is there once
    assert made.passes[0].triangles < found.triangles / 2  # the seeds were there before the ball


@pytest.mark.parametrize("seed", [0, 1])
def test_offset_views_become_one_sheet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    z = middles(SPHERE)[:, 2]
    views = [patch(SPHERE, z > -0.5), patch(SPHERE, z < 0.5), patch(SPHERE, middles(SPHERE)[:, 0] > -0.5)]
    moved = [ObjectMesh(view.vertices + 0.01 * rng.normal(size=3), view.faces) for view in views]
    found = quality(pivot_views(moved).mesh)
    assert (found.euler, found.components, found.crowded_edges, found.turned_pairs) == (2, 1, 0, 0)
    assert found.closed
    assert found.area == pytest.approx(quality(SPHERE).area, rel=0.03)


@pytest.mark.parametrize("mesh", [SPHERE, ring(1, 0.4)])
def test_holes_are_closed_from_the_border(mesh: ObjectMesh) -> None:
    rng = np.random.default_rng(2)
    holes = mesh.vertices[rng.permutation(len(mesh.vertices))[:4]]
    away = np.linalg.norm(middles(mesh)[:, None] - holes, axis=2).min(axis=1)
    torn = ObjectMesh(mesh.vertices, mesh.faces[away > 0.2])
    before, closed = quality(torn), close_border(torn)
    found = quality(closed.mesh)
    assert before.border_loops > 0
    assert found.closed and found.euler == quality(mesh).euler
    assert closed.added == found.triangles - before.triangles
    np.testing.assert_array_equal(closed.mesh.vertices, torn.vertices)


def test_marching_cubes_cut_by_their_box_are_closed() -> None:
    from skimage.measure import marching_cubes

    x, y, z = np.meshgrid(*(np.linspace(-1.2, 1.2, 40),) * 3, indexing="ij")
    vertices, faces, _, _ = marching_cubes(np.sqrt(x**2 + y**2 + z**2)[:, :, :35], 1.0)
    mesh = ObjectMesh(vertices.astype(np.float64), faces[:, ::-1].astype(np.int64))
    if np.einsum("na,na->", vertex_normals(mesh), mesh.vertices - mesh.vertices.mean(axis=0)) < 0:
        mesh = ObjectMesh(mesh.vertices, mesh.faces[:, ::-1])
    assert quality(mesh).border_loops == 1
    found = quality(close_border(mesh, most_edges=200).mesh)
    assert found.closed and found.euler == 2


def test_the_first_ball_fits_the_border() -> None:
    z = middles(SPHERE)[:, 2]
    torn = patch(SPHERE, z > 0)
    edge = np.linalg.norm(torn.vertices[torn.faces[:, 0]] - torn.vertices[torn.faces[:, 1]], axis=1)
    assert edge.min() / np.sqrt(3) < border_radius(torn) < edge.max()
    assert border_radius(SPHERE) == 0.0
    assert close_border(SPHERE).added == 0


def test_nothing_to_start_from_is_said() -> None:
    empty = ObjectMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    with pytest.raises(InputError, match="no view with triangles"):
        pivot_views([empty])
    with pytest.raises(InputError, match="no border"):
        close_border(empty)
