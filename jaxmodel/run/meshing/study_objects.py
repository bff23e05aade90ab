"""The clouds of the experiment ``mesh_quality``: those of thesis §3.5.2, or stand-ins, with their references.

The thesis's ``scurv``, ``halfhead`` and ``teapot`` are not public: a fusion of scans that were registered here, a
head scanned at varying density and a pot sampled on regular grids stand for them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.io.datasets import MeshViews, StanfordBunny, data_root, mesh_file
from jaxmodel.io.hoppe import read_hoppe_mesh
from jaxmodel.io.meshes import load_mesh
from jaxmodel.io.scans import load_scan
from jaxmodel.io.text_files import read_text
from jaxmodel.mesh.distance import sample_surface
from jaxmodel.run.meshing.clouds import Measured
from jaxmodel.run.meshing.registered_scans import Placed, pose_error, register_in_turn
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.regular_pot import regular_pot
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.triangle_mesh import ObjectMesh, unit_sized, upright


class Subject(NamedTuple):
    """One cloud to mesh. ``truth`` the surface it is of, where known; ``references`` label -> a mesh made elsewhere.

    ``stands_for`` is the row of Table 3.2, empty without one. ``registered`` how well the scans were, by name.
    """

    name: str
    stands_for: str
    measured: Measured
    truth: ObjectMesh | None
    references: dict[str, ObjectMesh]
    files: tuple[Path, ...]
    registered: Mapping[str, Placed] = MappingProxyType({})


@dataclass(frozen=True)
class HoppePoints:
    """A file of ``hoppe_points`` under ``JAXMODEL_DATA``, all its points or ``count`` drawn at random.

    ``meshes`` names Hoppe's own results (``cat10``: its phases 1 and 2), empty for none.
    """

    name: str
    file: str
    kind: Literal["hoppe"] = "hoppe"
    stands_for: str = ""
    count: int | None = None
    meshes: str = ""

    def __post_init__(self) -> None:
        _check_count(self.count)


@dataclass(frozen=True)
class BunnyFusion:
    """Scans of the bunny in one frame, ``count`` of their points drawn at random.

    Every pose but the first is off by a normal rotation about the scan's centroid (``rotation_deg``: standard deviation
    about each axis) and translation (``translation``: along each, metre). With ``icp`` that is where the registration
    of the scan onto those before it starts, and its own errors are those of the fusion. No ``scans``: all ten.
    """

    name: str
    kind: Literal["bunny"] = "bunny"
    stands_for: str = ""
    scans: tuple[str, ...] = ()
    count: int = 30_000
    rotation_deg: float = 0.0
    translation: float = 0.0
    icp: bool = False

    def __post_init__(self) -> None:
        _check_count(self.count)
        if self.rotation_deg < 0 or self.translation < 0:
            raise ValueError("rotation_deg and translation must not be below 0")


@dataclass(frozen=True)
class UnevenScans:
    """Scans of a mesh from around it, each with its own width in pixels: the first sees the front, most finely.

    ``count`` points are drawn at random of all. Its axis ``up`` becomes the turntable's.
    """

    name: str
    mesh: str
    kind: Literal["uneven"] = "uneven"
    stands_for: str = ""
    up: Literal["x", "y", "z"] = "y"
    views_deg: tuple[float, ...] = (0.0, 60.0, 120.0, 180.0, 240.0, 300.0)
    widths: tuple[int, ...] = (200, 80, 80, 80, 80, 80)
    elevation_deg: float = 20.0
    count: int = 8164

    def __post_init__(self) -> None:
        _check_count(self.count)
        if len(self.views_deg) != len(self.widths) or not self.widths:
            raise ValueError(f"{len(self.views_deg)} views_deg and {len(self.widths)} widths, expected as many of both")


@dataclass(frozen=True)
class RegularPot:
    """A pot with handle, spout and lid whose points lie on regular grids, about ``count`` of them."""

    name: str
    kind: Literal["pot"] = "pot"
    stands_for: str = ""
    count: int = 26_103

    def __post_init__(self) -> None:
        _check_count(self.count)


@dataclass(frozen=True)
class BuiltIn:
    """A built-in object, ``count`` points drawn evenly over its surface."""

    name: str
    object: str
    kind: Literal["object"] = "object"
    stands_for: str = ""
    count: int = 3000

    def __post_init__(self) -> None:
        _check_count(self.count)


ObjectSpec = HoppePoints | BunnyFusion | UnevenScans | RegularPot | BuiltIn


def make_subject(spec: ObjectSpec, seed: int) -> Subject:
    """The cloud of ``spec``, the same for the same seed. Raises :class:`InputError` where its files are not."""
    match spec:
        case HoppePoints():
            return _hoppe(spec, seed)
        case BunnyFusion():
            return _bunny(spec, seed)
        case UnevenScans():
            return _uneven(spec, seed)
        case RegularPot():
            points = regular_pot(spec.count)
            return Subject(spec.name, spec.stands_for, _measured(spec.name, points), None, {}, ())
        case BuiltIn():
            truth = object_mesh(spec.object)
            points = sample_surface(truth, spec.count, seed)
            return Subject(spec.name, spec.stands_for, _measured(spec.name, points), truth, {}, ())


def _hoppe(spec: HoppePoints, seed: int) -> Subject:
    folder = (data_root() or Path("data")) / "hoppe_points"
    path = folder / f"{spec.file}.pts"
    points = as_cloud(load_scan(path)).points.astype(np.float64)
    points = points[_drawn(len(points), spec.count, seed, spec.name)]
    references, files = {}, [path]
    for phase in (1, 2) if spec.meshes else ():
        file = folder / "reference_meshes" / f"{spec.meshes}.phase{phase}.hoppe_mesh"
        references[f"Hoppe, phase {phase}"] = read_hoppe_mesh(read_text(file), file)
        files.append(file)
    return Subject(spec.name, spec.stands_for, _measured(spec.name, points), None, references, tuple(files))


def _bunny(spec: BunnyFusion, seed: int) -> Subject:
    bunny = StanfordBunny()
    rng = np.random.default_rng([seed, 1])
    names = spec.scans or bunny.names
    scans, poses = [bunny.scan(name) for name in names], [bunny.T_world_scan(name) for name in names]
    registered: dict[str, Placed] = {}
    if spec.icp:
        registered = dict(
            zip(names, register_in_turn(scans, poses, spec.rotation_deg, spec.translation, rng), strict=True)
        )
        poses = [placed.T_world_scan for placed in registered.values()]
    clouds, eyes = [], []
    for number, (scan, T_world_scan) in enumerate(zip(scans, poses, strict=True)):
        cloud = as_cloud(scan).moved(T_world_scan)
        T = np.eye(4)
        if number and not spec.icp:
            T = pose_error(cloud.points.mean(axis=0), spec.rotation_deg, spec.translation, rng)
        clouds.append(cloud.moved(T))
        eyes.append(np.broadcast_to(T @ T_world_scan @ scan.eye, (len(cloud), 4)))
    measured = Measured(
        points=np.concatenate([cloud.points for cloud in clouds]).astype(np.float64),
        normals=np.concatenate([np.asarray(cloud.normals) for cloud in clouds]).astype(np.float64),
        eyes=np.concatenate(eyes),
        files=(),
        name=spec.name,
        notes=(),
    )
    references, files = {}, [bunny.folder / "bun.conf", *(bunny.path(name) for name in names)]
    zipper = bunny.folder.parent / "reconstruction" / "bun_zipper.ply"
    if zipper.is_file():
        references["Stanford, zippered"] = load_mesh(zipper)
        files.append(zipper)
    whole = _take(measured, spec.count, seed)
    return Subject(spec.name, spec.stands_for, whole, None, references, tuple(files), registered)


def _uneven(spec: UnevenScans, seed: int) -> Subject:
    file = mesh_file(spec.mesh)
    truth = unit_sized(upright(load_mesh(file), spec.up))
    points, normals, eyes = [], [], []
    for angle, width in zip(spec.views_deg, spec.widths, strict=True):
        sensor = Sensor(width=width, height=width)
        views = MeshViews(spec.name, truth, [angle], sensor, elevation_deg=spec.elevation_deg)
        scan: RangeImage = views.scan(views.names[0])
        T_world_scan = views.T_world_scan(views.names[0])
        cloud = as_cloud(scan).moved(T_world_scan)
        points.append(cloud.points)
        normals.append(np.asarray(cloud.normals))
        eyes.append(np.broadcast_to(T_world_scan @ scan.eye, (len(cloud), 4)))
    measured = Measured(
        np.concatenate(points).astype(np.float64),
        np.concatenate(normals).astype(np.float64),
        np.concatenate(eyes),
        (),
        spec.name,
        (),
    )
    return Subject(spec.name, spec.stands_for, _take(measured, spec.count, seed), truth, {}, (file,))


def _measured(name: str, points: Float[np.ndarray, "n 3"]) -> Measured:
    return Measured(points, None, None, (), name, ())


def _take(measured: Measured, count: int, seed: int) -> Measured:
    assert measured.normals is not None and measured.eyes is not None
    rows = _drawn(len(measured.points), count, seed, measured.name)
    return measured._replace(
        points=measured.points[rows], normals=measured.normals[rows], eyes=np.ascontiguousarray(measured.eyes[rows])
    )


def _drawn(have: int, count: int | None, seed: int, name: str) -> np.ndarray:
    """Rows of ``count`` points drawn at random, in their order; all without a count."""
    if count is None:
        return np.arange(have)
    if count > have:
        raise InputError(f"{name}: count is {count}, but there are only {have} points")
    return np.sort(np.random.default_rng(seed).choice(have, count, replace=False))


def _check_count(count: int | None) -> None:
    if count is not None and count < 100:
        raise ValueError(f"count is {count}, expected at least 100")
