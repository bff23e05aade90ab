"""Hand-eye pose files: conventions checked on the real sets, defects named by line."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.hand_eye import (
    read_labelled_csv,
    read_pairs_storage,
    read_timed_csv,
    read_visp_pose,
    read_visp_poses,
)

RNG = np.random.default_rng(0)
POSES = se3.compose(Rotation.random(4, rng=RNG).as_matrix(), RNG.normal(size=(4, 3)))


def row(values) -> str:
    return ",".join(repr(float(v)) for v in values)


def test_timed_csv_comes_back(tmp_path):
    path = tmp_path / "stream.csv"
    quaternions = Rotation.from_matrix(POSES[:, :3, :3]).as_quat()
    lines = [row([0.1 * k, *POSES[k, :3, 3], *quaternions[k]]) for k in range(4)]
    for head in ("", "t, x, y, z, qx, qy, qz, qw\n", "# a comment\n\n"):
        path.write_text(head + "\n".join(lines))
        read = read_timed_csv(path)
        np.testing.assert_allclose(read.poses, POSES, atol=1e-12)
        np.testing.assert_allclose(read.times, [0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0", "line 1: expected the columns t, x, y, z, qx"),
        ("0,0,0,0,0,0,0,2", "line 1: expected a unit quaternion, found one of norm 2"),
        ("0,0,0,0,0,0,0,1\n1,0,0,0,0,0,1", "line 2: expected 8 numbers"),
        ("0,0,0,nan,0,0,0,1", "line 1: holds a value that is not a finite"),
        ("", "holds no rows"),
    ],
)
def test_a_bad_timed_csv_is_named(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"bad\.csv.*{message}"):
        read_timed_csv(path)


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_labelled_csv_comes_back(tmp_path, unit):
    path = tmp_path / "pairs.csv"
    angles = Rotation.from_matrix(POSES[:, :3, :3]).as_euler("xyz", degrees=unit == "deg")
    labels = ("hand", "eye", "hand", "eye")
    path.write_text("\n".join(f"{labels[k]},{row([*POSES[k, :3, 3], *angles[k]])}" for k in range(4)))
    read = read_labelled_csv(path, unit)
    np.testing.assert_allclose(read.hand, POSES[[0, 2]], atol=1e-12)
    np.testing.assert_allclose(read.camera, POSES[[1, 3]], atol=1e-12)
    if unit == "deg":
        with pytest.raises(InputError, match="are these degrees"):
            read_labelled_csv(path, "rad")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hand,0,0,0,0,0,0\nhand,0,0,0,0,0,0", "line 2: expected a line 'eye"),
        ("hand,0,0,0,0,0,0\neye,0,0,0,0,0,0\nhand,0,0,0,0,0,0", "'hand' line, 3, has no 'eye'"),
        ("hand,0,0,0,0,0\neye,0,0,0,0,0,0", "line 1: expected 6 numbers"),
    ],
)
def test_a_bad_labelled_csv_is_named(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"bad\.csv.*{message}"):
        read_labelled_csv(path, "deg")


def test_visp_poses(tmp_path):
    vector = Rotation.from_matrix(POSES[0, :3, :3]).as_rotvec()
    values = "".join(f"\n  - [{v!r}]" for v in map(float, [*POSES[0, :3, 3], *vector]))
    (tmp_path / "franka_pose_rPe_2.yaml").write_text(f"rows: 6\ncols: 1\ndata: {values}\n")
    (tmp_path / "franka_pose_rPe_10.yaml").write_text("rows: 6\ncols: 1\ndata: [0, 0, 0, 0, 0, 0]\n")
    np.testing.assert_allclose(read_visp_pose(tmp_path / "franka_pose_rPe_2.yaml"), POSES[0], atol=1e-12)
    assert list(read_visp_poses(tmp_path)) == [2, 10]
    (tmp_path / "franka_pose_rPe_11.yaml").write_text("rows: 6\ncols: 1\ndata: [0, 0, 0]\n")
    with pytest.raises(InputError, match=r"rPe_11\.yaml: expected 6 finite numbers"):
        read_visp_poses(tmp_path)
    with pytest.raises(InputError, match="holds no file named"):
        read_visp_poses(tmp_path / "nowhere")


def storage(matrices: dict[str, np.ndarray], head: str) -> str:
    text = "%YAML:1.0\n---\n" + head
    for name, M in matrices.items():
        values = ", ".join(repr(float(v)) for v in M.reshape(-1))
        text += f"{name}: !!opencv-matrix\n   rows: {M.shape[0]}\n   cols: {M.shape[1]}\n"
        text += f"   dt: d\n   data: [ {values} ]\n"
    return text


def test_pairs_in_opencv_storage(tmp_path):
    path = tmp_path / "pairs.yml"
    names = ("T1_0", "T2_0", "T1_1", "T2_1")
    path.write_text(storage(dict(zip(names, POSES, strict=True)), "frameCount: 2\n"))
    read = read_pairs_storage(path)
    np.testing.assert_array_equal(read.hand, POSES[[0, 2]])
    np.testing.assert_array_equal(read.camera, POSES[[1, 3]])
    path.write_text(storage({"T1_0": POSES[0]}, "frameCount: 1\n"))
    with pytest.raises(InputError, match="4 x 4 matrix 'T2_0'"):
        read_pairs_storage(path)
    path.write_text(storage({"T1_0": 2 * POSES[0], "T2_0": POSES[0]}, "frameCount: 1\n"))
    with pytest.raises(InputError, match="'T1_0' is not a rigid motion"):
        read_pairs_storage(path)
    path.write_text(storage({}, "frames: 1\n"))
    with pytest.raises(InputError, match="integer 'frameCount'"):
        read_pairs_storage(path)


@pytest.mark.data
def test_the_real_sets_have_their_counts(data_dir):
    root = data_dir / "handeye"
    assert len(read_pairs_storage(root / "lixiny_aruco" / "TransformPairsInput.yml").hand) == 43
    assert len(read_labelled_csv(root / "fishros_aubo_i5" / "base_aubo_i5_data.csv", "deg").camera) == 32
    assert list(read_visp_poses(root / "visp_franka_eye_in_hand")) == list(range(1, 9))
    hand = read_timed_csv(root / "ethz_robot_arm_sim" / "robot_arm_sim_hand.csv")
    assert len(hand.times) == 3488 and len(np.unique(hand.times)) == 2124
    assert len(read_timed_csv(root / "ethz_robot_arm_sim" / "robot_arm_sim_camera.csv").times) == 1067
