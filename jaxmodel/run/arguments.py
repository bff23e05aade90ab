"""The command line as types: one class a command, its fields the options, its docstring the ``--help``.

Nothing heavy is imported here, so ``--help`` answers at once.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

_Positional = tyro.conf.Positional
ControlPointsKind = Literal["subsample", "vertices", "contours", "split_vertices"]
Labels = tuple[Literal["crease", "depth", "border"], ...]
_RotationKind = Literal["vector", "xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]


@dataclass(frozen=True)
class Run:
    """Run any experiment described by a YAML file.

    Any key of the file can be changed on the command line by its dotted path, lists by number:
    --engine.chunk 100, --control_points.0.count 500. A killed run goes on with --resume DIR.

    Example: jaxmodel run configs/experiments/quickstart.yaml --out runs/first --seed 7
    """

    config: _Positional[Path]
    """The experiment, a YAML file or the name of a built-in one (quickstart)."""
    out: Path | None = None
    """Folder for the results, not yet existing. Default: runs/NAME-1, or the first free number."""
    resume: Path | None = None
    """Folder of an interrupted run to continue."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""


@dataclass(frozen=True)
class Sweep:
    """Register one pair of scans from many starts, and say how many converge.

    Example: jaxmodel sweep bun000.ply bun045.ply --truth bun.conf --starts 1000 --out runs/bunny
    """

    target: _Positional[Path]
    """Scan that stays: a range image or cloud (ply, pcd, obj, stl, xyz, npz, pts, osu)."""
    source: _Positional[Path]
    """Scan that is moved onto it."""
    starts: int = 1000
    """How many starts. A cube fills the Euler grid (1000 = 10 x 10 x 10); other numbers take part of the next one."""
    grid: Literal["euler", "even"] = "euler"
    """The thesis's grid of Euler angles, or rotations spread evenly."""
    method: str = "thesis_2005"
    """A registration method, by the name of its file in configs/methods."""
    control_points: ControlPointsKind = "subsample"
    """Points that drive the registration: measured points, vertices of the decimated range image, points on its
    contours, or vertices of its split mesh."""
    labels: Labels = ("crease",)
    """Which contours, with --control-points contours: crease for free forms and cylinders, all three for polyhedra."""
    count: int = 2000
    """How many control points of each scan."""
    truth: Path | None = None
    """True motion: a Stanford .conf, JSON of poses, or a 4 x 4 matrix."""
    seed: int = 0
    """Of every random draw."""
    chunk: int = 250
    """Starts between two saved parts."""
    executor: Literal["auto", "cores", "lanes"] = "auto"
    """How starts are run: one after another on each core, or many lanes at once."""
    lanes: int = 256
    """Starts in flight at once with --executor lanes."""
    order: Literal["sequential", "shuffled"] = "sequential"
    """Order in which the starts are run; the results do not depend on it."""
    out: Path | None = None
    """Folder for the results, not yet existing. Required unless --resume is given."""
    resume: Path | None = None
    """Folder of an interrupted sweep to continue."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""


@dataclass(frozen=True)
class Register:
    """Register one pair of scans and write transform.json.

    Without --init the best of 500 evenly spread starts is taken.

    Example: jaxmodel register bun000.ply bun045.ply --init guess.txt --out runs/one
    """

    target: _Positional[Path]
    """Scan that stays."""
    source: _Positional[Path]
    """Scan that is moved onto it."""
    init: Path | None = None
    """First guess of T_target_source: 4 x 4 text, .npy or JSON."""
    method: str = "thesis_2005"
    """A registration method, by the name of its file in configs/methods."""
    control_points: ControlPointsKind = "subsample"
    """Points that drive the registration."""
    labels: Labels = ("crease",)
    """Which contours, with --control-points contours: crease for free forms and cylinders, all three for polyhedra."""
    count: int = 2000
    """How many control points of each scan."""
    seed: int = 0
    """Of every random draw."""
    out: Path | None = None
    """Folder for the results, not yet existing. Required unless --resume is given."""
    resume: Path | None = None
    """Folder of an interrupted registration to continue."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""


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
        "all", "joint", "linear", "linear_one_step", "tsai_lenz", "dual_quaternion", "park", "nonlinear", "nonlinear_b",
        "quaternion_penalty",
    ] = "all"  # fmt: skip
    """Every method, or a single one."""
    unknown_scale: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """The camera's lengths have an unknown unit (self-calibration, no target of known size)."""
    scales: Literal["one", "per-group", "per-motion"] | None = None
    """With --unknown-scale: one scale for all (the default), one for each value of the column 'group', or one for each
    motion from a pose to the next."""
    noise: Literal["camera", "hand"] = "camera"
    """Which stream carries the noise, for joint."""
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
    """Folder of pictures of a target, one for each pose of the hand, in place of the camera's poses."""
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


@dataclass(frozen=True)
class Report:
    """Draw the figures and report.html of a finished run again.

    Example: jaxmodel report runs/quickstart-1
    """

    folder: _Positional[Path]
    """Folder of a finished run or sweep."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""


@dataclass(frozen=True)
class DataList:
    """Say which data sets are known and where they were found.

    Example: jaxmodel data list
    """

    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""


@dataclass(frozen=True)
class DataFetch:
    """Fetch the Stanford bunny scans from their public archive.

    Example: jaxmodel data fetch --to data
    """

    to: Path | None = None
    """Folder to put them in. Default: JAXMODEL_DATA, else ./data."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""


@dataclass(frozen=True)
class Data:
    """List the public data sets, or fetch them.

    Example: jaxmodel data list
    """

    action: Annotated[DataList, tyro.conf.subcommand("list")] | Annotated[DataFetch, tyro.conf.subcommand("fetch")] = (
        field(default_factory=DataList)
    )


AnyCommand = Run | Sweep | Register | Calibrate | Report | Data

_Command = (
    Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Sweep, tyro.conf.subcommand("sweep")]
    | Annotated[Register, tyro.conf.subcommand("register")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Data, tyro.conf.subcommand("data")]
)


def parse(words: list[str]) -> tuple[AnyCommand, list[tuple[str, str]]]:
    """The command and, for ``run``, the dotted overrides. Wrong usage ends the process with code 2."""
    words, changes = split_overrides(_fill_resume(words))
    command = tyro.cli(
        _Command,  # pyright: ignore[reportArgumentType]
        prog="jaxmodel",
        description="Range images in, a registered object model out.",
        args=words,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
    )
    return command, changes


_RUN_OPTIONS = ("out", "resume", "json", "help")


def split_overrides(words: list[str]) -> tuple[list[str], list[tuple[str, str]]]:
    """Take ``--a.b VALUE`` and ``--a.b=VALUE`` out of the words of ``run``: everything that is not its own option."""
    from jaxmodel.errors import InputError

    if not words or words[0] != "run":
        return words, []
    kept, changes, position = [], [], 0
    while position < len(words):
        word = words[position]
        position += 1
        name, given, value = word[2:].partition("=")
        if not word.startswith("--") or name in _RUN_OPTIONS:
            kept.append(word)
            continue
        if not given:
            if position == len(words):
                raise InputError(f"--{name}: expected a value after it")
            value = words[position]
            position += 1
        changes.append((name.replace("-", "_"), value))
    return kept, changes


def _fill_resume(words: list[str]) -> list[str]:
    """A bare ``--resume`` continues the folder given by ``--out``."""
    for position, word in enumerate(words):
        bare = position + 1 == len(words) or words[position + 1].startswith("--")
        if word == "--resume" and bare and "--out" in words[:-1]:
            out = words[words.index("--out") + 1]
            return [*words[: position + 1], out, *words[position + 1 :]]
    return words
