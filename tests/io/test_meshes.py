"""Mesh files: triangles as written, polygons split, bad files named."""

import numpy as np
import pytest
import trimesh

from jaxmodel.errors import InputError
from jaxmodel.io.meshes import load_mesh
from jaxmodel.scan.triangle_mesh import box

CUBE = box((0, 0, 0), (1, 2, 3))


def corners(mesh) -> np.ndarray:
    """Triangles as a sorted list of corner coordinates, whatever the vertex numbering."""
    triangles = mesh.vertices[mesh.faces].reshape(len(mesh.faces), 9)
    return triangles[np.lexsort(triangles.T)]


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl"])
def test_triangles_come_back_as_written(tmp_path, suffix):
    path = tmp_path / f"cube{suffix}"
    trimesh.Trimesh(CUBE.vertices, CUBE.faces, process=False).export(path)
    np.testing.assert_array_equal(corners(load_mesh(path)), corners(CUBE))


def test_a_quadrangle_becomes_two_triangles(tmp_path):
    path = tmp_path / "quad.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    mesh = load_mesh(path)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    np.testing.assert_allclose(np.cross(b - a, c - a).sum(axis=0) / 2, [0, 0, 1])


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("mesh.step", "x", "unknown mesh extension"),
        ("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", r"points\.obj has no faces"),
        ("far.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", r"far\.obj"),
        ("nan.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", r"nan\.obj: vertex 1 .*not finite"),
        ("bad.stl", "solid of words", r"bad\.stl"),
    ],
)
def test_bad_meshes_are_named(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message):
        load_mesh(tmp_path / name)


def test_a_missing_mesh_is_named(tmp_path):
    with pytest.raises(InputError, match=r"There is no file .*gone\.obj"):
        load_mesh(tmp_path / "gone.obj")


@pytest.mark.data
@pytest.mark.parametrize(("name", "faces"), [("fandisk", 12946), ("wingnut", 6090), ("spot", 5856), ("suzanne", 968)])
def test_published_counts(data_dir, name, faces):
    assert len(load_mesh(data_dir / "meshes" / f"{name}.obj").faces) == faces
