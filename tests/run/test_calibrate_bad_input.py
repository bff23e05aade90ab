"""Bad input to ``jaxmodel calibrate``: exit code 2, one sentence naming the fault, nothing left behind."""

from collections.abc import Callable
from pathlib import Path

import hand_eye_files as files
import numpy as np
import pytest

from jaxmodel.run.cli import execute

Refused = Callable[..., str]
HAND, CAMERA = files.streams()


@pytest.fixture
def both(tmp_path: Path) -> str:
    """A sound file of both streams."""
    return files.write(tmp_path / "both.csv", hand=HAND, camera=CAMERA).name


@pytest.fixture
def hand(tmp_path: Path) -> str:
    """A sound file of the hand alone."""
    return files.write(tmp_path / "hand.csv", hand=HAND).name


def test_a_matrix_that_is_not_rigid_is_named_with_its_defect(refused: Refused, tmp_path: Path) -> None:
    spoiled = HAND.copy()
    spoiled[4, :3, :3] *= 1.1
    rows = [",".join(repr(float(v)) for v in T.reshape(-1)) for T in spoiled]
    (tmp_path / "matrices.csv").write_text("\n".join(rows))
    files.write(tmp_path / "camera.csv", camera=CAMERA)
    sentence = refused("calibrate", "matrices.csv", "camera.csv", "--out", "out")
    assert "matrices.csv, line 5: the hand's pose is no rigid motion; R'R is off the identity by 0.21" in sentence


def test_unequal_lengths(refused: Refused, tmp_path: Path, hand: str) -> None:
    files.write(tmp_path / "camera.csv", camera=CAMERA[:9])
    sentence = refused("calibrate", hand, "camera.csv", "--out", "out")
    assert "hand.csv holds 12 poses of the hand and" in sentence and "camera.csv 9 of the camera" in sentence


@pytest.mark.parametrize(
    ("name", "other", "words"),
    [
        ("hand_x", "hand_xx", "line 1: unknown column the text 'hand_xx', did you mean 'x'"),
        ("hand_x,hand_y", "elbow_x,hand_y", "unknown column the text 'elbow_x'"),
        ("camera_x", "camera_x_inch", "unknown unit the text 'inch' of the column the text 'camera_x_inch'"),
    ],
)
def test_unknown_columns_and_units(
    refused: Refused, tmp_path: Path, both: str, name: str, other: str, words: str
) -> None:
    path = tmp_path / both
    path.write_text(path.read_text().replace(name, other, 1))
    assert words in refused("calibrate", both, "--out", "out")


def test_degrees_where_radians_are_due_are_asked_about(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "pairs.csv").write_text("hand,0.1,0,0,170,5,60\neye,0,0,0.3,-80,8,160\n" * 3)
    sentence = refused("calibrate", "pairs.csv", "--out", "out")
    assert "are the hand's angles degrees or radians (the largest is 170)? Say --angle deg or --angle rad" in sentence
    sentence = refused("calibrate", "pairs.csv", "--angle", "rad", "--out", "out")
    assert "lines 1 and 2: the hand's angle 170 is more than a full turn in radians; are these degrees" in sentence


def test_millimetres_where_metres_are_due_are_asked_about(refused: Refused, tmp_path: Path, hand: str) -> None:
    camera = CAMERA.copy()
    camera[:, :3, 3] *= 1000
    files.write(tmp_path / "camera.csv", camera=camera)
    sentence = refused("calibrate", hand, "camera.csv", "--out", "out")
    assert "camera.csv: the camera's positions reach" in sentence and "Say --camera-length mm, or" in sentence


@pytest.mark.parametrize("value", ["nan", "inf", "1e400", "none", ""])
def test_values_that_are_no_finite_numbers(refused: Refused, tmp_path: Path, both: str, value: str) -> None:
    path = tmp_path / both
    lines = path.read_text().splitlines()
    lines[3] = ",".join([value, *lines[3].split(",")[1:]])
    path.write_text("\n".join(lines))
    sentence = refused("calibrate", both, "--out", "out")
    assert "both.csv, line 4: x " in sentence


@pytest.mark.parametrize("count", [0, 1])
def test_without_a_motion(refused: Refused, tmp_path: Path, count: int) -> None:
    files.write(tmp_path / "few.csv", hand=HAND[:count], camera=CAMERA[:count])
    words = "1 pose gives no motion; at least 2 are needed" if count else "holds no poses, only a row of names"
    assert words in refused("calibrate", "few.csv", "--out", "out")


def test_missing_truncated_and_empty_files(refused: Refused, tmp_path: Path, both: str, hand: str) -> None:
    assert "There is no file" in refused("calibrate", "none.csv", "--out", "out")
    assert "There is no file" in refused("calibrate", hand, "none.json", "--out", "out")
    text = (tmp_path / both).read_text()
    (tmp_path / "cut.csv").write_text(text[: len(text) // 2])
    assert "cut.csv, line 7: expected 14 values, found" in refused("calibrate", "cut.csv", "--out", "out")
    (tmp_path / "cut.json").write_text('{"hand": [[[1, 0, 0, 0], [0, 1')
    assert "cut.json, line 1: not valid JSON" in refused("calibrate", "cut.json", "--out", "out")
    (tmp_path / "cut.yml").write_text("%YAML:1.0\n---\nframeCount: 2\nT1_0: !!opencv-matrix\n   rows: 4\n   cols: 4\n")
    assert "cut.yml" in refused("calibrate", "cut.yml", "--out", "out")
    for name in ("empty.csv", "empty.json", "empty.yaml"):
        (tmp_path / name).write_text("")
        assert f"{name}: holds no poses, the file is empty" in refused("calibrate", name, "--out", "out")


def test_an_output_that_cannot_be_made(refused: Refused, tmp_path: Path, both: str) -> None:
    assert "--out is required" in refused("calibrate", both)
    (tmp_path / "file").write_text("")
    assert "is not a folder" in refused("calibrate", both, "--out", "file/out")
    (tmp_path / "there").mkdir()
    assert "there: already exists; choose another folder" in refused("calibrate", both, "--out", "there")
    assert "nothing to resume" in refused("calibrate", both, "--resume", "nowhere")


def test_one_stream_alone(refused: Refused, hand: str) -> None:
    assert "hand.csv: holds one stream of poses; name the camera's file" in refused("calibrate", hand, "--out", "out")


def test_times(refused: Refused, tmp_path: Path, both: str, hand: str) -> None:
    assert "has no times, which --time-offset needs" in refused(
        "calibrate", both, "--time-offset", "auto", "--out", "o"
    )
    files.write(tmp_path / "timed.csv", times=np.arange(12.0), hand=HAND)
    files.write(tmp_path / "camera.csv", times=np.arange(12.0) + 0.4, camera=CAMERA)
    sentence = refused("calibrate", "timed.csv", "camera.csv", "--out", "out")
    assert "are not sampled together (12 poses and 12, their times differ); say --time-offset auto" in sentence


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--scales", "per-group"), "--scales per-group needs --unknown-scale"),
        (("--unknown-scale", "--scales", "per-group"), "scales per-group need a column 'group'"),
        (("--unknown-scale", "--scales", "per-motion", "--method", "linear"), "scales per-motion have a method of"),
        (("--unknown-scale", "--method", "quaternion_penalty"), "quaternion_penalty knows no unknown scale"),
        (("--camera", "camera.yaml"), "--camera and --target describe pictures, which --images names"),
        (("--images", "."), "--images needs --target, for example chessboard:9x6:0.025"),
        (("--images", ".", "--target", "circles:9x6:0.025"), "unknown kind 'circles'"),
        (("--most-poses", "2"), "most_poses is 2, expected 3 or more"),
        (("--working-distance", "0"), "working_distance is 0.0, expected above 0"),
        (("--largest-offset", "-1"), "largest_offset_s is -1.0, expected above 0"),
        (("--bootstrap", "-1"), "bootstrap is -1, expected 0 or more"),
    ],
)
def test_options_that_do_not_fit(refused: Refused, both: str, words: tuple[str, ...], sentence: str) -> None:
    assert sentence in refused("calibrate", both, *words, "--out", "out")


def test_two_sources_of_the_camera(refused: Refused, tmp_path: Path, both: str, hand: str) -> None:
    words = (hand, both, "--images", ".", "--target", "chessboard:9x6:0.025", "--out", "out")
    assert "camera_poses and images both give the camera's poses" in refused("calibrate", *words)


@pytest.mark.parametrize(
    "words",
    [["calibrate"], ["calibrate", "p.csv", "--method", "tsai"], ["calibrate", "p.csv", "--angle", "grad"],
     ["calibrate", "p.csv", "--setup", "hand-in-eye"], ["calibrate", "p.csv", "--time-offset", "soon"]],
)  # fmt: skip
def test_wrong_words(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert execute(words) == 2
