"""Normals come with the points where a file has them, whatever its format."""

from pathlib import Path

import numpy as np
import open3d
import pytest

from jaxmodel.io.mesh_writing import mesh_bytes
from jaxmodel.io.oriented import load_oriented
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.triangle_mesh import icosphere

RANDOM = np.random.default_rng(3)
POINTS = RANDOM.standard_normal((40, 3))
NORMALS = RANDOM.standard_normal((40, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
ROWS = [[repr(float(value)) for value in row] for row in np.concatenate([POINTS, NORMALS], axis=1)]


def read(path: Path) -> Cloud:
    cloud = load_oriented(path)
    assert isinstance(cloud, Cloud)
    return cloud


@pytest.mark.parametrize("ascii_file", [True, False])
@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_ply_and_pcd(tmp_path: Path, suffix: str, ascii_file: bool) -> None:
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(POINTS))
    cloud.normals = open3d.utility.Vector3dVector(NORMALS)
    open3d.io.write_point_cloud(str(tmp_path / f"cloud{suffix}"), cloud, write_ascii=ascii_file)
    back = read(tmp_path / f"cloud{suffix}")
    np.testing.assert_allclose(back.points, POINTS, atol=1e-5)
    assert back.normals is not None
    np.testing.assert_allclose(back.normals, NORMALS, atol=1e-5)


@pytest.mark.parametrize("separator", [" ", ", ", ";"])
def test_six_columns_of_text(tmp_path: Path, separator: str) -> None:
    (tmp_path / "cloud.xyz").write_text("# x y z nx ny nz\n" + "\n".join(separator.join(row) for row in ROWS))
    back = read(tmp_path / "cloud.xyz")
    np.testing.assert_array_equal(back.points, POINTS)
    np.testing.assert_array_equal(back.normals, NORMALS)


def test_six_columns_that_are_colours_are_no_normals(tmp_path: Path) -> None:
    (tmp_path / "cloud.xyz").write_text("\n".join(" ".join([*row[:3], "0.2", "0.3", "0.4"]) for row in ROWS))
    assert read(tmp_path / "cloud.xyz").normals is None


def test_an_obj_with_a_normal_for_each_vertex(tmp_path: Path) -> None:
    ball = icosphere(1)
    (tmp_path / "ball.obj").write_bytes(mesh_bytes(ball, ".obj", ball.vertices))
    back = read(tmp_path / "ball.obj")
    np.testing.assert_array_equal(back.points, ball.vertices)
    assert back.normals is not None
    np.testing.assert_allclose(back.normals, ball.vertices, atol=1e-5)


def test_an_obj_whose_corners_have_normals_of_their_own(tmp_path: Path) -> None:
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "vn 0 0 1", "vn 0 1 0", "vn 1 0 0", "f 1//2 2//3 3//1"]
    (tmp_path / "corners.obj").write_text("\n".join(lines) + "\n")
    back = read(tmp_path / "corners.obj")
    assert back.normals is None and len(back) == 3


def test_a_file_without_normals_has_none(tmp_path: Path) -> None:
    (tmp_path / "bare.xyz").write_text("\n".join(" ".join(row[:3]) for row in ROWS))
    (tmp_path / "bare.pts").write_text("\n".join("p " + " ".join(row[:3]) for row in ROWS))
    for name in ("bare.xyz", "bare.pts"):
        back = read(tmp_path / name)
        assert back.normals is None
        np.testing.assert_array_equal(back.points, POINTS)
