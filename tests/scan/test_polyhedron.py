"""Convex polyhedra against closed forms."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import face_normals
from jaxmodel.mesh.quality import quality
from jaxmodel.scan.polyhedron import nine_facets, polyhedron, subdivided

SIDES = np.concatenate([np.eye(3), -np.eye(3)])


def test_six_planes_are_a_cube() -> None:
    mesh, plane = polyhedron(SIDES, np.full(6, 0.5))
    found = quality(mesh)
    assert (found.vertices, found.triangles, found.euler) == (8, 12, 2) and found.closed
    assert found.area == pytest.approx(6)
    np.testing.assert_allclose(face_normals(mesh.vertices, mesh.faces), SIDES[plane], atol=1e-12)


def test_nine_facets_are_closed_and_all_different() -> None:
    mesh, plane = nine_facets(2)
    found = quality(mesh)
    assert found.closed and found.euler == 2 and mesh.size() == pytest.approx(1)
    normals = face_normals(mesh.vertices, mesh.faces)
    mean = np.array([normals[plane == k].mean(axis=0) for k in range(9)])
    np.testing.assert_allclose(normals, mean[plane], atol=1e-9)
    angle = np.rad2deg(np.arccos(np.clip(mean @ mean.T - 2 * np.eye(9), -1, 1)))
    assert angle.min() > 20


def test_cutting_finer_keeps_the_shape_and_the_order() -> None:
    mesh, plane = polyhedron(SIDES, np.full(6, 0.5))
    fine = subdivided(mesh, 3)
    assert quality(fine).closed and quality(fine).area == pytest.approx(6)
    np.testing.assert_allclose(face_normals(fine.vertices, fine.faces), SIDES[np.repeat(plane, 64)], atol=1e-12)


def test_open_sides_and_an_origin_outside_are_refused() -> None:
    with pytest.raises(InputError, match="origin inside"):
        polyhedron(SIDES, np.array([1, 1, 1, 1, 1, -0.5]))
    with pytest.raises(InputError, match="open"):
        polyhedron(SIDES[:5], np.ones(5))
