"""From the words of a calibration to paired poses: streams, clocks, names, pictures."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import hand_eye_files as files
import numpy as np
import pytest

from jaxmodel.calibrate.motions import Setup
from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.io.strict_yaml import structure
from jaxmodel.run.calibration.config import Config
from jaxmodel.run.calibration.images import parse_target
from jaxmodel.run.calibration.input import load_poses

HAND, CAMERA = files.streams()


def config(poses: Path, **changes: Any) -> Config:
    return structure({"experiment": "calibration", "poses": str(poses), **changes}, Config, "test")


def test_one_file_and_two_files_are_the_same_poses(tmp_path):
    both = load_poses(config(files.write(tmp_path / "both.csv", hand=HAND, camera=CAMERA)))
    camera = files.write(tmp_path / "camera.csv", camera=CAMERA)
    two = load_poses(config(files.write(tmp_path / "hand.csv", hand=HAND), camera_poses=str(camera)))
    for one in (both, two):
        np.testing.assert_allclose(one.hand, HAND, atol=1e-12)
        np.testing.assert_allclose(one.camera, CAMERA, atol=1e-12)
        assert one.places[0] == "line 2"
    assert both.files == (tmp_path / "both.csv",)
    assert two.files == (tmp_path / "hand.csv", tmp_path / "camera.csv")


def test_files_with_names_are_paired_by_them(tmp_path):
    order = np.random.default_rng(2).permutation(len(HAND))

    def named(path: Path, poses: np.ndarray, names: Any) -> Path:
        lines = files.write(path, hand=poses).read_text().splitlines()
        body = [f"shot{name}.png,{line}" for name, line in zip(names, lines[1:], strict=True)]
        path.write_text("\n".join([f"image,{lines[0]}", *body]))
        return path

    hand = named(tmp_path / "hand.csv", HAND, range(len(HAND)))
    camera = named(tmp_path / "camera.csv", CAMERA[order], order)
    found = load_poses(config(hand, camera_poses=str(camera)))
    np.testing.assert_allclose(found.camera, CAMERA, atol=1e-12)
    named(camera, CAMERA[order], order + 1)
    with pytest.raises(InputError, match=r"do not name the same poses once each; see 'shot0\.png'"):
        load_poses(config(hand, camera_poses=str(camera)))


def test_unequal_lengths_name_both_files(tmp_path):
    hand = files.write(tmp_path / "hand.csv", hand=HAND)
    camera = files.write(tmp_path / "camera.csv", camera=CAMERA[:-1])
    with pytest.raises(InputError, match=r"hand\.csv holds 12 poses of the hand and .*camera\.csv 11"):
        load_poses(config(hand, camera_poses=str(camera)))


def test_one_pose_is_no_motion(tmp_path):
    path = files.write(tmp_path / "one.csv", hand=HAND[:1], camera=CAMERA[:1])
    with pytest.raises(InputError, match=r"one\.csv: 1 pose gives no motion"):
        load_poses(config(path))


def test_a_long_recording_is_thinned_evenly_and_says_so(tmp_path):
    hand, camera = files.streams(n=50)
    path = files.write(tmp_path / "long.csv", hand=hand, camera=camera)
    found = load_poses(config(path, most_poses=8))
    np.testing.assert_allclose(found.hand, hand[[0, 7, 14, 21, 28, 35, 42, 49]], atol=1e-12)
    assert found.places[1] == "line 9"
    assert "8 of 50 poses are used" in found.notes[0]


def recording(times: np.ndarray) -> np.ndarray:
    """A smooth swing about three axes."""
    return np.stack(
        [
            files.motion(
                [40 * np.sin(1.1 * t), 35 * np.sin(1.7 * t + 1), 50 * np.cos(0.9 * t)],
                [0.2 * np.sin(t), 0.1 * np.cos(1.3 * t), 0.05 * t],
            )
            for t in times
        ]
    )


OFFSET = 0.137


@pytest.fixture
def clocks(tmp_path: Path) -> tuple[Path, Path, np.ndarray]:
    """A hand at 100 Hz and a camera at 10 Hz whose clock shows less by OFFSET; the hand's poses at its times."""
    hand_times, camera_times = np.arange(0, 12, 0.01), np.arange(1.003, 11, 0.1)
    true = recording(camera_times + OFFSET)
    hand = files.write(tmp_path / "hand.csv", times=hand_times, hand=recording(hand_times))
    camera = files.write(tmp_path / "camera.csv", times=camera_times, camera=files.camera_of(true, Setup.MOVING_FRAMES))
    return hand, camera, true


def test_the_offset_of_the_clocks_is_found(clocks):
    hand, camera, true = clocks
    words = {"camera_poses": str(camera), "setup": "moving-frames", "most_poses": 1000}
    found = load_poses(config(hand, **words, time_offset="auto"))
    assert found.synchronised is not None
    assert abs(found.synchronised.offset_s - OFFSET) < 1e-3
    rows = [int(place.removeprefix("line ")) - 2 for place in found.places]
    # between two of the hand's samples, 0.01 s apart, the path bends by less than 1e-4
    np.testing.assert_allclose(found.hand, true[rows], atol=2e-3)
    given = load_poses(config(hand, **words, time_offset=OFFSET))
    assert len(given.hand) == len(true)
    np.testing.assert_allclose(given.hand, true, atol=1e-4)


def test_streams_that_are_not_sampled_together_are_asked_about(clocks, tmp_path):
    hand, camera, _ = clocks
    with pytest.raises(InputError, match=r"are not sampled together .*say --time-offset auto, or the offset"):
        load_poses(config(hand, camera_poses=str(camera)))
    files.write(tmp_path / "untimed.csv", hand=HAND)
    with pytest.raises(InputError, match=r"untimed\.csv: has no times, which --time-offset needs"):
        load_poses(config(tmp_path / "untimed.csv", camera_poses=str(camera), time_offset="auto"))
    with pytest.raises(InputError, match="The streams overlap in 0 camera poses"):
        load_poses(config(hand, camera_poses=str(camera), time_offset=100.0))


def test_an_offset_at_the_edge_of_the_search_is_remarked_on(clocks):
    hand, camera, _ = clocks
    words = {"camera_poses": str(camera), "setup": "moving-frames", "time_offset": "auto"}
    assert not [note for note in load_poses(config(hand, **words)).notes if "offset" in note]
    notes = load_poses(config(hand, **words, largest_offset_s=0.05)).notes
    assert "the time offset lies at the end of what was searched, 0.05 s" in notes


def test_a_camera_of_unknown_scale_is_not_asked_for_its_unit(tmp_path):
    camera = CAMERA.copy()
    camera[:, :3, 3] *= 700
    path = files.write(tmp_path / "poses.csv", hand=HAND, camera=camera)
    with pytest.raises(InputError, match="are these millimetres"):
        load_poses(config(path))
    np.testing.assert_allclose(load_poses(config(path, scales="one")).camera, camera, atol=1e-9)


def test_groups_need_a_column(tmp_path):
    path = files.write(tmp_path / "poses.csv", hand=HAND, camera=CAMERA)
    with pytest.raises(InputError, match="scales per-group need a column 'group'"):
        load_poses(config(path, scales="per-group"))
    files.write(path, hand=HAND, camera=CAMERA, groups=["a"] * 6 + ["b"] * 6)
    assert load_poses(config(path, scales="per-group")).groups == ("a",) * 6 + ("b",) * 6
    files.write(path, hand=HAND, camera=CAMERA, groups=[f"g{k}" for k in range(12)])
    with pytest.raises(InputError, match="no group holds two poses"):
        load_poses(config(path, scales="per-group"))


@dataclass(frozen=True)
class Target:
    kind: str
    columns: int
    rows: int
    square: float
    marker: float = 0.0
    dictionary: str = ""


@dataclass(frozen=True)
class Camera:
    K: np.ndarray


@dataclass(frozen=True)
class TargetPoses:
    T_camera_target: np.ndarray
    found: np.ndarray
    reprojection_px: np.ndarray
    camera: Camera
    ambiguous: np.ndarray
    dropped: np.ndarray
    misread: np.ndarray


@pytest.fixture
def pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """A folder of empty pictures shot1 .. shot12, and a detector that knows their poses; it finds none in shot5."""
    calls: list[Any] = []
    folder = tmp_path / "shots"
    folder.mkdir()
    for k in range(len(HAND)):
        (folder / f"shot{k + 1}.png").write_bytes(b"")

    def target_poses(images: Any, target: Any, camera: Any) -> TargetPoses:
        calls.append((images, target, camera))
        numbers = [int(Path(image).stem.removeprefix("shot")) - 1 for image in images]
        found = np.array([number != 4 for number in numbers])
        poses = np.where(found[:, None, None], CAMERA[numbers], np.nan)
        pixels = np.where(found, 0.3, np.nan)
        camera = Camera(np.array([[600.0, 0, 320], [0, 601, 240], [0, 0, 1]]))
        doubtful, none = np.array([number == 2 for number in numbers]), np.zeros(len(numbers), int)
        return TargetPoses(poses, found, pixels, camera, doubtful, none, none.astype(bool))

    detector, reader = ModuleType("jaxmodel.calibrate.images"), ModuleType("jaxmodel.io.camera")
    detector.__dict__.update(Target=Target, target_poses=target_poses)
    reader.__dict__.update(load_camera=lambda path: ("camera of", path))
    monkeypatch.setitem(sys.modules, "jaxmodel.calibrate.images", detector)
    monkeypatch.setitem(sys.modules, "jaxmodel.io.camera", reader)
    return calls


def images_of(tmp_path: Path, **more: Any) -> dict[str, Any]:
    return {"folder": str(tmp_path / "shots"), "target": "chessboard:9x6:0.025", **more}


def test_pictures_in_place_of_poses(tmp_path, pictures):
    """Pictures belong to poses in the order of the numbers in their names; one without the target is named."""
    path = files.write(tmp_path / "robot.csv", hand=HAND)
    (tmp_path / "camera.yaml").write_text("")
    found = load_poses(config(path, images=images_of(tmp_path, camera=str(tmp_path / "camera.yaml"))))
    kept = np.arange(12) != 4
    np.testing.assert_allclose(found.hand, HAND[kept], atol=1e-12)
    np.testing.assert_array_equal(found.camera, CAMERA[kept])
    assert found.places[3:6] == ("shot4.png", "shot6.png", "shot7.png")
    assert found.notes[0] == "the target is not found in shot5.png"
    assert "to tell its pose from the mirrored one in shot3.png" in found.notes[1]
    assert "11 of 12 pictures, reprojection 0.3 px" in found.notes[2]
    assert pictures[0][1] == Target("chessboard", 9, 6, 0.025)
    assert pictures[0][2] == ("camera of", tmp_path / "camera.yaml")
    assert {"robot.csv", "shot1.png", "camera.yaml"} <= {file.name for file in found.files}


def test_a_camera_without_a_file_is_estimated_and_said(tmp_path, pictures):
    found = load_poses(config(files.write(tmp_path / "robot.csv", hand=HAND), images=images_of(tmp_path)))
    assert pictures[0][2] is None
    assert "the camera is estimated from the pictures: focal lengths 600.0, 601.0 px" in found.notes[3]


def test_poses_that_name_their_pictures(tmp_path, pictures):
    path = tmp_path / "robot.csv"
    lines = files.write(path, hand=HAND).read_text().splitlines()
    chosen = [12, 3, 7]
    path.write_text("\n".join([f"image,{lines[0]}", *(f"shot{k}.png,{lines[k]}" for k in chosen)]))
    found = load_poses(config(path, images=images_of(tmp_path)))
    np.testing.assert_array_equal(found.camera, CAMERA[[11, 2, 6]])
    path.write_text("\n".join([f"image,{lines[0]}", f"shot99.png,{lines[1]}"]))
    with pytest.raises(InputError, match=r"holds no picture for the pose 'shot99\.png'"):
        load_poses(config(path, images=images_of(tmp_path)))


def test_pictures_that_do_not_fit_the_poses(tmp_path, pictures):
    path = files.write(tmp_path / "robot.csv", hand=HAND[:7])
    with pytest.raises(InputError, match=r"robot\.csv holds 7 poses and .*shots 12 pictures"):
        load_poses(config(path, images=images_of(tmp_path)))
    with pytest.raises(InputError, match="There is no folder of images"):
        load_poses(config(path, images={"folder": str(tmp_path / "none"), "target": "chessboard:9x6:0.025"}))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: holds no pictures"):
        load_poses(config(path, images={"folder": str(tmp_path / "empty"), "target": "chessboard:9x6:0.025"}))
    with pytest.raises(InputError, match="setup is moving-frames, but images give T_camera_target"):
        load_poses(config(path, images=images_of(tmp_path), setup="moving-frames"))


def test_stray_corners_and_misread_pictures_are_counted_and_named(tmp_path, pictures):
    detector: Any = sys.modules["jaxmodel.calibrate.images"]  # the one that stands in, not the package's attribute

    def spoiled(*given: Any, of: Any = detector.target_poses) -> TargetPoses:
        whole, number = of(*given), np.arange(12)
        return replace(whole, dropped=np.where(number == 10, 2, number == 0), misread=number == 4)

    detector.target_poses = spoiled
    found = load_poses(config(files.write(tmp_path / "robot.csv", hand=HAND), images=images_of(tmp_path)))
    assert found.notes[0].startswith("the corners found in shot5.png are in an order or at places that no view of the")
    assert found.notes[1].endswith("where all the others put them are left out: 1 in shot1.png, 2 in shot11.png")
    assert not any("not found in" in note for note in found.notes)


def test_pictures_are_in_the_order_of_their_numbers(tmp_path, pictures):
    """Wherever in the name the numbers are; leading zeros or not."""
    for k in range(12):
        (tmp_path / "shots" / f"shot{k + 1}.png").rename(tmp_path / "shots" / f"run2_{k + 1}_left.png")
    path = files.write(tmp_path / "robot.csv", hand=HAND)
    with pytest.raises(ValueError, match="run2_1_left"):  # the detector that stands in reads names of another form
        load_poses(config(path, images=images_of(tmp_path)))
    found = [file.name for file in pictures[0][0]]
    assert found == [f"run2_{k + 1}_left.png" for k in range(12)]


def test_a_number_that_two_pictures_end_in_names_neither(tmp_path, pictures):
    path = tmp_path / "robot.csv"
    lines = files.write(path, hand=HAND).read_text().splitlines()
    path.write_text("\n".join([f"image,{lines[0]}", f"pose3,{lines[3]}", f"pose4,{lines[4]}"]))
    np.testing.assert_array_equal(load_poses(config(path, images=images_of(tmp_path))).camera, CAMERA[[2, 3]])
    (tmp_path / "shots" / "other3.png").write_bytes(b"")
    with pytest.raises(InputError, match="holds no picture for the pose 'pose3'"):
        load_poses(config(path, images=images_of(tmp_path)))


def test_pictures_without_a_target_need_words_that_suit_them(tmp_path, pictures):
    path, images = files.write(tmp_path / "robot.csv", hand=HAND), {"folder": str(tmp_path / "shots")}
    for more in ({}, {"scales": "one"}, {"setup": "moving-frames"}):
        with pytest.raises(InputError, match="expected --setup moving-frames and --unknown-scale, or a --target"):
            load_poses(config(path, images=images, **more))
    with pytest.raises(InputError, match="do not tell the camera's intrinsics; give --camera"):
        load_poses(config(path, images=images, setup="moving-frames", scales="one"))


def test_too_few_pictures_with_the_target(tmp_path, pictures):
    path = tmp_path / "robot.csv"
    lines = files.write(path, hand=HAND).read_text().splitlines()
    path.write_text("\n".join([f"image,{lines[0]}", f"shot5.png,{lines[5]}", f"shot6.png,{lines[6]}"]))
    with pytest.raises(InputError, match="is found in 1 of 2 pictures; at least 2 are needed"):
        load_poses(config(path, images=images_of(tmp_path)))


def test_targets_in_words(pictures):
    assert parse_target("charuco:5x7:0.04:0.03:DICT_4X4_50") == Target("charuco", 5, 7, 0.04, 0.03, "DICT_4X4_50")
    assert parse_target("apriltag:6x4:0.11:0.09:APRILTAG_25H9") == Target("apriltag", 6, 4, 0.11, 0.09, "APRILTAG_25H9")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("board:9x6:0.025", "unknown kind 'board', expected one of: chessboard:9x6"),
        ("chessboard", "expected chessboard:9x6:0.025"),
        ("chessboard:9:0.025", "expected chessboard:9x6:0.025"),
        ("chessboard:9x6:wide", "expected chessboard:9x6:0.025"),
        ("chessboard:9x6:-0.025", "expected chessboard:9x6:0.025"),
        ("chessboard:9x6:25", "a length of 25 m; are these millimetres"),
        ("charuco:5x7:0.04:0.03", "expected charuco:5x7"),
        ("apriltag:6x6:0.088:nan:APRILTAG_36H11", "expected apriltag:6x6"),
    ],
)
def test_bad_targets_are_named(words, sentence):
    with pytest.raises(InputError, match=f"target '{words}': {sentence}"):
        parse_target(words)


def test_exact_streams_belong_to_their_setup():
    """The files of these tests themselves: ``H X C = Z`` in each set-up."""
    for setup in Setup:
        hand, camera = files.streams(setup)
        H = se3.inverse(hand) if setup is Setup.EYE_TO_HAND else hand
        C = se3.inverse(camera) if setup is Setup.MOVING_FRAMES else camera
        np.testing.assert_allclose(H @ files.X @ C, np.broadcast_to(files.Z, H.shape), atol=1e-12)
