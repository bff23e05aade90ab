"""``jaxmodel calibrate`` from its words to its folder: answers by name, verdicts, exit codes, figures, report."""

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import hand_eye_files as files
import numpy as np
import polars
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from jaxmodel.calibrate.motions import Setup
from jaxmodel.calibrate.pose_residuals import pose_residuals
from jaxmodel.calibrate.resampling import differences
from jaxmodel.calibrate.solve import METHODS
from jaxmodel.geometry import se3
from jaxmodel.io.strict_yaml import config_files
from jaxmodel.run.arguments import Calibrate, parse
from jaxmodel.run.calibration.config import MethodName
from jaxmodel.run.cli import execute

EXAMPLE = config_files() / "hand_eye" / "example.csv"
ONCE = pytest.mark.xdist_group("calibrate_example")
"""Tests of one calibration by every method: one worker makes it."""
Run = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def calibrate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run ``jaxmodel calibrate WORDS --out out --json``; its exit code and its last line."""

    def run(*words: object) -> tuple[int, dict[str, Any]]:
        code = execute(["calibrate", *map(str, words), "--out", str(tmp_path / "out"), "--json"])
        return code, json.loads(capsys.readouterr().out.splitlines()[-1])

    return run


def errors(found: dict[str, Any], name: str, truth: np.ndarray) -> tuple[float, float]:
    """Angle (rad) and distance of a named transform from the truth."""
    difference = differences(np.array([found[name]]), truth)[0]
    return float(np.linalg.norm(difference[:3])), float(np.linalg.norm(difference[3:]))


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The README's example, by every method."""
    out = tmp_path_factory.mktemp("example") / "out"
    assert execute(["calibrate", str(EXAMPLE), "--working-distance", "0.4", "--out", str(out)]) == 0
    return out


def content(folder: Path, name: str) -> dict[str, Any]:
    return json.loads((folder / name).read_text())


def example_truth() -> np.ndarray:
    """T_hand_camera as the comment in the example says it."""
    numbers = re.findall(r"-?\d+\.\d+", EXAMPLE.read_text().split("True T_hand_camera")[1].split("hand_x")[0])
    values = np.array(numbers, dtype=float)
    return se3.compose(Rotation.from_quat(values[3:7]).as_matrix(), values[:3])


@pytest.mark.slow
@ONCE
def test_the_example_is_right_within_its_own_covariance(example):
    found = content(example, "calibration.json")
    error = differences(np.array([found["T_hand_camera"]]), example_truth())[0]
    covariance = np.array(found["covariance"]["matrix"])
    assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.999, 6)
    assert found["usable"] and found["outcome"] == "solved" and found["method"] == "joint"
    np.testing.assert_allclose(
        np.degrees(np.sqrt(np.diag(covariance)[:3])), found["deviation"]["rotation_deg"], rtol=1e-12
    )
    for one, other in (("T_hand_camera", "T_camera_hand"), ("T_base_target", "T_target_base")):
        np.testing.assert_allclose(np.array(found[one]) @ np.array(found[other]), np.eye(4), atol=1e-12)


@pytest.mark.slow
@ONCE
def test_the_wrong_line_of_the_example_is_named(example):
    lines = EXAMPLE.read_text().splitlines()
    camera = [line.split(",")[7:] for line in lines[5:]]
    board = np.array([[float(v) for v in row[:3]] for row in camera])
    repeated = int(np.argmin(np.linalg.norm(np.diff(board, axis=0), axis=1))) + 1
    assert content(example, "calibration.json")["outliers"] == [f"line {6 + repeated}"]


@pytest.mark.slow
@ONCE
def test_every_method_is_beside_the_others(example):
    summary = content(example, "summary.json")
    names = [one["method"] for one in summary["methods"]]
    assert names == ["joint", "joint, all poses", *METHODS]
    X = np.array([one["T_hand_camera"] for one in summary["methods"]])
    for i, one in enumerate(X):
        difference = differences(X, one)
        np.testing.assert_allclose(
            np.array(summary["disagreement"]["distance_m"])[i], np.linalg.norm(difference[:, 3:], axis=1), atol=1e-12
        )
    away = [one["from_recommended"]["angle_deg"] for one in summary["methods"]]
    np.testing.assert_allclose(away, np.array(summary["disagreement"]["angle_deg"])[0], atol=1e-12)


@pytest.mark.slow
@ONCE
def test_residuals_of_each_pose_and_each_pair_are_those_of_the_answers(example):
    summary, rows = content(example, "summary.json"), polars.read_parquet(example / "results.parquet")
    motions = polars.read_parquet(example / "motions.parquet")
    assert len(rows) == 16 * len(summary["methods"]) and len(motions) == 120 * len(summary["methods"])
    values = np.loadtxt(EXAMPLE, delimiter=",", skiprows=5)
    hand, camera = (
        se3.compose(Rotation.from_quat(part[:, 3:]).as_matrix(), part[:, :3]) for part in (values[:, :7], values[:, 7:])
    )
    found = summary["recommended"]
    X, Z = np.array(found["T_hand_camera"]), np.array(found["T_base_target"])
    angle, distance = pose_residuals(hand, camera, Setup.EYE_IN_HAND, X, Z)
    mine = rows.filter(polars.col("method") == found["method"])
    np.testing.assert_allclose(mine["rotation_residual_deg"].to_numpy(), np.degrees(angle), atol=1e-9)
    np.testing.assert_allclose(mine["translation_residual_m"].to_numpy(), distance, atol=1e-9)
    pairs = motions.filter(polars.col("method") == found["method"])
    for row in pairs.rows(named=True)[::17]:
        A = np.linalg.inv(hand[row["first"]]) @ hand[row["second"]]
        B = camera[row["first"]] @ np.linalg.inv(camera[row["second"]])
        left = A @ X - X @ B
        assert abs(np.linalg.norm(left[:3, 3]) - row["translation_residual_m"]) < 1e-9
        turn = np.degrees(Rotation.from_matrix(A[:3, :3]).magnitude())
        assert abs(turn - row["angle_deg"]) < 1e-6
    kept = mine.filter(~polars.col("outlier"))
    assert kept["left_out_distance_m"].null_count() == 0 and kept["influence"].null_count() == 0
    assert summary["influence"][0]["distance_m"] == kept["left_out_distance_m"].max()


@pytest.mark.slow
@ONCE
def test_the_folder_is_that_of_every_command(example):
    present = {path.relative_to(example).as_posix() for path in example.rglob("*") if path.is_file()}
    figures = {f"figures/{name}.png" for name in ("residuals", "influence", "motions", "disagreement", "axes")}
    assert present == figures | {
        ".lock", "manifest.json", "results.parquet", "motions.parquet", "summary.json", "calibration.json",
        "report.html",
    }  # fmt: skip
    manifest = content(example, "manifest.json")
    assert manifest["inputs"] == {str(EXAMPLE.absolute()): hashlib.sha256(EXAMPLE.read_bytes()).hexdigest()}
    assert manifest["config"]["working_distance"] == 0.4 and manifest["versions"]["jaxmodel"]
    assert content(example, "summary.json")["figures"] == [
        f"figures/{name}.png" for name in ("residuals", "influence", "motions", "disagreement", "axes")
    ]


@pytest.mark.slow
@ONCE
def test_the_report_is_whole_and_offline_and_is_drawn_again_alike(example, capsys):
    page = (example / "report.html").read_text()
    outside = re.sub(r"<script.*?</script>", "", page, flags=re.S)
    assert not re.search(r"https?:|@import|url\(", outside)
    assert set(re.findall(r'src\s*=\s*"([^,]*),', outside)) == {"data:image/png;base64"}
    for words in ("Methods side by side", "Recommended answer", "contradict the others", "quaternion_penalty"):
        assert words in outside
    plots = json.loads(re.search(r'id="plots" type="application/json">(.*?)</script>', page, re.S)[1])  # pyright: ignore
    assert all(f'id="{name}"' in page for name in plots) and any(name.startswith("sphere") for name in plots)
    before = {path: path.read_bytes() for path in example.rglob("*.png")}
    (example / "report.html").unlink()
    assert execute(["report", str(example)]) == 0
    assert {path: path.read_bytes() for path in example.rglob("*.png")} == before
    assert (example / "report.html").read_text() == page


@pytest.mark.slow
@ONCE
def test_expected_error_is_at_the_distance_asked_for(example):
    expected = content(example, "calibration.json")["expected_error"]
    assert expected["working_distance_m"] == 0.4 and expected["given"]
    covariance = np.array(content(example, "calibration.json")["covariance"]["matrix"])
    low = np.sqrt(np.trace(covariance[3:, 3:]))
    assert expected["rms_m"] < 1.5 * (low + 0.4 * np.sqrt(np.trace(covariance[:3, :3])))
    assert expected["rms_m"] > 0


@pytest.mark.slow
@ONCE
def test_outliers_can_be_kept_and_are_named_all_the_same(example, tmp_path):
    words = ["--method", "joint", "--keep-outliers", "--bootstrap", "20", "--out", str(tmp_path / "out")]
    assert execute(["calibrate", str(EXAMPLE), *words]) == 0
    kept, left_out = content(tmp_path / "out", "calibration.json"), content(example, "calibration.json")
    assert kept["outliers"] == left_out["outliers"] and len(kept["outliers"]) == 1
    beside = {one["method"]: one for one in content(example, "summary.json")["methods"]}
    np.testing.assert_allclose(kept["T_hand_camera"], beside["joint, all poses"]["T_hand_camera"], atol=1e-9)
    assert any("1 of 16 poses contradict" in note for note in content(tmp_path / "out", "summary.json")["notes"])
    spread = np.array(kept["bootstrap_covariance"])
    assert np.linalg.eigvalsh(spread)[0] > 0 and left_out["bootstrap_covariance"] is None


@pytest.mark.parametrize("setup", Setup)
def test_each_setup_names_its_frames(tmp_path, calibrate, setup):
    hand, camera = files.streams(setup)
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=camera)
    code, found = calibrate(path, "--setup", setup.value, "--method", "linear")
    assert code == 0 and found["status"] == "ok" and found["setup"] == setup.value
    assert max(*errors(found, setup.x_name, files.X), *errors(found, setup.z_name, files.Z)) < 1e-9
    assert {name for name in found if name.startswith("T_")} == {
        setup.x_name, setup.z_name, *(f"T_{of}_{to}" for to, of in
                                      (n.removeprefix("T_").split("_") for n in (setup.x_name, setup.z_name)))
    }  # fmt: skip
    assert found["reason"] == "linear is the only method that was asked for"


def test_one_unknown_scale(tmp_path, calibrate):
    hand, camera = files.streams()
    camera[:, :3, 3] /= 4.0
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=camera)
    code, found = calibrate(path, "--unknown-scale", "--method", "linear")
    assert code == 0 and abs(found["scale"] / 4 - 1) < 1e-8
    assert max(errors(found, "T_hand_camera", files.X)) < 1e-8


@pytest.mark.parametrize("scales", ["per-group", "per-motion"])
def test_a_scale_for_each_group_or_motion(tmp_path, calibrate, scales):
    """Each group is a reconstruction of its own: its own unit, its own place; its motions keep their pairing."""
    hand, camera = files.streams()
    true = np.array([0.5] * 6 + [3.0] * 6)
    camera[:, :3, 3] /= true[:, None]
    if scales == "per-motion":  # the steps of a chain, each in a unit of its own
        steps = camera[1:] @ se3.inverse(camera[:-1])
        true = np.linspace(0.5, 3.0, 11)
        steps[:, :3, 3] /= true[:, None]
        camera = [files.camera_of(hand, Setup.EYE_IN_HAND)[0]]
        steps = files.camera_of(hand, Setup.EYE_IN_HAND)
        steps = steps[1:] @ se3.inverse(steps[:-1])
        steps[:, :3, 3] /= true[:, None]
        for step in steps:
            camera.append(step @ camera[-1])
        camera = np.stack(camera)
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=camera, groups=["a"] * 6 + ["b"] * 6)
    code, found = calibrate(path, "--unknown-scale", "--scales", scales)
    assert code == 0 and found["method"] == "refined"
    assert max(errors(found, "T_hand_camera", files.X)) < 1e-8
    expected = [0.5, 3.0] if scales == "per-group" else true
    np.testing.assert_allclose([one["value"] for one in found["scale"].values()], expected, rtol=1e-7)
    assert list(found["scale"])[:2] == (["a", "b"] if scales == "per-group" else ["0", "1"])


def test_parallel_axes_end_with_code_one_and_a_partial_answer(tmp_path, calibrate, capsys):
    draw = np.random.default_rng(3)
    hand = np.stack([files.motion([0, 0, a], draw.uniform(-0.3, 0.3, 3)) for a in draw.uniform(-90, 90, 12)])
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=files.camera_of(hand, Setup.EYE_IN_HAND))
    code = execute(["calibrate", str(path), "--method", "linear", "--out", str(tmp_path / "out"), "--json"])
    shown = capsys.readouterr()
    found = json.loads(shown.out.splitlines()[-1])
    assert code == 1 and found["status"] == "partial" and found["outcome"] == "translation_along_axis"
    assert "the answer is only a part, all rotations turn about one axis" in shown.err and shown.err.count("\n") == 1
    assert errors(found, "T_hand_camera", files.X)[0] < 1e-9
    seen = content(tmp_path / "out", "summary.json")["observability"]
    # the hand turns about its own z axis, so that is the direction that stays open
    np.testing.assert_allclose(np.abs(seen["free_direction"]), [0, 0, 1], atol=1e-9)
    across = (np.array(found["T_hand_camera"]) - files.X)[:2, 3]
    np.testing.assert_allclose(across, 0, atol=1e-9)
    assert (tmp_path / "out" / "figures" / "axes.png").is_file()
    assert "translation free along" in shown.out


def test_one_motion_is_a_part_and_says_so(tmp_path, calibrate):
    hand, camera = files.streams(n=2)
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=camera)
    code, found = calibrate(path, "--method", "linear")
    assert code == 1 and found["status"] == "partial" and not found["usable"]


def test_identical_poses_determine_nothing(tmp_path, calibrate):
    hand, camera = (np.repeat(poses[:1], 12, axis=0) for poses in files.streams())
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=camera)
    code, found = calibrate(path, "--method", "linear")
    assert code == 1 and found["outcome"] == "no_motion"
    assert "nan" not in (tmp_path / "out" / "calibration.json").read_text().lower()


def test_a_wrong_setup_is_remarked_on(tmp_path, calibrate):
    hand, camera = files.streams(Setup.MOVING_FRAMES)
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=camera)
    calibrate(path, "--setup", "eye-in-hand", "--method", "linear")
    notes = content(tmp_path / "out", "summary.json")["notes"]
    assert any("is the set-up right" in note for note in notes)


def test_streams_that_turn_by_other_angles_are_remarked_on(tmp_path, calibrate):
    hand, camera = files.streams()
    path = files.write(tmp_path / "poses.csv", hand=hand, camera=camera[::-1])
    calibrate(path, "--method", "linear")
    notes = content(tmp_path / "out", "summary.json")["notes"]
    assert any("do not turn by the same angles" in note for note in notes)


def test_the_answer_does_not_depend_on_the_form_of_the_file(tmp_path, calibrate):
    """Millimetres, degrees about axes and two files give what metres and quaternions in one file give."""
    hand, camera = files.streams()
    rows = []
    for T in hand:
        angles = Rotation.from_matrix(T[:3, :3]).as_euler("ZYX", degrees=True)[::-1]
        rows.append(",".join(repr(float(v)) for v in (*(1e3 * T[:3, 3]), *angles)))
    (tmp_path / "robot.csv").write_text("\n".join(["x,y,z,rx,ry,rz", *rows]))
    tree = [{"rvec": Rotation.from_matrix(T[:3, :3]).as_rotvec().tolist(), "tvec": T[:3, 3].tolist()} for T in camera]
    (tmp_path / "camera.json").write_text(json.dumps(tree))
    words = ("--angle", "deg", "--length", "mm", "--rotation", "ZYX", "--camera-angle", "rad", "--camera-length", "m")
    code, found = calibrate(tmp_path / "robot.csv", tmp_path / "camera.json", *words, "--method", "linear")
    assert code == 0
    assert max(*errors(found, "T_hand_camera", files.X), *errors(found, "T_base_target", files.Z)) < 1e-9


def test_the_words_of_the_command_are_those_of_the_methods():
    assert set(get_args(MethodName)) == {"all", "joint", *METHODS}
    for method in get_args(MethodName):
        command, _ = parse(["calibrate", "p.csv", "--method", method, "--out", "o"])
        assert isinstance(command, Calibrate) and command.method == method
    for words, value in (("auto", "auto"), ("-0.25", -0.25), ("3", 3.0)):
        command, _ = parse(["calibrate", "p.csv", f"--time-offset={words}"])
        assert isinstance(command, Calibrate) and command.time_offset == value


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "method", "limits"),
    [
        (("lixiny_aruco/TransformPairsInput.yml", "--setup", "moving-frames"), "nonlinear", (0.87, 14.0)),
        (("fishros_aubo_i5/base_aubo_i5_data.csv", "--angle", "deg"), "nonlinear_b", (1.5, 10.0)),
        (
            (
                "ethz_robot_arm_sim/robot_arm_sim_hand.csv", "ethz_robot_arm_sim/robot_arm_sim_camera.csv",
                "--setup", "moving-frames", "--time-offset", "auto",
            ),
            "linear",
            (1.25, 8.2),
        ),
    ],
    ids=["lixiny", "aubo", "eth"],
)  # fmt: skip
def test_real_sets_from_the_command_line(tmp_path, data_dir, words, method, limits):
    """A method on pairs leaves over at most 1.03 times what the data's own description gives (deg, mm)."""
    words = [str(data_dir / "handeye" / word) if "/" in word else word for word in words]
    assert execute(["calibrate", *words, "--method", method, "--out", str(tmp_path / "out")]) == 0
    (found,) = content(tmp_path / "out", "summary.json")["methods"]
    assert found["pairs"]["median_rotation_deg"] <= 1.03 * limits[0]
    assert 1e3 * found["pairs"]["median_translation_m"] <= 1.03 * limits[1]
