"""Vertices between primitives: on the meeting line, near where they were, and no triangle turned over."""

import numpy as np
import pytest

from jaxmodel.mesh import Segmentation, segment
from jaxmodel.mesh.adjacency import face_vectors
from jaxmodel.mesh.primitives import Surface, offset
from jaxmodel.scan.polyhedron import nine_facets
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, lathe


def noisy(mesh: ObjectMesh, seed: int) -> ObjectMesh:
    return ObjectMesh(mesh.vertices + 1e-3 * np.random.default_rng(seed).normal(size=mesh.vertices.shape), mesh.faces)


def misfits(found: Segmentation) -> tuple[np.ndarray, np.ndarray]:
    """Of each vertex, on how many segments it lies and how far it is from the farthest of them."""
    vertices, faces = found.mesh.vertices, found.mesh.faces
    number, farthest = np.zeros(len(vertices), int), np.zeros(len(vertices))
    for primitive in found.primitives:
        some = np.unique(faces[primitive.faces])
        surface = Surface(primitive.kind, primitive.point, primitive.direction, primitive.radius)
        number[some] += 1
        farthest[some] = np.maximum(farthest[some], np.abs(offset(surface, vertices[some])[0]))
    return number, farthest


CAN = lathe([(0, 0), (0.2, 0)] + [(0.375, z / 20) for z in range(21)] + [(0.2, 1), (0, 1)], 96)


@pytest.mark.parametrize("mesh", [box((0, 0, 0), (1, 1, 1), 25), nine_facets(4)[0], CAN], ids=["cube", "nine", "can"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_borders_lie_on_both_surfaces_and_nothing_turns_over(mesh: ObjectMesh, seed: int) -> None:
    given = noisy(mesh, seed)
    found = segment(given)
    number, farthest = misfits(found)
    moved = np.linalg.norm(found.mesh.vertices - given.vertices, axis=1)
    assert moved.max() <= found.snap_bound * (1 + 1e-9)
    assert (moved[number == 1] == 0).all()
    snapped = moved > 0
    assert farthest[snapped].max() < 1e-9
    assert snapped[number > 1].mean() > 0.9
    before, after = (face_vectors(m.vertices, m.faces) for m in (given, found.mesh))
    assert (np.einsum("ij,ij->i", before, after) > 0).all()


def test_the_corners_of_a_noisy_cube_come_back() -> None:
    found = segment(noisy(box((0, 0, 0), (1, 1, 1), 25), 4))
    number, _ = misfits(found)
    corners = found.mesh.vertices[number == 3]
    assert len(corners) == 8
    # planes fitted to 650 vertices each are ten times better than a vertex
    assert np.abs(corners - np.round(corners)).max() < 4e-4


def test_without_snapping_the_mesh_comes_back_as_it_was() -> None:
    given = noisy(box((0, 0, 0), (1, 1, 1), 10), 0)
    np.testing.assert_array_equal(segment(given, snapping=False).mesh.vertices, given.vertices)
