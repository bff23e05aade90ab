"""Pose files: conventions, checks, round trips."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.io.poses import check_conf, load_transform, load_truth, read_conf, relative_pose, save_transform


def rigid(seed: int) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    T[:3, 3] = np.random.default_rng(seed).normal(size=3)
    return T


def conf_line(name: str, T: np.ndarray) -> str:
    """The file stores the inverse of the turning quaternion, scalar last."""
    numbers = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).inv().as_quat()]
    return f"bmesh {name} " + " ".join(repr(float(v)) for v in numbers)


def test_a_conf_gives_the_poses_it_was_made_from(tmp_path):
    path = tmp_path / "two.conf"
    path.write_text(f"camera 0 0 0 1 0 0 0\n\n{conf_line('a.ply', rigid(1))}\n{conf_line('b.ply', rigid(2))}\n")
    poses = read_conf(path)
    assert list(poses) == ["a", "b"]
    np.testing.assert_allclose(poses["a"], rigid(1), atol=1e-12)
    np.testing.assert_allclose(poses["b"], rigid(2), atol=1e-12)
    expected = np.linalg.inv(rigid(1)) @ rigid(2)
    np.testing.assert_allclose(load_truth(path, tmp_path / "a.ply", "elsewhere/b.ply"), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("bmesh a.ply 0 0 0 0 0 1", "line 2: expected 'bmesh FILE"),
        ("bmesh a.ply 0 0 0 0 0 0 one", "line 2: expected 'bmesh FILE"),
        ("bmesh a.ply 0 0 0 0 0 0 2", "line 2: expected a unit quaternion, found one of norm 2"),
        ("bmesh a.ply nan 0 0 0 0 0 1", "line 2"),
        ("", "holds no 'bmesh"),
    ],
)
def test_a_bad_conf_line_is_named(tmp_path, line, message):
    path = tmp_path / "bad.conf"
    path.write_text(f"camera 0 0 0\n{line}\n")
    with pytest.raises(InputError, match=rf"bad\.conf.*{message}"):
        read_conf(path)


def test_a_conf_naming_an_absent_scan_is_refused_with_both_names(tmp_path):
    path = tmp_path / "two.conf"
    path.write_text(f"{conf_line('a.ply', rigid(1))}\n{conf_line('gone.ply', rigid(2))}\n")
    (tmp_path / "a.ply").touch()
    with pytest.raises(InputError, match=r"two\.conf names the scan 'gone\.ply'"):
        check_conf(path)
    (tmp_path / "gone.ply").touch()
    assert check_conf(path) == {"a": tmp_path / "a.ply", "gone": tmp_path / "gone.ply"}


def test_a_truth_without_the_scan_is_refused_with_both_names(tmp_path):
    path = tmp_path / "two.conf"
    path.write_text(conf_line("a.ply", rigid(1)) + "\n")
    with pytest.raises(InputError, match=r"two\.conf has no pose for the scan 'c\.ply'; it has a"):
        load_truth(path, "a.ply", "c.ply")


def test_transforms_come_back_from_every_format(tmp_path):
    T = rigid(3)
    np.savetxt(tmp_path / "T.txt", T)
    np.save(tmp_path / "T.npy", T)
    (tmp_path / "list.json").write_text(json.dumps(T.tolist()))
    save_transform(tmp_path / "T.json", T, outcome="converged", error=0.5)
    for name in ("T.txt", "T.npy", "list.json", "T.json"):
        np.testing.assert_allclose(load_transform(tmp_path / name), T, rtol=1e-15, atol=0, err_msg=name)
        np.testing.assert_allclose(load_truth(tmp_path / name, "a.ply", "b.ply"), T, rtol=1e-15, atol=0)
    saved = json.loads((tmp_path / "T.json").read_text())
    assert saved["outcome"] == "converged" and saved["error"] == 0.5


def test_truth_from_poses_of_named_scans(tmp_path):
    path = tmp_path / "poses.json"
    path.write_text(json.dumps({"a.ply": rigid(1).tolist(), "b": rigid(2).tolist()}))
    expected = np.linalg.inv(rigid(1)) @ rigid(2)
    np.testing.assert_allclose(load_truth(path, "x/a.ply", "x/b.pcd"), expected, atol=1e-12)


def test_relative_poses_compose():
    a, b, c = rigid(1), rigid(2), rigid(3)
    np.testing.assert_allclose(relative_pose(a, b) @ relative_pose(b, c), relative_pose(a, c), atol=1e-12)
    np.testing.assert_allclose(relative_pose(a, a), np.eye(4), atol=1e-12)


MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (MIRROR, "expected a rigid motion.*det R = -1"),
        (2 * np.eye(4), "expected a rigid motion"),
        (np.eye(4).T + np.eye(4)[::-1] * 0.5, "expected a rigid motion"),
        (np.eye(3), r"found shape \(3, 3\)"),
        (np.full((4, 4), np.nan), "finite"),
        (np.zeros((1, 4)), r"found shape \(1, 4\)"),
    ],
)
@pytest.mark.parametrize("suffix", [".npy", ".json"])
def test_what_is_not_a_rigid_motion_is_refused(tmp_path, matrix, message, suffix):
    path = tmp_path / f"T{suffix}"
    if suffix == ".npy":
        np.save(path, matrix)
    else:
        path.write_text(json.dumps(matrix.tolist()))
    with pytest.raises(InputError, match=rf"T\{suffix}.*{message}"):
        load_transform(path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("T.json", "{", "is not JSON"),
        ("T.json", '{"pose": 1}', "expected the key 'T_target_source', found"),
        ("T.json", '{"T_target_source": "I"}', "4 x 4 matrix of numbers"),
        ("T.txt", "1 0 0\n0 1 x\n", "four rows of four numbers"),
        ("T.txt", "1 0 0 0\n0 1 0\n", "4 x 4 matrix"),
        ("T.npy", "not numpy", r"is not a \.npy file"),
    ],
)
def test_bad_transform_files_are_named(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=rf"{name}.*{message}"):
        load_transform(tmp_path / name)


@pytest.mark.parametrize("name", ["T.json", "T.npy", "T.txt", "T.conf"])
def test_a_missing_pose_file_is_named(tmp_path, name):
    with pytest.raises(InputError, match=f"There is no file .*{name}"):
        load_truth(tmp_path / name, "a.ply", "b.ply")
