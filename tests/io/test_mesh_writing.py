"""Written meshes read back as they were, by our reader and by Open3D."""

from pathlib import Path

import numpy as np
import open3d
import pytest
import trimesh

from jaxmodel.io.mesh_writing import mesh_bytes
from jaxmodel.io.meshes import load_mesh
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere

FAR = np.array([512_345.678901, 5_234_567.891234, 100.0])
"""A place where float32 would keep three centimetres."""


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_vertices_come_back_to_the_last_bit(tmp_path: Path, suffix: str) -> None:
    ball = icosphere(2)
    mesh = ObjectMesh(ball.vertices + FAR, ball.faces)
    path = tmp_path / f"mesh{suffix}"
    path.write_bytes(mesh_bytes(mesh, suffix, ball.vertices))
    back = load_mesh(path)
    np.testing.assert_array_equal(back.vertices, mesh.vertices)
    np.testing.assert_array_equal(back.faces, mesh.faces)


def test_an_stl_has_the_same_triangles(tmp_path: Path) -> None:
    mesh = box((0, 0, 0), (1, 2, 3), cells=2)
    path = tmp_path / "mesh.stl"
    path.write_bytes(mesh_bytes(mesh, ".stl", 0 * mesh.vertices))
    back = load_mesh(path)
    np.testing.assert_array_equal(back.vertices[back.faces], mesh.vertices[mesh.faces].astype(np.float32))


def test_a_ply_keeps_normals_and_the_colours_of_its_triangles(tmp_path: Path) -> None:
    mesh = icosphere(1)
    colours = np.random.default_rng(0).integers(0, 256, (len(mesh.faces), 3)).astype(np.uint8)
    path = tmp_path / "mesh.ply"
    path.write_bytes(mesh_bytes(mesh, ".ply", mesh.vertices, colours))
    normals = np.asarray(open3d.io.read_triangle_mesh(str(path)).vertex_normals)
    np.testing.assert_allclose(normals, mesh.vertices, atol=1e-6)
    loaded = trimesh.load(path, process=False)
    assert isinstance(loaded, trimesh.Trimesh)
    np.testing.assert_array_equal(np.asarray(loaded.visual.face_colors)[:, :3], colours)  # pyright: ignore
