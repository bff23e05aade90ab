"""Rays through a label map: ours, thousands of views at once, against OctoMap's ``castRay``.

pyoctomap has no call for many rays, so the peer is one Python call a ray, on one core; ours uses every core. Both get
the same map (every voxel known, one OctoMap leaf a voxel before pruning) and the same rays, in cells; the peer's rays
of the first views only. Two scenes at two sizes: a room seen from within, and an object seen from around, where the
peer's rays start where they enter the map. The peer takes the quicker of its two ways, all voxels in the tree and
stopping at what is not, or only those that stop a ray. That both meet the same voxels is checked first. Last, the time
of one whole decision of ``next_view`` on the object's map.
"""

import argparse
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from paired import against_baseline, in_turn, median_ratio, seconds, spread, table

from jaxmodel.geometry.voxel_grid import VoxelGrid
from jaxmodel.plan.label_map import LabelMap, object_map, unknown_map
from jaxmodel.plan.labels import Label
from jaxmodel.scan.sensor import Sensor

SENSOR = Sensor(32, 32, field_of_view_deg=40.0)


class Scene(NamedTuple):
    """A map and views of it, ``poses (v, 4, 4)`` from sensor to world."""

    name: str
    map: LabelMap
    poses: Float[np.ndarray, "v 4 4"]


class PeerRays(NamedTuple):
    """Rays in cells, float64, from where they are in the map: one row a ray, those that meet the map."""

    origin: Float[np.ndarray, "r 3"]
    direction: Float[np.ndarray, "r 3"]
    reach: float


def room(cells: int, views: int, random: np.random.Generator) -> Scene:
    """A closed room with thirty boxes in it, seen from its empty voxels in every direction."""
    import equinox as eqx

    points = np.zeros((cells,) * 3, np.int32)
    for axis in range(3):
        np.moveaxis(points, axis, 0)[[0, -1]] = 1
    for _ in range(30):
        low = random.integers(1, cells - 2, 3)
        high = low + random.integers(1, cells // 5, 3)
        points[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = 1
    map = unknown_map(VoxelGrid(np.zeros(3), 1.0, (cells, cells, cells)))
    map = eqx.tree_at(lambda m: (m.points, m.crossed), map, (points, points == 0))
    free = np.argwhere(points == 0)
    poses = np.tile(np.eye(4), (views, 1, 1))
    turned, _ = np.linalg.qr(random.normal(size=(views, 3, 3)))
    poses[:, :3, :3] = turned * np.linalg.det(turned)[:, None, None]
    poses[:, :3, 3] = free[random.integers(0, len(free), views)] + random.random((views, 3))
    return Scene(f"room, {cells}³", map, poses)


def around(cells: int, views: int, random: np.random.Generator) -> Scene:
    """The built-in boulder after three scans, seen from a sphere around it."""
    from jaxmodel.plan.map_update import update
    from jaxmodel.scan.objects import object_mesh
    from jaxmodel.scan.virtual_scanner import look_at, scan_mesh

    mesh = object_mesh("boulder")
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    size = 2 * float(np.linalg.norm(vertices - centre, axis=1).max())
    away = random.normal(size=(views, 3))
    poses = np.stack([look_at(centre + 2 * size * e / np.linalg.norm(e), centre) for e in away])
    map = object_map(centre, size, cells)
    sensor = Sensor(4 * cells, 4 * cells, field_of_view_deg=40.0)
    for T in poses[:3]:
        map = update(map, scan_mesh(vertices, faces, sensor, T), T, sensor)
    return Scene(f"object, {cells}³", map, poses)


def peer_rays(scene: Scene, views: int) -> PeerRays:
    """The rays of the first views."""
    from jaxmodel.plan.ray_march import in_cells
    from jaxmodel.scan.sensor import pixel_rays

    items = in_cells(scene.map, scene.poses[:views]).astype(np.float64)
    rays = pixel_rays(SENSOR).directions.reshape(-1, 3)
    direction = np.einsum("vij,rj->vri", items[:, :3, :3], rays).reshape(-1, 3)
    origin = np.repeat(items[:, :3, 3], len(rays), axis=0)
    shape = np.asarray(scene.map.grid.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = -origin / direction, (shape - origin) / direction
    enters = np.maximum(np.minimum(low, high).max(axis=1), 0)
    leaves = np.maximum(low, high).min(axis=1)
    # a thousandth of a cell into the map, where its entry is certain
    start = origin + np.where(enters > 0, enters + 1e-3, 0)[:, None] * direction
    meets = enters + 2e-3 < leaves
    return PeerRays(start[meets], direction[meets], float(np.linalg.norm(shape)))


def octree(map: LabelMap, whole: bool) -> Any:
    """An OctoMap of the map, a voxel a leaf, pruned; ``whole`` with the empty ones, too."""
    from pyoctomap import OcTree  # pyright: ignore[reportMissingImports, reportAttributeAccessIssue]

    tree = OcTree(1.0)
    stops = map.labels != Label.EMPTY
    for index in np.argwhere(np.ones_like(stops) if whole else stops):
        tree.updateNode(index + 0.5, bool(stops[tuple(index)]), lazy_eval=True)
    tree.updateInnerOccupancy()
    return tree


def cast(tree: Any, rays: PeerRays, ignore_unknown: bool) -> Float[np.ndarray, "r 3"]:
    """Centre of the voxel each ray meets, NaN where it meets none: one call a ray."""
    met = np.full(rays.origin.shape, np.nan)
    end = np.zeros(3)
    for row, (origin, direction) in enumerate(zip(rays.origin, rays.direction, strict=True)):
        if tree.castRay(origin, direction, end, ignore_unknown, rays.reach):
            met[row] = end
    return met


def ours_met(scene: Scene, rays: PeerRays) -> Float[np.ndarray, "r 3"]:
    """The same with our march, ray for ray."""
    from jaxmodel.plan.ray_march import march_kernel, ready, run_views

    kernel = march_kernel(scene.map, Sensor(1, 1), ready(scene.map), keep_rays=True)
    items = np.tile(np.eye(4, dtype=np.float32), (len(rays.origin), 1, 1))
    items[:, :3, 2], items[:, :3, 3] = rays.direction, rays.origin
    _, key, _ = run_views(kernel, items)
    centres = np.stack(np.unravel_index(np.maximum(key[:, 0], 0), scene.map.grid.shape), axis=1) + 0.5
    return np.where(key >= 0, centres, np.nan)


def compared(scene: Scene, peer_views: int, runs: int) -> tuple[tuple[str, ...], float]:
    """A row of the table, and the ratio of rays a second."""
    from jaxmodel.plan.ray_march import look, ready

    rays = peer_rays(scene, peer_views)
    trees = {ignore: octree(scene.map, not ignore) for ignore in (False, True)}
    ways = {ignore: partial(cast, tree, rays, ignore) for ignore, tree in trees.items()}
    mine, theirs = ours_met(scene, rays), ways[False]()
    same = float(np.mean(np.all((mine == theirs) | (np.isnan(mine) & np.isnan(theirs)), axis=1)))
    quicker = min(ways, key=lambda ignore: seconds(ways[ignore]))
    space = ready(scene.map)
    work = {"ours": lambda: look(scene.map, scene.poses, SENSOR, space=space), "peer": ways[quicker]}
    first = seconds(work["ours"])
    taken = in_turn(work, runs)
    # rays that miss the map are quick, and the peer is not given any: ours are not counted either
    mine_rate = [len(scene.poses) * len(rays.origin) / peer_views / t / 1e6 for t in taken["ours"]]
    peer_rate = [len(rays.origin) / t / 1e6 for t in taken["peer"]]
    ratio = median_ratio(mine_rate, peer_rate)
    way = "stopping voxels alone" if quicker else "all voxels"
    row = (scene.name, spread(mine_rate), spread(peer_rate, 3), way, f"{ratio:.1f}", f"{100 * same:.3f} %")
    return (*row, f"{first:.1f}"), ratio


def decision(scene: Scene, runs: int) -> tuple[float, float]:
    """Seconds of one whole decision on a map, warm (median) and the first time, with compilation."""
    from jaxmodel.plan.next_view import next_view
    from jaxmodel.plan.viewpoints import ObservationSphere

    grid = scene.map.grid
    middle = grid.origin + grid.cell * np.array(grid.shape) / 2
    space = ObservationSphere(middle, float(np.linalg.norm(scene.poses[0, :3, 3] - middle)))
    sensor = Sensor(200, 200, field_of_view_deg=40.0)
    work = lambda: next_view(scene.map, sensor, space, taken=list(scene.poses[:3]))  # noqa: E731
    first = seconds(work)
    return float(np.median([seconds(work) for _ in range(runs)])), first


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="paired runs (default 5)")
    parser.add_argument("--views", type=int, default=4096, help="views of ours, 1024 rays each (default 4096)")
    parser.add_argument("--peer-views", type=int, default=64, help="of these, views for the peer (default 64)")
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    given = parser.parse_args()
    from jaxmodel.run.devices import prepare_devices

    cores = prepare_devices()
    rows, values = [], {}
    for make in (room, around):
        for cells in (64, 128):
            row, ratio = compared(make(cells, given.views, np.random.default_rng(0)), given.peer_views, given.runs)
            rows.append(row)
            values[f"march_vs_castray_{make.__name__}_{cells}"] = ratio
    columns = (
        "scene",
        f"ours, M rays/s, {cores} cores",
        "castRay, M rays/s",
        "its tree",
        "ratio",
        "same voxel",
        "first s",
    )
    table(f"{given.views} views of 1024 rays, one Python call a ray for castRay", columns, rows)
    warm, first = decision(around(64, 3, np.random.default_rng(0)), given.runs)
    columns = ("map", "one decision, warm, s", "first, with compilation, s")
    table("The next view by the search's defaults", columns, [("object, 64³", f"{warm:.2f}", f"{first:.1f}")])
    against_baseline(values | {"next_view_seconds_64": warm}, given.write_baseline)


if __name__ == "__main__":
    main()
