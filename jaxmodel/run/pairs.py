"""From the ``scans`` node of an experiment to pairs of scans in memory, with the true motion where it is known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.geometry.se3 import inverse
from jaxmodel.io.datasets import MeshViews, StanfordBunny, mesh_file
from jaxmodel.io.meshes import load_mesh
from jaxmodel.io.poses import load_truth
from jaxmodel.io.scans import load_scan
from jaxmodel.run.config import BunnyScans, MeshScans, ObjectScans, Scans
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.known_solids import KNOWN_SOLIDS
from jaxmodel.scan.objects import FREE_FORM, OBJECTS, object_mesh
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.triangle_mesh import ObjectMesh, unit_sized, upright


@dataclass(frozen=True)
class Pair:
    """Two scans to align: ``source`` is moved onto ``target``; ``T_target_source`` is the truth, if known.

    ``subject`` is what both show; several pairs may show the same. ``solid``: its surface in the target's frame, where
    the scans are made from it.
    """

    name: str
    family: str
    target: RangeImage | Cloud
    source: RangeImage | Cloud
    T_target_source: Float[np.ndarray, "4 4"] | None = None
    files: tuple[Path, ...] = ()
    subject: str = ""
    solid: ObjectMesh | None = None


def load_pairs(scans: Scans, seed: int) -> list[Pair]:
    """Read or make every scan the node names; anything wrong with one is an ``InputError`` naming it."""
    if isinstance(scans, ObjectScans):
        return [pair for name in scans.names for pair in _object_pairs(name, scans, seed)]
    if isinstance(scans, MeshScans):
        return [pair for name in scans.names for pair in _mesh_pairs(name, scans, seed)]
    if isinstance(scans, BunnyScans):
        return _bunny_pairs(scans)
    target, source = Path(scans.target), Path(scans.source)
    truth = load_truth(scans.truth, target, source) if scans.truth is not None else None
    return [
        Pair(
            name=f"{target.stem}-{source.stem}",
            family=scans.family,
            target=load_scan(target),
            source=load_scan(source),
            T_target_source=truth,
            files=(target, source, *([Path(scans.truth)] if scans.truth is not None else [])),
            subject=target.stem,
        )
    ]


def source_extent(pair: Pair) -> tuple[Float[np.ndarray, "3"], float]:
    """Mean of all the source's points (its frame), and the diagonal of their bounding box: centroid and size."""
    scan = pair.source
    points = scan.points[scan.valid] if isinstance(scan, RangeImage) else scan.points
    return points.mean(axis=0, dtype=np.float64), float(np.linalg.norm(np.ptp(points, axis=0)))


def _object_pairs(name: str, scans: ObjectScans, seed: int) -> list[Pair]:
    solid = KNOWN_SOLIDS[name]() if name in KNOWN_SOLIDS and name not in OBJECTS else object_mesh(name)
    views = MeshViews(name, solid, _angles(scans), scans.sensor, scans.noise, seed)
    return _turned_pairs(name, "free_form" if name in FREE_FORM else "structured", views, scans, ())


def _mesh_pairs(name: str, scans: MeshScans, seed: int) -> list[Pair]:
    path = mesh_file(name)
    mesh = unit_sized(upright(load_mesh(path), scans.up))
    views = MeshViews(path.stem, mesh, _angles(scans), scans.sensor, scans.noise, seed)
    return _turned_pairs(path.stem, scans.family, views, scans, (path,))


def _angles(scans: ObjectScans | MeshScans) -> list[float]:
    """Every view's angle once, but both of a pair of equal ones, to be refused by name."""
    if len({view % 360 for view in scans.views_deg}) < 2:
        return [scans.views_deg[0]] * 2
    return list(dict.fromkeys((view + turn) % 360 for turn in scans.turns_deg for view in scans.views_deg))


def _turned_pairs(
    subject: str, family: str, views: MeshViews, scans: ObjectScans | MeshScans, files: tuple[Path, ...]
) -> list[Pair]:
    named = dict(zip(_angles(scans), views.names, strict=True))
    images = {name: views.scan(name) for name in views.names}
    pairs = []
    for turn in dict.fromkeys(scans.turns_deg):
        target, source = (named[(view + turn) % 360] for view in scans.views_deg)
        pairs.append(
            Pair(
                name=subject if scans.turns_deg == (0.0,) else f"{target}-{source.removeprefix(subject)}",
                family=family,
                target=images[target],
                source=images[source],
                T_target_source=views.T_target_source(target, source),
                files=files,
                subject=subject,
                solid=_moved(views.mesh, inverse(views.T_world_scan(target))),
            )
        )
    return pairs


def _bunny_pairs(scans: BunnyScans) -> list[Pair]:
    bunny = StanfordBunny()
    chosen = scans.pairs
    if chosen == "all":
        chosen = _overlapping(bunny, scans.min_overlap, scans.overlap_distance)
    images = {name: bunny.scan(name) for name in dict.fromkeys(name for pair in chosen for name in pair)}
    return [
        Pair(
            name=f"{target}-{source}",
            family="free_form",
            target=images[target],
            source=images[source],
            T_target_source=bunny.T_target_source(target, source),
            files=(bunny.path(target), bunny.path(source), bunny.folder / "bun.conf"),
            subject="bunny",
        )
        for target, source in chosen
    ]


def _overlapping(bunny: StanfordBunny, least: float, distance: float) -> tuple[tuple[str, str], ...]:
    from scipy.spatial import KDTree

    world = {}
    for name in bunny.names:
        T = bunny.T_world_scan(name)
        world[name] = as_cloud(bunny.scan(name)).points @ T[:3, :3].T + T[:3, 3]
    trees = {name: KDTree(points) for name, points in world.items()}

    def covered(a: str, b: str) -> float:
        near: Bool[np.ndarray, " n"] = np.isfinite(trees[b].query(world[a], distance_upper_bound=distance)[0])
        return float(near.mean())

    names = bunny.names
    return tuple(
        (a, b) for i, a in enumerate(names) for b in names[i + 1 :] if covered(a, b) >= least and covered(b, a) >= least
    )


def _moved(mesh: ObjectMesh, T: Float[np.ndarray, "4 4"]) -> ObjectMesh:
    return ObjectMesh(mesh.vertices @ T[:3, :3].T + T[:3, 3], mesh.faces)
