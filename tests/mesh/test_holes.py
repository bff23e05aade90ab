"""Holes: polygons triangulated with least weight, patches that keep the mesh a manifold, and cleaning."""

import numpy as np
import pytest

from jaxmodel.mesh.closing import close
from jaxmodel.mesh.holes import border_loops, close_holes, triangulate
from jaxmodel.mesh.manifold import clean, without_small_parts
from jaxmodel.mesh.quality import quality
from jaxmodel.scan.triangle_mesh import ObjectMesh, icosphere, join

SPHERE = icosphere(3)


def polygon(size: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(size) / size
    return np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


@pytest.mark.parametrize("size", [3, 4, 7, 30])
def test_a_polygon_is_covered_once(size: int) -> None:
    corners = polygon(size)
    cut = triangulate(corners, np.tile([0.0, 0, 1], (size, 1)), np.zeros((size, size), bool))
    assert cut is not None and cut.shape == (size - 2, 3)
    a, b, c = (corners[cut[:, k]] for k in range(3))
    shadow = np.cross(b - a, c - a)[:, 2] / 2
    assert (shadow > 0).all()
    assert shadow.sum() == pytest.approx(size / 2 * np.sin(2 * np.pi / size))


def test_least_weight_is_least_of_all_triangulations() -> None:
    corners = np.array([[0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 1.2, 0.0]])
    up = np.tile([0.0, 0, 1], (4, 1))
    cut = triangulate(corners, up, np.zeros((4, 4), bool))
    assert cut is not None
    shared = set(map(int, cut[0])) & set(map(int, cut[1]))
    assert shared == {0, 2}  # the shorter diagonal
    blocked = np.zeros((4, 4), bool)
    blocked[0, 2] = blocked[2, 0] = True
    other = triangulate(corners, up, blocked)
    assert other is not None and set(map(int, other[0])) & set(map(int, other[1])) == {1, 3}


def test_a_polygon_seen_from_behind_has_no_patch() -> None:
    assert triangulate(polygon(6), np.tile([0.0, 0, -1], (6, 1)), np.zeros((6, 6), bool)) is None


@pytest.mark.parametrize("height", [0.98, 0.9, 0.5])
def test_a_sphere_is_closed_again(height: float) -> None:
    open_faces = SPHERE.faces[SPHERE.vertices[SPHERE.faces].mean(axis=1)[:, 2] < height]
    assert len(border_loops(open_faces)) == 1
    found = quality(ObjectMesh(SPHERE.vertices, close(SPHERE.vertices, SPHERE.vertices, open_faces)))
    assert found.closed and found.euler == 2


def test_refused_patches_and_large_holes_stay_open() -> None:
    faces = SPHERE.faces[np.abs(SPHERE.vertices[SPHERE.faces].mean(axis=1)[:, 2]) < 0.9]
    sizes = sorted(len(loop) for loop in border_loops(faces))
    assert len(close_holes(SPHERE.vertices, SPHERE.vertices, faces, sizes[0] - 1).patches) == 0
    refused = close(SPHERE.vertices, SPHERE.vertices, faces, accept=lambda patch: False)
    assert quality(ObjectMesh(SPHERE.vertices, refused)).border_loops == 2


@pytest.mark.parametrize(("sphere", "height", "edges"), [(SPHERE, 0.99, 5), (icosphere(4), 0.8, 51)])
def test_a_fold_in_the_way_of_a_patch_is_replaced(sphere: ObjectMesh, height: float, edges: int) -> None:
    vertices, normals = sphere.vertices.copy(), sphere.vertices
    faces = sphere.faces[vertices[sphere.faces].mean(axis=1)[:, 2] < height]
    (rim,) = border_loops(faces)
    assert len(rim) >= edges
    vertices[rim[0]] = 1.05 * vertices[rim[len(rim) // 2]]  # pulled over the hole: no patch faces outward
    assert len(close_holes(vertices, normals, faces).patches) == 0
    found = quality(ObjectMesh(vertices, close(vertices, normals, faces)))
    assert found.closed and found.euler == 2


def test_cleaning_leaves_an_oriented_manifold() -> None:
    rng = np.random.default_rng(0)
    faces = SPHERE.faces.copy()
    turned = rng.permutation(len(faces))[:100]
    faces[turned] = faces[turned][:, ::-1]
    extra = rng.integers(0, len(SPHERE.vertices), (40, 3))
    bad = np.concatenate([faces, faces[:30], extra, [[0, 0, 1]]])
    cleaned = clean(SPHERE.vertices, SPHERE.vertices, bad)
    found = quality(ObjectMesh(SPHERE.vertices, cleaned))
    assert (found.crowded_edges, found.turned_pairs) == (0, 0)
    assert len(cleaned) > 0.9 * len(faces)
    np.testing.assert_array_equal(clean(SPHERE.vertices, SPHERE.vertices, cleaned), cleaned)
    untouched = clean(SPHERE.vertices, SPHERE.vertices, SPHERE.faces)
    np.testing.assert_array_equal(untouched, SPHERE.faces)


def test_triangles_that_touch_in_a_point_are_parted() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 0, 0], [-1, -1, 0.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 5]])
    cleaned = clean(vertices, np.tile([0.0, 0, 1], (6, 1)), faces)
    np.testing.assert_array_equal(cleaned, faces[:2])


def test_small_parts_go() -> None:
    both = join(SPHERE, ObjectMesh(0.1 * SPHERE.vertices + [3.0, 0, 0], SPHERE.faces))
    np.testing.assert_array_equal(without_small_parts(both.vertices, both.faces, 0.02), SPHERE.faces)
    assert len(without_small_parts(both.vertices, both.faces, 0.005)) == 2 * len(SPHERE.faces)
