"""Samples of a surface: on it, inside their triangles, as many as their share of the area."""

import jax
import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.plan.surface_samples import sample_surface
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join, ring

KEY = jax.random.key(5)


def shares_in_triangle(mesh: ObjectMesh, points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (n, 3), solved from the corners."""
    a, b, c = (mesh.vertices[mesh.faces[faces, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    squared = np.sum(normal**2, axis=1)
    of_b = np.sum(np.cross(points - a, c - a) * normal, axis=1) / squared
    of_c = np.sum(np.cross(b - a, points - a) * normal, axis=1) / squared
    return np.stack([1 - of_b - of_c, of_b, of_c], axis=1)


@pytest.mark.parametrize("name", ["boulder", "valve", "block_curved"])
def test_each_sample_lies_strictly_inside_its_triangle_and_has_its_normal(name: str) -> None:
    mesh = object_mesh(name)
    samples = sample_surface(mesh, KEY, 5000)
    shares = shares_in_triangle(mesh, samples.points, samples.faces)
    assert shares.min() >= 1e-3 - 1e-9
    corners = mesh.vertices[mesh.faces[samples.faces]]
    gap = np.sum((samples.points - corners[:, 0]) * samples.normals, axis=1)
    assert np.abs(gap).max() < 1e-14
    np.testing.assert_allclose(np.linalg.norm(samples.normals, axis=1), 1.0)
    wound = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum(wound * samples.normals, axis=1) > 0).all()


def test_weights_sum_to_the_area_and_every_run_of_faces_has_its_share_to_within_one_sample() -> None:
    mesh = join(box((0, 0, 0), (1, 2, 3), 4), ring(9, 2), icosphere(3))
    samples = sample_surface(mesh, KEY, 7001)
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert samples.weights.sum() == pytest.approx(area.sum())
    count = np.bincount(samples.faces, minlength=len(area))
    assert np.abs(np.cumsum(count) - 7001 * np.cumsum(area) / area.sum()).max() < 1


def test_a_triangle_is_filled_evenly() -> None:
    """Each of the four triangles between the middles of the sides holds a quarter."""
    mesh = ObjectMesh(np.array([(0.0, 0, 0), (4, 1, 0), (1, 3, 2)]), np.array([(0, 1, 2)]))
    samples = sample_surface(mesh, KEY, 40_000)
    shares = shares_in_triangle(mesh, samples.points, samples.faces)
    corner = (shares > 0.5).sum(axis=0)
    np.testing.assert_allclose([*corner, 40_000 - corner.sum()], 10_000, atol=5 * np.sqrt(40_000 * 3 / 16))


def test_the_key_decides() -> None:
    mesh = icosphere(2)
    first, again, other = (sample_surface(mesh, jax.random.key(k), 500) for k in (1, 1, 2))
    np.testing.assert_array_equal(first.points, again.points)
    assert not (first.points == other.points).all(axis=1).any()


def test_faces_without_area_get_no_sample() -> None:
    vertices = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0.5, 0, 0)])
    faces = np.array([(0, 1, 3), (0, 0, 1), (0, 1, 2), (1, 1, 1)])
    samples = sample_surface(ObjectMesh(vertices, faces), KEY, 300)
    assert (samples.faces == 2).all() and samples.weights.sum() == pytest.approx(0.5)


def test_bad_input_is_refused() -> None:
    cube = box((0, 0, 0), (1, 1, 1))
    with pytest.raises(InputError, match="no area"):
        sample_surface(ObjectMesh(cube.vertices, cube.faces[:0]), KEY)
    with pytest.raises(InputError, match="no area"):
        sample_surface(ObjectMesh(np.zeros((3, 3)), np.array([(0, 1, 2)])), KEY)
    with pytest.raises(InputError, match="not finite"):
        sample_surface(ObjectMesh(np.full((3, 3), np.nan), np.array([(0, 1, 2)])), KEY)
    with pytest.raises(InputError, match="count"):
        sample_surface(cube, KEY, 0)
