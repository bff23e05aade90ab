"""From the ``scans`` node of an experiment to pairs of scans in memory, with the true motion where it is known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from jaxmodel.io.datasets import ObjectViews, StanfordBunny
from jaxmodel.io.poses import load_truth
from jaxmodel.io.scans import load_scan
from jaxmodel.run.config import BunnyScans, ObjectScans, Scans
from jaxmodel.scan.cloud import Cloud, as_cloud
from jaxmodel.scan.objects import FREE_FORM
from jaxmodel.scan.range_image import RangeImage


@dataclass(frozen=True)
class Pair:
    """Two scans to align: ``source`` is moved onto ``target``; ``T_target_source`` is the truth, if known."""

    name: str
    family: str
    target: RangeImage | Cloud
    source: RangeImage | Cloud
    T_target_source: Float[np.ndarray, "4 4"] | None = None
    files: tuple[Path, ...] = ()


def load_pairs(scans: Scans, seed: int) -> list[Pair]:
    """Read or make every scan the node names; anything wrong with one is an ``InputError`` naming it."""
    if isinstance(scans, ObjectScans):
        return [_object_pair(name, scans, seed) for name in scans.names]
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
        )
    ]


def _object_pair(name: str, scans: ObjectScans, seed: int) -> Pair:
    views = ObjectViews(name, scans.views_deg, scans.sensor, scans.noise, seed)
    target, source = views.names
    return Pair(
        name=name,
        family="free_form" if name in FREE_FORM else "structured",
        target=views.scan(target),
        source=views.scan(source),
        T_target_source=views.T_target_source(target, source),
    )


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
