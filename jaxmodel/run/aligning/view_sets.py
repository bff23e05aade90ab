"""From the ``scans`` node of the experiment ``multiview`` to scans in memory, with their true poses where known."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.io.datasets import MeshViews, StanfordBunny
from jaxmodel.io.poses import load_scan_poses
from jaxmodel.io.scans import load_scan
from jaxmodel.run.planning.objects import load_object
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.noise import Laser, Noise
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor


@dataclass(frozen=True)
class FileSet:
    """Scan files, in any order; ``truth``: a .conf or a JSON of their poses, if known."""

    paths: tuple[str, ...]
    kind: Literal["files"] = "files"
    truth: str | None = None


@dataclass(frozen=True)
class BunnySet:
    """The ten scans of the Stanford bunny, in the order of ``bun.conf``."""

    kind: Literal["stanford_bunny"] = "stanford_bunny"


@dataclass(frozen=True)
class ObjectSet:
    """Views of one object on a turntable, every ``360 / views`` degrees, from ``elevation_deg``."""

    name: str
    kind: Literal["object"] = "object"
    views: int = 10
    elevation_deg: float = 20.0
    sensor: Sensor = field(default_factory=Sensor)
    noise: Noise | None = field(default_factory=Laser)

    def __post_init__(self) -> None:
        if not 2 <= self.views <= 360:
            raise ValueError(f"views is {self.views}, expected 2 to 360")


Sets = FileSet | BunnySet | ObjectSet


class ViewSet(NamedTuple):
    """Scans by name, in order; ``T_world_view`` their true poses, or None; ``files`` they were read from."""

    name: str
    scans: Mapping[str, RangeImage | Cloud]
    T_world_view: Float[np.ndarray, "n 4 4"] | None
    files: tuple[Path, ...]


def load_set(of: Sets, seed: int) -> ViewSet:
    """Read or make the scans; anything wrong with one is an ``InputError`` naming it."""
    if isinstance(of, FileSet):
        return _from_files(of)
    if isinstance(of, BunnySet):
        bunny = StanfordBunny()
        scans = {name: bunny.scan(name) for name in bunny.names}
        poses = np.stack([bunny.T_world_scan(name) for name in bunny.names])
        return ViewSet("bunny", scans, poses, tuple(bunny.path(name) for name in bunny.names))
    mesh = load_object(of.name)
    angles = [360.0 * k / of.views for k in range(of.views)]
    views = MeshViews(of.name, mesh, angles, of.sensor, of.noise, seed, elevation_deg=of.elevation_deg)
    poses = np.stack([views.T_world_scan(name) for name in views.names])
    return ViewSet(of.name, {name: views.scan(name) for name in views.names}, poses, ())


def _from_files(of: FileSet) -> ViewSet:
    paths = [Path(path) for path in of.paths]
    if len(paths) < 2:
        raise InputError(f"{paths[0] if paths else 'no scan'}: expected at least two scans to align, got {len(paths)}")
    name, times = Counter(path.name for path in paths).most_common(1)[0]
    if times > 1:
        raise InputError(f"{name}: {times} scans have this file name, expected a name of its own for each")
    scans = {path.name: load_scan(path) for path in paths}
    _refuse_copies(scans)
    truth = None if of.truth is None else np.stack(load_scan_poses(of.truth, paths))
    files = (*paths, *([] if of.truth is None else [Path(of.truth)]))
    return ViewSet(paths[0].stem, scans, truth, files)


def _refuse_copies(scans: dict[str, RangeImage | Cloud]) -> None:
    seen: dict[bytes, str] = {}
    for name, scan in scans.items():
        points = scan.points[scan.valid] if isinstance(scan, RangeImage) else scan.points
        key = np.ascontiguousarray(points).tobytes()
        if key in seen:
            raise InputError(f"{seen[key]} and {name} hold the same points: expected each scan once")
        seen[key] = name
