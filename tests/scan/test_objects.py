"""The built-in objects: closed, outward, of size 1, and registrable in one way only."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jaxmodel.errors import InputError
from jaxmodel.scan.objects import FREE_FORM, OBJECTS, STRUCTURED, ObjectMesh, object_mesh

NAMES = list(OBJECTS)


def parts(mesh: ObjectMesh) -> list[np.ndarray]:
    """Faces of each connected part."""
    n = len(mesh.vertices)
    edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, label = connected_components(coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)))
    return [mesh.faces[label[mesh.faces[:, 0]] == k] for k in np.unique(label)]


def volume_grid(mesh: ObjectMesh, points: np.ndarray) -> np.ndarray:
    """Whether each point is inside the union of the parts."""
    import open3d

    inside = np.zeros(len(points), dtype=bool)
    for faces in parts(mesh):
        scene = open3d.t.geometry.RaycastingScene()
        scene.add_triangles(
            open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(faces.astype(np.uint32))
        )
        inside |= scene.compute_occupancy(open3d.core.Tensor(points.astype(np.float32)), nsamples=3).numpy() > 0.5
    return inside


def test_there_are_two_families():
    assert list(STRUCTURED) == ["block_steps", "block_curved", "y_pipe", "valve"]
    assert len(FREE_FORM) >= 3 and {**STRUCTURED, **FREE_FORM} == OBJECTS


def test_an_unknown_object_is_refused_with_the_names():
    with pytest.raises(InputError, match=r"'teapot'.*block_steps.*torso"):
        object_mesh("teapot")


@pytest.mark.parametrize("name", NAMES)
def test_each_part_is_closed_and_outward(name):
    mesh = object_mesh(name)
    assert np.isfinite(mesh.vertices).all() and np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))
    for faces in parts(mesh):
        directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        pairs = {tuple(edge) for edge in directed.tolist()}
        assert len(pairs) == len(directed), "an edge is used twice in one direction"
        assert all((b, a) in pairs for a, b in pairs), "an edge has no opposite"
        corner = mesh.vertices[faces]
        assert np.sum(corner[:, 0] * np.cross(corner[:, 1], corner[:, 2])) > 0
        # Euler: 2 for a ball, 0 for the hand wheel's ring.
        assert len(np.unique(faces)) - len(directed) // 2 + len(faces) in (0, 2)
        assert np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).min() > 0


@pytest.mark.parametrize("name", NAMES)
def test_size_is_one_and_the_object_the_same_each_time(name):
    mesh, again = object_mesh(name), object_mesh(name)
    assert mesh.size() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0), 0.0, atol=1e-12)
    np.testing.assert_array_equal(mesh.vertices, again.vertices)


@pytest.mark.parametrize("name", FREE_FORM)
def test_free_form_objects_are_one_surface_of_the_stated_density(name):
    assert len(parts(object_mesh(name))) == 1
    assert len(object_mesh(name).faces) == 20 * 4**5


@pytest.mark.parametrize("name", NAMES)
def test_no_rotation_maps_the_object_to_itself(name):
    """A rotation of a body to itself keeps its centroid and its inertia ellipsoid.

    With three distinct principal moments only the half-turns about the principal axes do; each is tried.
    """
    mesh = object_mesh(name)
    axis = np.linspace(-0.62, 0.62, 63)
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    body = grid[volume_grid(mesh, grid)]
    centre = body.mean(axis=0)
    moments, axes = np.linalg.eigh(np.cov((body - centre).T))
    assert (np.diff(moments) > 0.04 * moments[1:]).all(), moments
    for direction in axes.T:
        half_turn = 2 * np.outer(direction, direction) - np.eye(3)
        turned = (body - centre) @ half_turn.T + centre
        outside = 1.0 - volume_grid(mesh, turned).mean()
        assert outside > 0.03, f"a half-turn about {direction} keeps {1 - outside:.3f} of the body"
