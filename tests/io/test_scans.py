"""Every scan format, and each bad file with its sentence."""

import numpy as np
import pytest
import trimesh

from jaxmodel.errors import InputError
from jaxmodel.io.scans import load_scan
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.triangle_mesh import box

POINTS = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32).astype(np.float64)
CUBE = box((0, 0, 0), (1, 2, 3))


def write_points(path, points=POINTS):
    if path.suffix == ".ply":
        trimesh.PointCloud(points).export(path)
    elif path.suffix == ".npz":
        np.savez(path, points=points)
    elif path.suffix == ".pcd":
        lines = ["VERSION .7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1", f"WIDTH {len(points)}"]
        lines += ["HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {len(points)}", "DATA ascii"]
        path.write_text("\n".join([*lines, *(" ".join(repr(float(v)) for v in p) for p in points)]) + "\n")
    else:
        mark = {".pts": "p ", ".obj": "v "}.get(path.suffix, "")
        path.write_text("".join(mark + " ".join(repr(float(v)) for v in p) + "\n" for p in points))
    return path


CLOUD_SUFFIXES = [".ply", ".npz", ".pcd", ".pts", ".xyz", ".txt", ".asc", ".dat"]


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_points_come_back_as_written_and_in_order(tmp_path, suffix):
    scan = load_scan(write_points(tmp_path / f"cloud{suffix}"))
    assert isinstance(scan, Cloud)
    np.testing.assert_allclose(scan.points, POINTS, atol=1e-7)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl"])
def test_the_vertices_of_a_mesh_are_a_cloud_each_once(tmp_path, suffix):
    path = tmp_path / f"cube{suffix}"
    trimesh.Trimesh(CUBE.vertices, CUBE.faces, process=False).export(path)
    points = load_scan(path).points
    np.testing.assert_array_equal(np.unique(points, axis=0), np.unique(CUBE.vertices, axis=0))
    assert len(points) == 8


def test_further_columns_commas_and_comments_are_read_over(tmp_path):
    path = tmp_path / "cloud.csv"
    path.write_text("# x,y,z,i\n1,2,3,9\n4,5,6,9\n7,8,10,9\n")
    np.testing.assert_array_equal(load_scan(path).points, [[1, 2, 3], [4, 5, 6], [7, 8, 10]])


def test_npz_may_hold_normals_or_a_grid(tmp_path):
    normals = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    np.savez(tmp_path / "cloud.npz", points=POINTS, normals=normals)
    cloud = load_scan(tmp_path / "cloud.npz")
    assert isinstance(cloud, Cloud) and cloud.normals is not None
    np.testing.assert_array_equal(cloud.normals, normals)
    grid = POINTS.reshape(4, 5, 3).copy()
    grid[1, 2] = np.nan
    np.savez(tmp_path / "grid.npz", points=grid, eye=np.array([0, 0, 1, 0]))
    image = load_scan(tmp_path / "grid.npz")
    assert isinstance(image, RangeImage) and image.valid.sum() == 19 and not image.valid[1, 2]
    assert image.eye.tolist() == [0, 0, 1, 0]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"There is no file .*absent\.ply"):
        load_scan(tmp_path / "absent.ply")


def test_a_folder_is_named(tmp_path):
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(InputError, match=r"folder\.ply is a folder"):
        load_scan(tmp_path / "folder.ply")


def test_an_unknown_extension_lists_the_known(tmp_path):
    path = tmp_path / "scan.docx"
    path.write_text("x")
    with pytest.raises(InputError, match=r"scan\.docx: unknown extension '\.docx'; known are .*\.ply.*\.xyz"):
        load_scan(path)


@pytest.mark.parametrize("suffix", [*CLOUD_SUFFIXES, ".obj", ".stl", ".osu"])
def test_a_file_of_no_bytes_is_named_as_empty(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix}"
    path.touch()
    with pytest.raises(InputError, match=r"cloud.* is empty"):
        load_scan(path)


@pytest.mark.parametrize("suffix", [*CLOUD_SUFFIXES, ".obj", ".stl", ".osu"])
def test_bytes_of_another_format_are_refused_with_the_name(tmp_path, suffix):
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes(bytes(range(128, 256)) * 4)
    with pytest.raises(InputError, match=r"cloud\."):
        load_scan(path)


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_point_that_is_not_finite_is_named(tmp_path, suffix, value):
    points = POINTS.copy()
    points[6, 2] = value
    with pytest.raises(InputError, match=r"cloud.*point 6 "):
        load_scan(write_points(tmp_path / f"cloud{suffix}", points))


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_two_points_are_refused(tmp_path, suffix):
    with pytest.raises(InputError, match=r"cloud.* has only 2 points"):
        load_scan(write_points(tmp_path / f"cloud{suffix}", POINTS[:2]))


@pytest.mark.parametrize("suffix", CLOUD_SUFFIXES)
def test_equal_points_are_refused(tmp_path, suffix):
    with pytest.raises(InputError, match=r"cloud.* all 5 points are equal"):
        load_scan(write_points(tmp_path / f"cloud{suffix}", np.ones((5, 3))))


def test_a_header_alone_is_a_cloud_without_points(tmp_path):
    (tmp_path / "cloud.xyz").write_text("# nothing follows\n")
    with pytest.raises(InputError, match=r"cloud\.xyz is empty"):
        load_scan(tmp_path / "cloud.xyz")


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_truncated_ply_is_named(tmp_path, encoding):
    path = tmp_path / "cloud.ply"
    trimesh.PointCloud(POINTS).export(path, encoding=encoding)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 3 // 4])
    with pytest.raises(InputError, match=r"cloud\.ply is truncated.*expected 20 vertex rows.*, found \d+"):
        load_scan(path)


def test_a_ply_mesh_cut_in_its_faces_is_named(tmp_path):
    path = tmp_path / "cube.ply"
    trimesh.Trimesh(CUBE.vertices, CUBE.faces, process=False).export(path, encoding="ascii")
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-2]))
    with pytest.raises(InputError, match=r"expected 8 vertex rows and 12 face rows, found 18 rows in all"):
        load_scan(path)


@pytest.mark.parametrize(("ascii_text", "compressed"), [(True, False), (False, False), (False, True)])
def test_a_truncated_pcd_is_named(tmp_path, ascii_text, compressed):
    import open3d

    path = tmp_path / "cloud.pcd"
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(POINTS))
    open3d.io.write_point_cloud(str(path), cloud, write_ascii=ascii_text, compressed=compressed)
    np.testing.assert_allclose(load_scan(path).points, POINTS, atol=1e-7)
    path.write_bytes(path.read_bytes()[:-90])
    with pytest.raises(InputError, match=r"cloud\.pcd is truncated: expected 20 points, found"):
        load_scan(path)


def test_a_truncated_npz_is_named(tmp_path):
    path = write_points(tmp_path / "cloud.npz")
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match=r"cloud\.npz is not a readable NPZ"):
        load_scan(path)


def test_a_truncated_stl_is_named(tmp_path):
    path = tmp_path / "cube.stl"
    trimesh.Trimesh(CUBE.vertices, CUBE.faces, process=False).export(path)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(InputError, match=r"cube\.stl is damaged or truncated"):
        load_scan(path)


def test_an_obj_cut_within_a_vertex_is_named(tmp_path):
    path = write_points(tmp_path / "cloud.obj")
    path.write_text(path.read_text().rsplit(" ", 1)[0])
    with pytest.raises(InputError, match=r"cloud\.obj is damaged or truncated"):
        load_scan(path)


def test_npz_without_points_and_with_pickles_is_refused(tmp_path):
    np.savez(tmp_path / "cloud.npz", vertices=POINTS)
    with pytest.raises(InputError, match=r"expected an array 'points', found \['vertices'\]"):
        load_scan(tmp_path / "cloud.npz")
    np.savez(tmp_path / "objects.npz", points=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match=r"objects\.npz is not a readable NPZ"):
        load_scan(tmp_path / "objects.npz")


def test_a_text_row_that_is_no_point_is_named(tmp_path):
    (tmp_path / "cloud.xyz").write_text("1 2 3\n4 5\n")
    with pytest.raises(InputError, match=r"cloud\.xyz, line 2: expected 'x y z', found '4 5'"):
        load_scan(tmp_path / "cloud.xyz")
