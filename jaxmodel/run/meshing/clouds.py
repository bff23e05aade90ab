"""The clouds of a mesh, read, posed and put together: points, their normals and where they were seen from."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.io.oriented import load_oriented
from jaxmodel.io.poses import check_conf, load_scan_poses
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.range_image import RangeImage


class Measured(NamedTuple):
    """``points (n, 3)`` in one frame, unit of the data; ``normals`` None unless every file gave them.

    ``eyes`` homogeneous sensor position of each point, None unless every file was a range image. ``files`` are all that
    was read; ``name`` calls them in sentences; ``notes`` say what was left aside.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"] | None
    eyes: Float[np.ndarray, "n 4"] | None
    files: tuple[Path, ...]
    name: str
    notes: tuple[str, ...]


def read_clouds(files: Sequence[Path], poses: Path | None) -> Measured:
    """All points of ``files``, each moved by its pose of the file ``poses``; units untouched.

    Without ``files`` a ``.conf`` gives them. Raises :class:`InputError`: several files without poses, a scan without
    one, or whatever :func:`load_oriented` finds wrong.
    """
    if not files:
        if poses is None:
            raise InputError("No cloud is given: expected a file of points, or --poses FILE.conf that names the scans")
        if poses.suffix.lower() != ".conf":
            raise InputError(f"{poses}: only a .conf says where its scans lie; name the files of the scans too")
        files = list(check_conf(poses).values())
    if poses is None and len(files) > 1:
        raise InputError(f"{len(files)} clouds need --poses FILE, which says where each stood ({files[0]} and others)")
    placed = [np.eye(4)] if poses is None else load_scan_poses(poses, files)
    scans = [load_oriented(file) for file in files]
    clouds = [
        as_cloud(scan, str(file)).moved(T_world_scan)
        for scan, file, T_world_scan in zip(scans, files, placed, strict=True)
    ]
    return Measured(
        points=np.concatenate([cloud.points for cloud in clouds]).astype(np.float64),
        normals=_normals(clouds),
        eyes=_eyes(scans, clouds, placed),
        files=(*files, *([] if poses is None else [poses])),
        name=str(files[0]) if len(files) == 1 else f"{files[0]} and {len(files) - 1} more",
        notes=_notes(scans, clouds),
    )


def _normals(clouds: Sequence[Cloud]) -> Float[np.ndarray, "n 3"] | None:
    given = [cloud.normals for cloud in clouds if cloud.normals is not None]
    return np.concatenate(given).astype(np.float64) if len(given) == len(clouds) else None


def _eyes(
    scans: Sequence[RangeImage | Cloud], clouds: Sequence[Cloud], placed: Sequence[Float[np.ndarray, "4 4"]]
) -> Float[np.ndarray, "n 4"] | None:
    eyes = [
        np.broadcast_to(T_world_scan @ scan.eye, (len(cloud), 4))
        for scan, cloud, T_world_scan in zip(scans, clouds, placed, strict=True)
        if isinstance(scan, RangeImage)
    ]
    return np.concatenate(eyes) if len(eyes) == len(scans) else None


def _notes(scans: Sequence[RangeImage | Cloud], clouds: Sequence[Cloud]) -> tuple[str, ...]:
    notes = []
    without = sum(cloud.normals is None for cloud in clouds)
    if 0 < without < len(clouds):
        notes.append(f"{without} of {len(clouds)} files have no normals: all were estimated anew")
    images = sum(isinstance(scan, RangeImage) for scan in scans)
    if 0 < images < len(scans):
        notes.append(f"{len(scans) - images} of {len(scans)} files are no range images: no sensor positions were used")
    return tuple(notes)
