"""The words of ``jaxmodel calibrate`` as a type, like the other commands in ``arguments.py``.

Nothing heavy is imported here, so ``--help`` answers at once.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

_Positional = tyro.conf.Positional
_RotationKind = Literal["vector", "xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]


@dataclass(frozen=True)
class Calibrate:
    """Hand-eye calibration from robot poses and camera poses, by every method side by side.

    Poses come from CSV, text, JSON, YAML or OpenCV files; lengths are metres unless --length says otherwise. The set-up
    says what the camera gives: eye-in-hand and eye-to-hand T_camera_target, moving-frames its own pose T_target_camera.

    Example: jaxmodel calibrate configs/hand_eye/example.csv --setup eye-in-hand --out runs/hand-eye
    Example: jaxmodel calibrate robot.csv camera.csv --setup moving-frames --time-offset auto --out runs/clocks
    Example: jaxmodel calibrate robot.csv --images shots --camera camera.yaml --target chessboard:9x6:0.025 --out runs/c
    """

    poses: Annotated[_Positional[Path], tyro.conf.arg(metavar="POSES")]
    """File with the poses of both streams, or of the hand alone (T_base_hand), or a folder of ViSP's pose files."""
    camera_poses: Annotated[_Positional[Path | None], tyro.conf.arg(metavar="[CAMERA_POSES]")] = None
    """File with the camera's poses, if they are not in the first."""
    setup: Literal["eye-in-hand", "eye-to-hand", "moving-frames"] = "eye-in-hand"
    """Camera on the hand; camera fixed, target on the hand; or camera on the hand that gives its own pose."""
    method: Literal[
        "all", "joint", "linear", "linear_one_step", "tsai_lenz", "dual_quaternion", "park", "quaternion", "nonlinear",
        "nonlinear_b", "quaternion_penalty",
    ] = "all"  # fmt: skip
    """Every method, or a single one."""
    unknown_scale: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """The camera's lengths have an unknown unit (self-calibration, no target of known size)."""
    scales: Literal["one", "per-group", "per-motion"] | None = None
    """With --unknown-scale: one scale for all (the default), one for each value of the column 'group', or one for each
    motion from a pose to the next."""
    noise: Literal["auto", "camera", "depth", "hand"] = "auto"
    """Which stream carries the noise, for joint; depth: the camera, with another error along its line of sight than
    across it; auto: camera or depth, as the residuals say."""
    loss: Literal["none", "huber", "tukey"] = "none"
    """Robust loss of every method: poses that contradict the others are weighed down instead of left out."""
    angle: Literal["deg", "rad"] | None = None
    """Unit of the files' angles. Asked for where a file leaves it open."""
    length: Literal["m", "mm"] | None = None
    """Unit of the files' lengths. Metres unless the numbers are too large for that: then asked for."""
    rotation: _RotationKind | None = None
    """What rx ry rz are: a rotation vector, or angles about these axes in turn, fixed (xyz) or moving (XYZ)."""
    quaternion: Literal["xyzw", "wxyz"] = "xyzw"
    """Order of quaternions without names."""
    camera_angle: Literal["deg", "rad"] | None = None
    """Unit of the camera's angles, if another than the hand's."""
    camera_length: Literal["m", "mm"] | None = None
    """Unit of the camera's lengths, if another than the hand's."""
    camera_rotation: _RotationKind | None = None
    """What the camera's rx ry rz are, if another than the hand's."""
    camera_quaternion: Literal["xyzw", "wxyz"] | None = None
    """Order of the camera's quaternions, if another than the hand's."""
    time_offset: Literal["auto"] | float | None = None
    """Seconds from the camera's clock to the hand's, or auto: found from the rotation angles. Needs times (t)."""
    largest_offset: float = 1.0
    """Seconds to either side that --time-offset auto searches."""
    most_poses: int = 60
    """Of a longer recording, so many evenly spread poses are used."""
    images: Path | None = None
    """Folder of pictures of a target, one for each pose of the hand, in place of the camera's poses. With
    --unknown-scale --setup moving-frames and without --target: of any textured scene."""
    camera: Path | None = None
    """With --images: the camera's intrinsics (OpenCV, ROS, ViSP or JSON). Without, they are estimated."""
    target: str | None = None
    """With --images: chessboard:COLUMNSxROWS:SQUARE (inner corners, metres), charuco:CxR:SQUARE:MARKER:DICTIONARY or
    apriltag:CxR:PITCH:TAG:DICTIONARY."""
    working_distance: float | None = None
    """Metres from the camera at which the expected error is stated. Default: where the target was."""
    keep_outliers: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Use the poses that contradict the others too, instead of leaving them out."""
    bootstrap: int = 0
    """Draws of a second, resampled covariance."""
    seed: int = 0
    """Of every random draw."""
    out: Path | None = None
    """Folder for the results, not yet existing. Required unless --resume is given."""
    resume: Path | None = None
    """Folder of an interrupted calibration to continue."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""
