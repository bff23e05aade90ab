"""Measures of meshes against closed forms and hand-counted meshes."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import vertex_normals
from jaxmodel.mesh.distance import sample_surface, surface_distance, to_surface
from jaxmodel.mesh.quality import quality, smoothness, triangle_shape
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join, ring

SQUARE = ObjectMesh(
    np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int64)
)


def test_shape_of_known_triangles() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, np.sqrt(0.75), 0], [2, 0, 0]])
    faces = np.array([[0, 1, 3], [0, 1, 2], [0, 1, 4], [0, 0, 0]])
    expected = [1.0, np.sqrt(3) / (1 + np.sqrt(2)), 0.0, 0.0]  # the second: §3.5.1's 0.7174
    np.testing.assert_allclose(triangle_shape(corners, faces), expected, atol=1e-12)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0, 150.0])
def test_smoothness_is_the_mean_cosine_of_existing_neighbours(angle_deg: float) -> None:
    angle = np.deg2rad(angle_deg)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -np.cos(angle), np.sin(angle)]])
    two = np.array([[0, 1, 2], [1, 0, 3]])
    np.testing.assert_allclose(smoothness(corners, two), np.cos(angle), atol=1e-12)
    assert np.isnan(smoothness(corners, two[:1])).all()


@pytest.mark.parametrize(
    ("mesh", "euler", "components"),
    [
        (icosphere(3), 2, 1),
        (ring(1, 0.3), 0, 1),
        (box((0, 0, 0), (1, 1, 1), 4), 2, 1),
        (join(box((0, 0, 0), (1, 1, 1)), box((3, 0, 0), (4, 1, 1)), ring(9, 1)), 4, 3),
    ],
)
def test_closed_meshes(mesh: ObjectMesh, euler: int, components: int) -> None:
    found = quality(mesh)
    assert found.closed
    assert (found.euler, found.components, found.border_loops, found.border_length) == (euler, components, 0, 0.0)
    assert found.Q_equ_histogram.counts.sum() == found.Q_nor_histogram.counts.sum() == found.triangles


def test_a_square_with_all_it_lacks() -> None:
    found = quality(SQUARE)
    assert (found.border_edges, found.border_loops, found.euler, found.turned_pairs) == (4, 1, 1, 0)
    assert (found.area, found.border_length) == pytest.approx((1.0, 4.0))
    assert not found.closed
    turned = quality(ObjectMesh(SQUARE.vertices, SQUARE.faces[:, [0, 2, 1]][[0]].repeat(1, 0)))
    assert turned.triangles == 1 and turned.unused_vertices == 1 and np.isnan(turned.Q_nor)
    flipped = ObjectMesh(SQUARE.vertices, np.stack([SQUARE.faces[0], SQUARE.faces[1][::-1]]))
    assert quality(flipped).turned_pairs == 1
    fan = ObjectMesh(np.concatenate([SQUARE.vertices, [[0.5, 0.5, 1.0]]]), np.concatenate([SQUARE.faces, [[0, 2, 4]]]))
    assert quality(fan).crowded_edges == 1


def test_two_holes_are_two_loops() -> None:
    mesh = icosphere(3)
    centre = mesh.vertices[mesh.faces].mean(axis=1)
    open_mesh = ObjectMesh(mesh.vertices, mesh.faces[np.abs(centre[:, 2]) < 0.9])
    found = quality(open_mesh)
    assert (found.border_loops, found.euler, found.components) == (2, 0, 1)


def test_a_mesh_without_triangles_is_refused() -> None:
    nothing = ObjectMesh(np.zeros((3, 3)), np.zeros((0, 3), np.int64))
    with pytest.raises(InputError, match="no triangles"):
        quality(nothing)
    with pytest.raises(InputError, match="reference has no triangles"):
        surface_distance(SQUARE, nothing)


def test_distance_of_parallel_squares_and_spheres() -> None:
    above = ObjectMesh(SQUARE.vertices + np.array([0, 0, 0.25]), SQUARE.faces)
    found = surface_distance(SQUARE, above, samples=2000)
    for way in found:
        assert way.mean == pytest.approx(0.25, abs=1e-6) and way.largest == pytest.approx(0.25, abs=1e-6)
    sphere = icosphere(5)
    larger = ObjectMesh(1.1 * sphere.vertices, sphere.faces)
    assert surface_distance(sphere, larger, samples=5000).hausdorff == pytest.approx(0.1, abs=1e-3)
    # only a part of the reference is there: far from it one way, on it the other
    part = ObjectMesh(sphere.vertices, sphere.faces[sphere.vertices[sphere.faces].mean(axis=1)[:, 2] > 0])
    one_sided = surface_distance(part, sphere, samples=5000)
    assert one_sided.there.largest < 1e-6 < 0.5 < one_sided.back.largest


def test_samples_are_spread_by_area_and_far_origins_do_no_harm() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [9, 0, 0], [5, 3, 0.0]])
    mesh = ObjectMesh(corners, np.array([[0, 1, 2], [3, 4, 5]]))
    points = sample_surface(mesh, 1300)
    assert (points[:, 0] > 2).sum() == pytest.approx(1200, abs=1)
    far = ObjectMesh(corners + 1e6, mesh.faces)
    assert to_surface(sample_surface(far, 500), far).max() < 1e-6


def test_vertex_normals_of_a_cube_point_along_its_diagonals() -> None:
    mesh = box((-1, -1, -1), (1, 1, 1), cells=2)
    corner = np.abs(mesh.vertices).min(axis=1) == 1
    cosine = np.einsum(
        "ij,ij->i",
        vertex_normals(mesh),
        mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None],
    )
    assert corner.sum() == 8 and (cosine[corner] > 0.9).all()
    middle = np.abs(mesh.vertices).sum(axis=1) == 1
    np.testing.assert_allclose(vertex_normals(mesh)[middle], mesh.vertices[middle], atol=1e-12)


def test_a_vertex_without_triangle_has_no_normal() -> None:
    mesh = ObjectMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]), np.array([[0, 1, 2]]))
    np.testing.assert_array_equal(vertex_normals(mesh), [[0, 0, 1]] * 3 + [[0, 0, 0]])
