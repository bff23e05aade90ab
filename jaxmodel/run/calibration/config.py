"""The YAML of a hand-eye calibration, and the words that its command shares with it."""

from dataclasses import dataclass, field
from typing import Literal

from jaxmodel.calibrate.loss import Loss
from jaxmodel.io.pose_values import Forms

SetupName = Literal["eye-in-hand", "eye-to-hand", "moving-frames"]
NoiseName = Literal["auto", "camera", "depth", "hand"]
ScalesName = Literal["known", "one", "per-group", "per-motion"]
MethodName = Literal[
    "all", "joint", "linear", "linear_one_step", "tsai_lenz", "dual_quaternion", "park", "quaternion", "nonlinear",
    "nonlinear_b", "quaternion_penalty",
]  # fmt: skip


@dataclass(frozen=True)
class Images:
    """Pictures of a target, or without ``target`` of any scene, instead of the camera's poses.

    ``target``: ``chessboard:9x6:0.025`` (inner corners, square in metres), ``charuco:5x7:0.04:0.03:DICT_4X4_50``
    (squares, square, marker, dictionary) or ``apriltag:6x6:0.114:0.088:APRILTAG_36H11`` (tags, from one to the next,
    side of a tag, dictionary). ``camera``: a file of intrinsics; without one they are estimated from the pictures of a
    target.
    """

    folder: str
    target: str | None = None
    camera: str | None = None


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment; lengths in metres.

    ``poses`` holds both streams, or the hand's alone where ``camera_poses`` or ``images`` give the camera's. At most
    ``most_poses``, evenly spread, are used: more of a recording say little more. ``noise`` names the stream that
    carries it; ``auto``: the camera, its error along the line of sight apart where it differs. A robust ``loss`` weighs
    poses down by their residuals instead of leaving them out. ``keep_outliers`` names the poses that contradict the
    others, but uses them. ``bootstrap``: draws of a second covariance.
    """

    poses: str
    experiment: Literal["calibration"] = "calibration"
    camera_poses: str | None = None
    images: Images | None = None
    setup: SetupName = "eye-in-hand"
    method: MethodName = "all"
    scales: ScalesName = "known"
    noise: NoiseName = "auto"
    loss: Loss = "none"
    forms: Forms = field(default_factory=Forms)
    time_offset: Literal["auto"] | float | None = None
    largest_offset_s: float = 1.0
    most_poses: int = 60
    working_distance: float | None = None
    keep_outliers: bool = False
    bootstrap: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.camera_poses is not None and self.images is not None:
            raise ValueError("camera_poses and images both give the camera's poses, expected one of them")
        if self.most_poses < 3:
            raise ValueError(f"most_poses is {self.most_poses}, expected 3 or more")
        if self.working_distance is not None and not self.working_distance > 0:
            raise ValueError(f"working_distance is {self.working_distance}, expected above 0 (metres)")
        if not self.largest_offset_s > 0:
            raise ValueError(f"largest_offset_s is {self.largest_offset_s}, expected above 0")
        if self.bootstrap < 0:
            raise ValueError(f"bootstrap is {self.bootstrap}, expected 0 or more draws")
        if self.scales != "known" and self.method == "quaternion_penalty":
            raise ValueError("the method quaternion_penalty knows no unknown scale")
        if self.scales in ("per-group", "per-motion") and self.method != "all":
            raise ValueError(f"scales {self.scales} have a method of their own, expected method: all")
        if self.scales in ("per-group", "per-motion") and self.loss != "none":
            raise ValueError(f"scales {self.scales} know no robust loss, expected loss: none")
