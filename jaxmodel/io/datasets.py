"""Where views come from, one class a source, all with the same four members.

``names``; ``scan(name)``; ``T_world_scan(name)``; ``T_target_source(target, source)``, the true relative pose; and
``has_truth``, whether the last two are known.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.io.meshes import MESH_SUFFIXES
from jaxmodel.io.poses import check_conf, load_truth, read_conf, relative_pose
from jaxmodel.io.scans import load_scan
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.noise import Noise
from jaxmodel.scan.objects import ObjectMesh, object_mesh
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor
from jaxmodel.scan.virtual_scanner import scan_mesh, turntable_poses


def data_root() -> Path | None:
    """The folder of real data sets: the environment variable JAXMODEL_DATA, else ``../shared/data`` if there is one.

    The second is looked for beside the working directory and beside the project. Raises :class:`InputError` when
    JAXMODEL_DATA is set and is not a folder.
    """
    named = os.environ.get("JAXMODEL_DATA")
    if named:
        if not Path(named).is_dir():
            raise InputError(f"JAXMODEL_DATA is {named!r}, which is not a folder.")
        return Path(named)
    for start in (Path.cwd(), Path(__file__).resolve().parents[2]):
        candidate = start.parent / "shared" / "data"
        if candidate.is_dir():
            return candidate
    return None


class StanfordBunny:
    """The ten Cyberware scans of the Stanford bunny (metre) and the poses of ``bun.conf``.

    ``root`` is the data folder (holding ``stanford_bunny/data``), that folder itself, or None for
    :func:`data_root`. The poses come from a registration: agreement well below 0.1 mm means nothing.
    """

    def __init__(self, root: str | Path | None = None):
        base = Path(root) if root is not None else data_root()
        candidates = [] if base is None else [base / "stanford_bunny" / "data", base / "data", base]
        found = [folder for folder in candidates if (folder / "bun.conf").is_file()]
        if not found:
            raise InputError(
                f"The Stanford bunny scans are not under {base or 'any known folder'}: set JAXMODEL_DATA to the folder "
                "that holds stanford_bunny/data/bun.conf."
            )
        self.folder = found[0]
        self._poses = read_conf(self.folder / "bun.conf")
        self._files = check_conf(self.folder / "bun.conf")

    has_truth = True

    @property
    def names(self) -> tuple[str, ...]:
        """Scan names in the order of ``bun.conf``."""
        return tuple(self._poses)

    def path(self, name: str) -> Path:
        """The file of a scan."""
        return self._files[self._known(name)]

    def scan(self, name: str) -> RangeImage:
        """The range image of a scan, in its scanner's frame, metre."""
        image = load_scan(self.path(name))
        if not isinstance(image, RangeImage):
            raise InputError(f"{self.path(name)}: expected a PLY file with a range_grid.")
        return image

    def T_world_scan(self, name: str) -> Float[np.ndarray, "4 4"]:
        """Pose of a scan in the frame of the published reconstruction."""
        return self._poses[self._known(name)]

    def T_target_source(self, target: str, source: str) -> Float[np.ndarray, "4 4"]:
        """True pose of scan ``source`` in the frame of scan ``target``."""
        return relative_pose(self.T_world_scan(target), self.T_world_scan(source))

    def _known(self, name: str) -> str:
        if name not in self._poses:
            raise InputError(f"There is no bunny scan {name!r}; there are {', '.join(self._poses)}.")
        return name


class MeshViews:
    """Range images of a triangle mesh on a turntable, made when asked for.

    View i looks from angle ``views_deg[i]`` around z at ``elevation_deg``, from ``distance`` (unit of the mesh). Each
    scan is in its sensor's frame; the world frame is the mesh's. View i draws its noise with ``fold_in(key(seed), i)``,
    so it is the same alone or among others. Names are ``name`` followed by the angle: ``boulder045``.
    """

    def __init__(
        self,
        name: str,
        mesh: ObjectMesh,
        views_deg: Sequence[float | int],
        sensor: Sensor | None = None,
        noise: Noise | None = None,
        seed: int = 0,
        distance: float | int = 3.0,
        elevation_deg: float | int = 20.0,
    ):
        self.mesh = mesh
        self.sensor = Sensor() if sensor is None else sensor
        self.noise = noise
        self.seed = seed
        self._poses = {}
        for angle, pose in zip(views_deg, turntable_poses(views_deg, distance, elevation_deg), strict=True):
            view = f"{name}{angle:03g}"
            if view in self._poses:
                raise InputError(f"views_deg: the angle {angle:g} is given twice.")
            self._poses[view] = pose
        if not self._poses:
            raise InputError("views_deg: expected at least one angle.")

    has_truth = True

    @property
    def names(self) -> tuple[str, ...]:
        """View names in the order of ``views_deg``."""
        return tuple(self._poses)

    def scan(self, name: str) -> RangeImage:
        """The range image of a view, in its sensor's frame, unit of the mesh."""
        pose = self.T_world_scan(name)
        key = jax.random.fold_in(jax.random.key(self.seed), self.names.index(name))
        return scan_mesh(self.mesh.vertices, self.mesh.faces, self.sensor, pose, self.noise, key)

    def T_world_scan(self, name: str) -> Float[np.ndarray, "4 4"]:
        """The sensor's pose in the mesh's frame."""
        if name not in self._poses:
            raise InputError(f"There is no view {name!r}; there are {', '.join(self._poses)}.")
        return self._poses[name]

    def T_target_source(self, target: str, source: str) -> Float[np.ndarray, "4 4"]:
        """True pose of view ``source`` in the frame of view ``target``."""
        return relative_pose(self.T_world_scan(target), self.T_world_scan(source))


class ObjectViews(MeshViews):
    """:class:`MeshViews` of a built-in object (:mod:`jaxmodel.scan.objects`), in object units."""

    def __init__(
        self,
        name: str,
        views_deg: Sequence[float | int] = (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0),
        sensor: Sensor | None = None,
        noise: Noise | None = None,
        seed: int = 0,
        distance: float | int = 3.0,
        elevation_deg: float | int = 20.0,
    ):
        super().__init__(name, object_mesh(name), views_deg, sensor, noise, seed, distance, elevation_deg)
        self.object = name


def mesh_file(name: str | Path) -> Path:
    """The file of a mesh: a path, or a name under ``meshes`` in the data folder (``fandisk``).

    Raises :class:`InputError` when there is neither, listing the names there are.
    """
    given = Path(name)
    if given.is_file():
        return given
    root = data_root()
    folder = None if root is None else root / "meshes"
    found = {path.stem: path for path in sorted(folder.glob("*")) if path.suffix in MESH_SUFFIXES} if folder else {}
    if str(name) in found:
        return found[str(name)]
    there = f"there are {', '.join(found)}" if found else "and no meshes were found, set JAXMODEL_DATA"
    raise InputError(f"There is no mesh file {str(name)!r}, nor one of that name in the data folder; {there}.")


class FilePair:
    """Two scan files of the user, with or without a truth file (see :func:`jaxmodel.io.poses.load_truth`).

    ``names`` are the files' stems, or their paths where the stems are the same. The world frame is the target's.
    """

    def __init__(self, target: str | Path, source: str | Path, truth: str | Path | None = None):
        target, source = Path(target), Path(source)
        names = (target.stem, source.stem) if target.stem != source.stem else (str(target), str(source))
        if names[0] == names[1]:
            raise InputError(f"Target and source are the same file, {target}.")
        self.names: tuple[str, ...] = names
        self._files = dict(zip(names, (target, source), strict=True))
        for file in self._files.values():
            if not file.exists():
                raise InputError(f"There is no file {file}.")
        self._truth = None if truth is None else load_truth(truth, target, source)

    @property
    def has_truth(self) -> bool:
        """Whether a truth file was given; without one :meth:`T_world_scan` raises :class:`InputError`."""
        return self._truth is not None

    def scan(self, name: str) -> RangeImage | Cloud:
        """The scan in a file, in its own frame and unit."""
        if name not in self._files:
            raise InputError(f"There is no scan {name!r}; there are {', '.join(self.names)}.")
        return load_scan(self._files[name])

    def T_world_scan(self, name: str) -> Float[np.ndarray, "4 4"]:
        """Pose of a scan in the target's frame: the identity for the target."""
        if name not in self._files:
            raise InputError(f"There is no scan {name!r}; there are {', '.join(self.names)}.")
        if self._truth is None:
            raise InputError(f"No truth file was given for {' and '.join(self.names)}.")
        return np.eye(4) if name == self.names[0] else self._truth

    def T_target_source(self, target: str, source: str) -> Float[np.ndarray, "4 4"]:
        """True pose of scan ``source`` in the frame of scan ``target``."""
        return relative_pose(self.T_world_scan(target), self.T_world_scan(source))
