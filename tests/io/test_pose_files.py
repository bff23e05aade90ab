"""Pose files of every form come back as the same poses; each defect is named by its file, row and column."""

import json

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.pose_files import read_both, read_single
from jaxmodel.io.pose_values import Forms, PoseForm

RNG = np.random.default_rng(0)
HAND, CAMERA = (se3.compose(Rotation.random(4, rng=RNG).as_matrix(), RNG.normal(size=(4, 3))) for _ in range(2))
PLAIN = Forms()
DEGREES = Forms(PoseForm("deg", rotation="xyz"), PoseForm("deg", rotation="xyz"))


def quaternions(T: np.ndarray, order: str = "xyzw") -> np.ndarray:
    return Rotation.from_matrix(T[:, :3, :3]).as_quat()[:, ["xyzw".index(letter) for letter in order]]


def table(*columns: np.ndarray, separator: str = ",", head: str = "") -> str:
    rows = np.concatenate([c.reshape(len(c), -1) for c in columns], axis=1)
    return head + "\n".join(separator.join(repr(float(v)) for v in row) for row in rows) + "\n"


def check(path, forms: Forms = PLAIN) -> None:
    hand, camera = read_both(path, forms)
    np.testing.assert_allclose(hand.poses, HAND, atol=1e-12)
    np.testing.assert_allclose(camera.poses, CAMERA, atol=1e-12)


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize("timed", [False, True])
def test_both_streams_in_one_table_without_names(tmp_path, separator, timed):
    path = tmp_path / "poses.txt"
    time = [np.arange(4.0)] if timed else []
    for columns in (
        [HAND[:, :3, 3], quaternions(HAND), CAMERA[:, :3, 3], quaternions(CAMERA)],
        [HAND[:, :3], CAMERA[:, :3]],
        [HAND, CAMERA],
    ):
        path.write_text(table(*time, *columns, separator=separator, head="# hand, then camera\n\n"))
        check(path)
        assert read_both(path, PLAIN)[0].places[0] == "line 3"
        assert (read_both(path, PLAIN)[1].times is not None) == timed


def test_scalar_first_quaternions(tmp_path):
    path = tmp_path / "poses.csv"
    columns = HAND[:, :3, 3], quaternions(HAND, "wxyz"), CAMERA[:, :3, 3], quaternions(CAMERA, "wxyz")
    path.write_text(table(*columns))
    check(path, Forms(PoseForm(quaternion="wxyz"), PoseForm(quaternion="wxyz")))


def test_names_say_everything(tmp_path):
    """Any order of columns, unlike forms and units of the two streams, a time and a picture beside them."""
    names = "image,robot_qw,robot_qx,robot_qy,robot_qz,hand_x_mm,hand_y_mm,hand_z_mm,t,"
    names += "camera_ux_deg,camera_uy_deg,camera_uz_deg,Camera_TX,camera_ty,camera_tz"
    vector = np.degrees(Rotation.from_matrix(CAMERA[:, :3, :3]).as_rotvec())
    columns = [quaternions(HAND, "wxyz"), 1e3 * HAND[:, :3, 3], np.arange(4.0), vector, CAMERA[:, :3, 3]]
    lines = table(*columns).splitlines()
    path = tmp_path / "poses.csv"
    path.write_text("\n".join([names, *(f"shot{k}.png,{line}" for k, line in enumerate(lines))]))
    check(path)
    hand, camera = read_both(path, PLAIN)
    assert hand.images == ("shot0.png", "shot1.png", "shot2.png", "shot3.png")
    np.testing.assert_array_equal(camera.times, np.arange(4.0))


@pytest.mark.parametrize("kind", ["xyz", "zyx", "XYZ", "ZYX", "YXZ"])
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_angles_about_axes_in_every_order(tmp_path, kind, unit):
    path = tmp_path / "hand.csv"
    angles = Rotation.from_matrix(HAND[:, :3, :3]).as_euler(kind, degrees=unit == "deg")
    by_axis = angles[:, [kind.lower().index(letter) for letter in "xyz"]]
    path.write_text(table(HAND[:, :3, 3], by_axis))
    form = PoseForm(unit, rotation=kind)
    np.testing.assert_allclose(read_single(path, "hand", Forms(form)).poses, HAND, atol=1e-12)
    if unit == "deg":
        with pytest.raises(InputError, match=r"hand\.csv, line \d: .*more than a full turn.*degrees\? Say --angle deg"):
            read_single(path, "hand", Forms(PoseForm("rad", rotation=kind)))


def test_roll_pitch_yaw_is_about_fixed_axes(tmp_path):
    path = tmp_path / "hand.csv"
    angles = Rotation.from_matrix(HAND[:, :3, :3]).as_euler("xyz", degrees=True)
    path.write_text(table(HAND[:, :3, 3], angles, head="x,y,z,roll_deg,pitch_deg,yaw_deg\n"))
    np.testing.assert_allclose(read_single(path, "hand", PLAIN).poses, HAND, atol=1e-12)


def test_lines_that_name_their_stream(tmp_path):
    path = tmp_path / "poses.csv"
    rows = []
    for hand, camera in zip(HAND, CAMERA, strict=True):
        for name, T in (("hand", hand), ("eye", camera)):
            angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
            rows.append(f"{name}," + ",".join(repr(float(v)) for v in (*T[:3, 3], *angles)))
    path.write_text("\n".join(rows))
    check(path, DEGREES)
    assert read_both(path, DEGREES)[1].places[1] == "lines 3 and 4"


def test_blocks_of_four_lines_are_matrices(tmp_path):
    path = tmp_path / "hand.txt"
    path.write_text("\n".join(table(T, separator=" ") for T in HAND))
    np.testing.assert_allclose(read_single(path, "hand", PLAIN).poses, HAND, atol=1e-12)


def position_and_quaternion(T: np.ndarray) -> dict:
    q = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return {"position": T[:3, 3].tolist(), "quaternion": q}


def of_ros(T: np.ndarray) -> dict:
    q = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return {
        "translation": dict(zip("xyz", T[:3, 3].tolist(), strict=True)),
        "rotation": dict(zip("xyzw", q, strict=True)),
    }


def of_opencv(T: np.ndarray) -> dict:
    return {"rvec": Rotation.from_matrix(T[:3, :3]).as_rotvec().tolist(), "tvec": T[:3, 3].tolist()}


POSES = {
    "matrix": lambda T: T.tolist(),
    "three rows": lambda T: T[:3].tolist(),
    "flat": lambda T: T.reshape(-1).tolist(),
    "seven": lambda T: [*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_quat().tolist()],
    "position and quaternion": position_and_quaternion,
    "ros": of_ros,
    "opencv": of_opencv,
    "R and t": lambda T: {"R": T[:3, :3].tolist(), "t": T[:3, 3].tolist()},
    "named matrix": lambda T: {"matrix": T.tolist()},
}


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
@pytest.mark.parametrize("pose", POSES.values(), ids=POSES)
def test_trees(tmp_path, pose, suffix):
    path = tmp_path / f"poses{suffix}"
    hand, camera = [pose(T) for T in HAND], [pose(T) for T in CAMERA]
    pairs = [{"hand": h, "camera": c} for h, c in zip(hand, camera, strict=True)]
    moveit = [{"effector_wrt_world": h, "object_wrt_sensor": c} for h, c in zip(hand, camera, strict=True)]
    write = json.dumps if suffix == ".json" else yaml.safe_dump
    for tree in ({"hand": hand, "camera": camera}, pairs, {"samples": pairs}, moveit):
        path.write_text(write(tree))
        check(path)
    for tree in (hand, {"poses": hand}, {f"shot{k}.png": one for k, one in enumerate(hand)}):
        path.write_text(write(tree))
        np.testing.assert_allclose(read_single(path, "hand", PLAIN).poses, HAND, atol=1e-12)
    assert read_single(path, "hand", PLAIN).images == ("shot0.png", "shot1.png", "shot2.png", "shot3.png")


def test_times_beside_the_poses_of_a_tree(tmp_path):
    path = tmp_path / "poses.json"
    pairs = [
        {"t": 0.5 * k, "hand": h.tolist(), "camera": c.tolist()}
        for k, (h, c) in enumerate(zip(HAND, CAMERA, strict=True))
    ]
    path.write_text(json.dumps(pairs))
    check(path)
    np.testing.assert_array_equal(read_both(path, PLAIN)[0].times, 0.5 * np.arange(4))


def test_a_folder_of_visp(tmp_path):
    for stream, poses in (("rPe", HAND), ("cPo", CAMERA)):
        for number, T in zip((1, 2, 10, 11), poses, strict=True):
            vector = [*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_rotvec().tolist()]
            (tmp_path / f"a_pose_{stream}_{number}.yaml").write_text(f"rows: 6\ncols: 1\ndata: {vector}\n")
    check(tmp_path)


def spoiled(row: int, change) -> str:
    T = HAND.copy()
    T[row] = change(T[row])
    return table(T)


def reflected(T: np.ndarray) -> np.ndarray:
    return T @ np.diag([1.0, 1.0, -1.0, 1.0])


GOOD_ROW = "0,0,0,0,0,0,1"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("scaled.csv", spoiled(2, lambda T: np.diag([1.1, 1.1, 1.1, 1]) @ T),
         r"line 3: .*no rigid motion; R'R is off the identity by 0\.21, determinant 1\.33"),
        ("reflected.csv", spoiled(1, reflected), "line 2: .*no rigid motion; it is a reflection"),
        ("columns.csv", spoiled(0, np.transpose), "line 1: .*no rigid motion; its last row is"),
        ("norm.csv", f"{GOOD_ROW}\n0,0,0,0,0,0,2\n", "line 2: the hand's quaternion has the norm 2"),
        ("nan.csv", f"{GOOD_ROW}\n0,nan,0,0,0,0,1\n", "line 2: y is nan, expected a finite number"),
        ("inf.csv", "0,0,0,0,0,0,1\ninf,0,0,0,0,0,1\n", "line 2: x is inf"),
        ("word.csv", f"{GOOD_ROW}\n0,0,zero,0,0,0,1\n", "line 2: z must be a number, found 'zero'"),
        ("cut.csv", f"{GOOD_ROW}\n0,0,0,0,0\n", "line 2: expected 7 values, found 5"),
        ("width.csv", "1,2,3,4,5\n", "line 1: 5 numbers in a row have no agreed meaning"),
        ("unknown.csv", f"x,y,z,qx,qy,qz,w\n{GOOD_ROW}\n", "line 1: unknown column the text 'w'"),
        ("nearest.csv", f"x,y,zz,qx,qy,qz,qw\n{GOOD_ROW}\n", "'zz', did you mean 'z'"),
        ("unit.csv", f"x_inch,y_inch,z_inch,qx,qy,qz,qw\n{GOOD_ROW}\n", "unknown unit the text 'inch' of.*m or mm"),
        ("units.csv", f"x_mm,y,z,qx,qy,qz,qw\n{GOOD_ROW}\n", "x, y, z must have one unit"),
        ("lacking.csv", "x,y,z,qx,qy,qz\n0,0,0,0,0,0\n", "lack qw"),
        ("nowhere.csv", "qx,qy,qz,qw\n0,0,0,1\n", "lack x, y, z"),
        ("twice.csv", f"x,x,z,qx,qy,qz,qw\n{GOOD_ROW}\n", "name x twice"),
        ("no_turn.csv", "x,y,z\n0,0,0\n", "must hold one rotation .* found none"),
        ("two_turns.csv", "x,y,z,qx,qy,qz,qw,ux,uy,uz\n0,0,0,0,0,0,1,0,0,0\n", "found qx qy qz qw and ux uy uz"),
        ("kind.csv", "x,y,z,rx,ry,rz\n0,0,0,1,2,3\n", "may be a rotation vector or angles about axes; say --rotation"),
        ("angle.csv", "x,y,z,roll,pitch,yaw\n0,0,0,30,45,170\n",
         r"degrees or radians \(the largest is 170\)\? Say --angle deg or --angle rad"),
        ("vector.csv", "x,y,z,ux,uy,uz\n0,0,0,0,0,90\n", "line 2: .*90 is more than a full turn in radians"),
        ("length.csv", "450,-20,310,0,0,0,1\n", r"positions reach 450; are these millimetres\? Say --length mm"),
        ("empty.csv", "", "holds no poses, the file is empty"),
        ("names.csv", "x,y,z,qx,qy,qz,qw\n", "holds no poses, only a row of names"),
        ("matrix.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n", "line 3: a 4 x 4 matrix has four lines, the last has 3"),
        ("empty.json", "", "holds no poses, the file is empty"),
        ("cut.json", '[[[1, 0, 0', "line 1: not valid JSON"),
        ("cut.yaml", "hand: [[1, 2", "line 1: not valid YAML"),
        ("list.json", "[]", "expected a list of poses, found a list"),
        ("text.json", '"poses"', "expected a list of poses, found the text 'poses'"),
        ("pose.json", '["here"]', "entry 0: expected a pose .* found the text 'here'"),
        ("size.json", "[[[1, 0], [0, 1]]]", "entry 0: expected a 4 x 4 or 3 x 4 matrix, found one of 2 x 2"),
        ("key.json", '[{"positon": [0, 0, 0]}]', "entry 0: unknown key the text 'positon'"),
        ("count.json", '[{"position": [0, 0], "quaternion": [0, 0, 0, 1]}]', "position: expected 3 numbers, found 2"),
        ("letters.json", '[{"position": {"x": 0, "y": 0}, "quaternion": [0, 0, 0, 1]}]', "expected the keys x, y, z"),
        ("unlike.json", '[[0,0,0,0,0,0,1], {"rvec": [0,0,0], "tvec": [0,0,0]}]', "entry 1: has .* where the first"),
        ("truth.json", "[[0,0,true,0,0,0,1]]", "entry 0: z must be a number, found True"),
        ("half.json", '{"hand": [[0,0,0,0,0,0,1]]}', "holds the hand's poses, but none of the other"),
        ("beside.json", '{"hand": [], "camera": [], "unit": "mm"}', "unknown key the text 'unit' beside"),
        ("pair.json", '[{"hand": [0,0,0,0,0,0,1], "camera": [0,0,0,0,0,0,1]}, {"hand": [0,0,0,0,0,0,1]}]',
         "entry 1: expected a mapping with the hand's and the camera's pose"),
        ("poses.xlsx", "PK", "unknown extension '.xlsx', expected one of .csv"),
        ("binary.csv", "\udcff\udcfe", "cannot be read as text"),
        ("order.csv", "hand,0,0,0,0,0,0\nhand,0,0,0,0,0,0\n", "line 2: expected a line of the camera's pose"),
        ("last.csv", "hand,0,0,0,0,0,0\neye,0,0,0,0,0,0\nhand,0,0,0,0,0,0\n", "line 3: the last line of the hand"),
    ],
)  # fmt: skip
def test_each_defect_is_named(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content.encode("utf-8", "surrogateescape"))
    with pytest.raises(InputError, match=rf"{name}.*{words}"):
        read_single(path, "hand", PLAIN)


def test_missing_files_and_folders(tmp_path):
    for name in ("none.csv", "none.json", "none.yaml", "none"):
        with pytest.raises(InputError, match=f"There is no file .*{name}"):
            read_both(tmp_path / name, PLAIN)
    with pytest.raises(InputError, match="holds no file named"):
        read_both(tmp_path, PLAIN)


def test_the_camera_is_asked_about_by_its_own_options(tmp_path):
    path = tmp_path / "camera.csv"
    path.write_text("0,0,300,0,0,0,1\n")
    with pytest.raises(InputError, match=r"the camera's positions reach 300.*--camera-length mm"):
        read_single(path, "camera", PLAIN)
    read = read_single(path, "camera", Forms(camera=PoseForm(length="mm")))
    np.testing.assert_allclose(read.poses[0, :3, 3], [0, 0, 0.3])


def test_one_stream_where_both_are_due_and_the_other_way_round(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(f"{GOOD_ROW}\n")
    with pytest.raises(InputError, match=r"poses\.csv: holds one stream of poses"):
        read_both(path, PLAIN)
    path.write_text("camera_x,camera_y,camera_z,camera_qx,camera_qy,camera_qz,camera_qw\n" + GOOD_ROW)
    with pytest.raises(InputError, match="holds the poses of the camera, expected those of the hand"):
        read_single(path, "hand", PLAIN)
