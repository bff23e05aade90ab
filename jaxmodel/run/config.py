"""The nodes of an experiment's YAML that more than one experiment can share: scans, starts, engine, claims."""

from dataclasses import dataclass, field
from typing import Literal

from jaxmodel.scan.noise import Laser, Noise
from jaxmodel.scan.sensor import Sensor

Family = Literal["structured", "free_form", "unknown"]
MOST_STARTS = 10_000_000
"""Their poses alone fill 1.3 GB; more than that is taken for a slip of the hand."""


@dataclass(frozen=True)
class ObjectScans:
    """Virtual views of each built-in object: of ``views_deg`` the first is the target, the second the source.

    Both are turned on by each of ``turns_deg``, which makes as many pairs of each object.
    """

    names: tuple[str, ...]
    kind: Literal["objects"] = "objects"
    views_deg: tuple[float, float] = (0.0, 30.0)
    turns_deg: tuple[float, ...] = (0.0,)
    sensor: Sensor = field(default_factory=Sensor)
    noise: Noise | None = field(default_factory=Laser)

    def __post_init__(self) -> None:
        _require(len(self.names) > 0, "names is empty, expected at least one object")
        _require(len(self.turns_deg) > 0, "turns_deg is empty, expected at least one angle")


@dataclass(frozen=True)
class MeshScans:
    """As ``ObjectScans``, of meshes: files, or names under ``meshes`` in ``JAXMODEL_DATA`` (fandisk, spot).

    Each is brought to unit size, its axis ``up`` becomes the turntable's.
    """

    names: tuple[str, ...]
    kind: Literal["meshes"] = "meshes"
    family: Family = "unknown"
    up: Literal["x", "y", "z"] = "y"
    views_deg: tuple[float, float] = (0.0, 30.0)
    turns_deg: tuple[float, ...] = (0.0,)
    sensor: Sensor = field(default_factory=Sensor)
    noise: Noise | None = field(default_factory=Laser)

    def __post_init__(self) -> None:
        _require(len(self.names) > 0, "names is empty, expected at least one mesh")
        _require(len(self.turns_deg) > 0, "turns_deg is empty, expected at least one angle")


@dataclass(frozen=True)
class BunnyScans:
    """Pairs of the Stanford bunny's scans, found under ``JAXMODEL_DATA``.

    ``pairs`` lists ``[target, source]`` names; ``all`` takes every pair whose true overlap, the share of one scan's
    points closer than ``overlap_distance`` (metre) to the other, is at least ``min_overlap`` both ways.
    """

    kind: Literal["stanford_bunny"] = "stanford_bunny"
    pairs: Literal["all"] | tuple[tuple[str, str], ...] = "all"
    min_overlap: float = 0.5
    overlap_distance: float = 0.0007

    def __post_init__(self) -> None:
        _require(self.pairs == "all" or len(self.pairs) > 0, "pairs is empty, expected 'all' or at least one pair")
        _require(0 <= self.min_overlap <= 1, f"min_overlap is {self.min_overlap}, expected 0 to 1")
        _require(self.overlap_distance > 0, f"overlap_distance is {self.overlap_distance}, expected above 0")


@dataclass(frozen=True)
class FileScans:
    """One pair of scan files, with the true pose in ``truth`` if it is known."""

    target: str
    source: str
    kind: Literal["files"] = "files"
    truth: str | None = None
    family: Family = "unknown"


Scans = ObjectScans | MeshScans | BunnyScans | FileScans


@dataclass(frozen=True)
class EulerStarts:
    """The thesis's grid: ``steps`` angles around each of three axes, ``steps``³ starts (half of them distinct).

    ``count`` keeps only so many of them, picked evenly along the grid.
    """

    kind: Literal["euler"] = "euler"
    steps: int = 10
    translation: Literal["centroids", "zero"] = "centroids"
    count: int | None = None

    def __post_init__(self) -> None:
        largest = round(MOST_STARTS ** (1 / 3))
        _require(1 <= self.steps <= largest, f"steps is {self.steps}, expected 1 to {largest}")
        most = self.steps**3
        _require(self.count is None or 1 <= self.count <= most, f"count is {self.count}, expected 1 to steps³ = {most}")


@dataclass(frozen=True)
class EvenStarts:
    """Starts spread evenly over all rotations, centroids brought together."""

    kind: Literal["even"] = "even"
    count: int = 1000

    def __post_init__(self) -> None:
        _require(1 <= self.count <= MOST_STARTS, f"count is {self.count}, expected 1 to {MOST_STARTS}")


@dataclass(frozen=True)
class FileStarts:
    """One start, T_target_source read from a file: 4 x 4 text, .npy or JSON."""

    path: str
    kind: Literal["file"] = "file"


Starts = EulerStarts | EvenStarts | FileStarts


@dataclass(frozen=True)
class PlausibleStarts:
    """Starts as a person would choose them by eye: the true pose, turned about a random axis and moved.

    ``spread_deg`` is the standard deviation of the normal law whose absolute value is the angle, cut at ``most_deg``;
    the translation is uniform in a ball of ``shift_of_size`` times the diagonal of the source's box.
    """

    count: int = 20
    spread_deg: float = 30.0
    most_deg: float = 90.0
    shift_of_size: float = 0.1

    def __post_init__(self) -> None:
        _require(1 <= self.count <= MOST_STARTS, f"count is {self.count}, expected 1 to {MOST_STARTS}")
        _require(self.spread_deg > 0, f"spread_deg is {self.spread_deg}, expected above 0")
        sound = self.spread_deg <= self.most_deg <= 180
        _require(sound, f"most_deg is {self.most_deg}, expected from spread_deg ({self.spread_deg}) to 180")
        _require(self.shift_of_size >= 0, f"shift_of_size is {self.shift_of_size}, expected 0 or more")


@dataclass(frozen=True)
class Execution:
    """How the starts are run. Results do not depend on ``chunk`` and ``order``, and hardly on the executor.

    ``auto`` is ``cores`` on a CPU and ``lanes`` on an accelerator.
    """

    executor: Literal["auto", "cores", "lanes"] = "auto"
    lanes: int = 256
    chunk: int = 250
    order: Literal["sequential", "shuffled"] = "sequential"

    def __post_init__(self) -> None:
        _require(self.lanes >= 1, f"lanes is {self.lanes}, expected at least 1")
        _require(self.chunk >= 1, f"chunk is {self.chunk}, expected at least 1")


@dataclass(frozen=True)
class Right:
    """When a pose counts as right: rotation within ``tolerance_deg`` and the source's centroid within a distance.

    ``tolerance`` is that distance in the unit of the data; left out, it is ``tolerance_of_size`` times the length of
    the diagonal of the source's bounding box.
    """

    tolerance_deg: float = 5.0
    tolerance: float | None = None
    tolerance_of_size: float = 0.03

    def __post_init__(self) -> None:
        _require(self.tolerance_deg > 0, f"tolerance_deg is {self.tolerance_deg}, expected above 0")
        _require(self.tolerance is None or self.tolerance > 0, f"tolerance is {self.tolerance}, expected above 0")
        _require(self.tolerance_of_size > 0, f"tolerance_of_size is {self.tolerance_of_size}, expected above 0")


@dataclass(frozen=True)
class Claims:
    """How the two claims of thesis §2.9.2 are tested; ``starts: 0`` leaves the translation test out."""

    starts: int = 200
    offset_of_size: float = 1.0
    permutations: int = 999

    def __post_init__(self) -> None:
        _require(self.starts >= 0, f"starts is {self.starts}, expected 0 or more")
        _require(self.offset_of_size > 0, f"offset_of_size is {self.offset_of_size}, expected above 0")
        _require(self.permutations >= 1, f"permutations is {self.permutations}, expected at least 1")


def _require(sound: bool, sentence: str) -> None:
    if not sound:
        raise ValueError(sentence)
