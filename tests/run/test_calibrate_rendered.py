"""The command on rendered pictures of known truth: each kind of target, a scene without one, and what is refused."""

import json
from pathlib import Path

import cv2
import hand_eye_files as files
import numpy as np
import pytest
from rendered_scene import CAMERA, T_HAND_CAMERA, boxes, nine_views, photographs
from rendered_targets import CHARUCO, CHESSBOARD, PINHOLE, TAGS, pose_errors, take, views
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3
from jaxmodel.run.cli import execute
from jaxmodel.scan.camera import Camera

WORDS = {
    "chessboard": "chessboard:9x6:0.03",
    "charuco": "charuco:7x5:0.04:0.03:DICT_5X5_100",
    "apriltag": "apriltag:4x3:0.06:0.048:APRILTAG_36h11",
}
T_BASE_TARGET = se3.compose(Rotation.from_rotvec([2.9, 0.3, -0.4]).as_matrix(), np.array([0.5, -0.1, 0.05]))
COUNT = 10


def write_camera(path: Path, camera: Camera) -> Path:
    size = {"width": camera.width, "height": camera.height}
    path.write_text(json.dumps({"K": camera.K.tolist(), "distortion": camera.distortion.tolist(), **size}))
    return path


@pytest.fixture(scope="module", params=[CHESSBOARD, CHARUCO, TAGS], ids=lambda target: target.kind)
def rendered(request, tmp_path_factory) -> tuple[Path, str]:
    """A folder with robot.csv, camera.json and shots/img1 .. img10.png, every other one upside down.

    Of boards with markers a quarter of each picture is covered.
    """
    target, folder = request.param, tmp_path_factory.mktemp(request.param.kind)
    poses = views(target, COUNT, seed=8)
    poses[::2, :3, :3] = poses[::2, :3, :3] @ np.diag([-1.0, -1.0, 1.0])
    hide = 0.0 if target is CHESSBOARD else 0.25
    (folder / "shots").mkdir()
    for k, picture in enumerate(take(folder, target, poses, hide=hide), start=1):
        picture.rename(folder / "shots" / f"img{k}.png")
    files.write(folder / "robot.csv", hand=T_BASE_TARGET @ poses @ se3.inverse(T_HAND_CAMERA))
    write_camera(folder / "camera.json", PINHOLE)
    return folder, target.kind


def calibrate(folder: Path, out: Path, *words: str) -> dict:
    line = ["calibrate", str(folder / "robot.csv"), "--images", str(folder / "shots"), *words, "--method", "joint"]
    assert execute([*line, "--out", str(out)]) == 0
    return json.loads((out / "summary.json").read_text())


@pytest.mark.slow
def test_each_target_from_the_command(rendered, tmp_path):
    folder, kind = rendered
    words = ("--camera", str(folder / "camera.json"), "--target", WORDS[kind])
    summary = calibrate(folder, tmp_path / "out", *words)
    found = summary["recommended"]
    for name, true in (("T_hand_camera", T_HAND_CAMERA), ("T_base_target", T_BASE_TARGET)):
        angle, distance = pose_errors(np.array(found[name])[None], true[None])
        assert angle[0] < 0.5 and 1e3 * distance[0] < 2.0
    assert not any("lengths would fit" in note for note in summary["notes"])


@pytest.mark.slow
@pytest.mark.parametrize("rendered", [CHESSBOARD], indirect=True, ids=lambda target: target.kind)
@pytest.mark.parametrize("factor", [1e-3, 0.95])
def test_a_target_of_another_size_is_remarked_on(rendered, tmp_path, factor):
    """Squares given a thousand times, or a twentieth, too small: the hand's lengths say so, and by how much."""
    folder, _ = rendered
    target = f"chessboard:9x6:{factor * CHESSBOARD.square!r}"
    words = ("--camera", str(folder / "camera.json"), "--target", target)
    summary = calibrate(folder, tmp_path / "out", *words)
    notes = [note for note in summary["notes"] if "the camera's lengths would fit the hand's better times" in note]
    assert len(notes) == 1
    times = float(notes[0].split("times ")[1].split(" ")[0])
    assert times * factor == pytest.approx(1.0, abs=0.02)
    scaled = calibrate(folder, tmp_path / "scaled", *words, "--unknown-scale")["recommended"]
    assert scaled["scale"] * factor == pytest.approx(1.0, abs=5 * scaled["scale_deviation"] * factor)
    angle, distance = pose_errors(np.array(scaled["T_hand_camera"])[None], T_HAND_CAMERA[None])
    assert angle[0] < 0.5 and distance[0] < 0.03 * np.linalg.norm(T_HAND_CAMERA[:3, 3])


@pytest.mark.slow
def test_pictures_that_do_not_fit_are_refused_in_one_sentence(rendered, tmp_path, refused):
    folder, kind = rendered
    robot, shots, camera = (str(folder / name) for name in ("robot.csv", "shots", "camera.json"))

    def refusal(images: str, target: str = WORDS[kind]) -> str:
        return refused("calibrate", robot, "--images", images, "--camera", camera, "--target", target,
                       "--out", str(tmp_path / "out"))  # fmt: skip

    if kind != "chessboard":
        other = WORDS[kind].rsplit(":", 1)[0] + ":DICT_6X6_250"
        assert "None of the 10 images shows the target" in refusal(shots, other)
    else:
        assert "None of the 10 images shows the target" in refusal(shots, "chessboard:8x5:0.03")
    bad = tmp_path / "bad"
    bad.mkdir()
    assert "holds no pictures" in refusal(str(bad))
    for picture in (folder / "shots").iterdir():
        (bad / picture.name).write_bytes(picture.read_bytes())
    (bad / "img3.png").write_bytes((bad / "img3.png").read_bytes()[:40])
    assert "img3.png cannot be read as an image" in refusal(str(bad))
    cv2.imwrite(str(bad / "img3.png"), np.zeros((240, 320), np.uint8))
    assert "img3.png has 320 x 240 pixels, but the camera is for 640 x 480" in refusal(str(bad))
    (bad / "img11.png").write_bytes((bad / "img1.png").read_bytes())
    assert "holds 10 poses and" in refusal(str(bad)) and "11 pictures" in refusal(str(bad))


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    """Nine views of boxes, the fourth of which shows nothing."""
    rng, folder = np.random.default_rng(4), tmp_path_factory.mktemp("scene")
    poses = nine_views(rng, 20.0)
    (folder / "shots").mkdir()
    images = photographs(folder / "shots", boxes(rng), poses, rng)
    cv2.imwrite(str(images[3]), np.full((CAMERA.height, CAMERA.width), 90, np.uint8))
    files.write(folder / "robot.csv", hand=poses @ se3.inverse(T_HAND_CAMERA))
    write_camera(folder / "camera.json", CAMERA)
    return folder


@pytest.mark.slow
def test_a_scene_without_a_target(scene, tmp_path):
    """0.3 degrees and 3 % of the translation; the view that shows nothing is named and left out."""
    words = ("--camera", str(scene / "camera.json"), "--setup", "moving-frames", "--unknown-scale")
    summary = calibrate(scene, tmp_path / "out", *words)
    found = summary["recommended"]
    assert summary["poses"] == 8
    assert any(note == "these pictures fit no other and are left out: scene_4.png" for note in summary["notes"])
    angle, distance = pose_errors(np.array(found["T_hand_camera"])[None], T_HAND_CAMERA[None])
    assert angle[0] < 0.3 and distance[0] < 0.03 * np.linalg.norm(T_HAND_CAMERA[:3, 3])
    assert found["scale_deviation"] > 0


@pytest.mark.slow
def test_two_views_of_a_scene_are_too_few(scene, tmp_path, refused):
    folder = tmp_path / "two"
    folder.mkdir()
    for k in (1, 2):
        (folder / f"scene_{k}.png").write_bytes((scene / "shots" / f"scene_{k}.png").read_bytes())
    lines = (scene / "robot.csv").read_text().splitlines()
    (tmp_path / "robot.csv").write_text("\n".join(lines[:3]) + "\n")
    words = ("calibrate", str(tmp_path / "robot.csv"), "--images", str(folder), "--setup", "moving-frames",
             "--unknown-scale", "--out", str(tmp_path / "out"))  # fmt: skip
    assert "2 pictures of a scene are too few; at least 3 are needed" in refused(*words)
