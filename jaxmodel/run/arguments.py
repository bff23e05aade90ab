"""The command line as types: one class a command, its fields the options, its docstring the ``--help``.

Nothing heavy is imported here, so ``--help`` answers at once.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxmodel.run.calibration.arguments import Calibrate
from jaxmodel.run.meshing.arguments import Mesh
from jaxmodel.run.planning.arguments import Plan

_Positional = tyro.conf.Positional
ControlPointsKind = Literal["subsample", "vertices", "contours", "split_vertices"]
Labels = tuple[Literal["crease", "depth", "border"], ...]


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

    With --init, ICP goes on from there. Without it the pose is searched for, and judged: the probability that it is
    right is the confidence. With a method or control points chosen but no --init, the best of 500 evenly spread starts
    is taken.

    Example: jaxmodel register bun000.ply bun045.ply --out runs/one
    """

    target: _Positional[Path]
    """Scan that stays."""
    source: _Positional[Path]
    """Scan that is moved onto it."""
    init: Path | None = None
    """First guess of T_target_source: 4 x 4 text, .npy or JSON."""
    method: str | None = None
    """A registration method, by the name of its file in configs/methods: thesis_2005 where --init is given."""
    control_points: ControlPointsKind = "subsample"
    """Points that drive the registration."""
    labels: Labels = ("crease",)
    """Which contours, with --control-points contours: crease for free forms and cylinders, all three for polyhedra."""
    count: int | None = None
    """How many control points of each scan: 2000 where they are needed."""
    seed: int = 0
    """Of every random draw."""
    out: Path | None = None
    """Folder for the results, not yet existing. Required unless --resume is given."""
    resume: Path | None = None
    """Folder of an interrupted registration to continue."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """End standard output with one line of JSON."""


@dataclass(frozen=True)
class Align:
    """Put a whole set of scans in one frame, no pose known: poses.json and merged.ply.

    Every pair is searched, the believed ones join the views, and all poses are fitted to all points at once. The frame
    is that of the first scan that could be joined.

    Example: jaxmodel align scans/*.ply --out runs/aligned
    """

    scans: _Positional[tuple[Path, ...]]
    """Scans of one object: range images or clouds (ply, pcd, obj, stl, xyz, npz, pts, osu)."""
    order: Literal["graph", "incremental", "cycle_views", "cycle_of_cycles", "tournament"] = "graph"
    """All pairs at once, or one of the thesis's orders of fusion; all points at once come last in any case."""
    truth: Path | None = None
    """True poses to be compared with: a Stanford .conf or JSON of poses."""
    seed: int = 0
    """Of every random draw."""
    out: Path | None = None
    """Folder for the results, not yet existing. Required unless --resume is given."""
    resume: Path | None = None
    """Folder of an interrupted alignment to continue."""
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


AnyCommand = Run | Sweep | Register | Align | Calibrate | Mesh | Plan | Report | Data

_Command = (
    Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Sweep, tyro.conf.subcommand("sweep")]
    | Annotated[Register, tyro.conf.subcommand("register")]
    | Annotated[Align, tyro.conf.subcommand("align")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Mesh, tyro.conf.subcommand("mesh")]
    | Annotated[Plan, tyro.conf.subcommand("plan")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Data, tyro.conf.subcommand("data")]
)


def parse(words: list[str]) -> tuple[AnyCommand, list[tuple[str, str]]]:
    """The command and, for ``run``, the dotted overrides. Wrong usage ends the process with code 2."""
    words, changes = split_overrides(_fill_resume(words))
    command = tyro.cli(
        _Command,  # pyright: ignore[reportArgumentType]
        prog="jaxmodel",
        description="Range images in, a registered and meshed object model out.",
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
