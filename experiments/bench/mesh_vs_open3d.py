"""Ball pivoting of the whole bunny: ours, thinned and segmented, against Open3D's bare pivoting with three radii.

Both get the raw cloud of ten scans posed by the truth (362 272 points) with the normals of the range images; Open3D
neither thins nor segments. Its radii are given in millimetres: what it leaves depends on them, and so does its time,
from seconds to minutes, so that each choice is a contender of its own. Beside the seconds stand the measures of the
mesh and its mean distance to the reference reconstruction, both ways. Without the data folder the cloud is 362 272
noisy points of a torus.
"""

import argparse
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from paired import against_baseline, in_turn, median_ratio, seconds, spread, table

from jaxmodel.mesh import Quality, ball_pivoting, quality, segment
from jaxmodel.mesh.adjacency import adjacency, face_components
from jaxmodel.mesh.distance import surface_distance
from jaxmodel.scan.triangle_mesh import ObjectMesh, ring

POINTS = 362_272
RADII_MM = ("0.5,1,2", "0.8,1.2,2")
"""Coarser and finer choices take Open3D minutes on this cloud."""


class Scene(NamedTuple):
    """``eyes`` homogeneous sensor positions, None without sensors; ``unit`` of the points in millimetres."""

    name: str
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    eyes: Float[np.ndarray, "n 4"] | None
    reference: ObjectMesh
    unit: float


def load_scene() -> Scene:
    """The bunny where the data folder is there, else a torus of 150 mm."""
    from jaxmodel.io.datasets import StanfordBunny, data_root
    from jaxmodel.io.meshes import load_mesh
    from jaxmodel.scan.range_image import to_cloud

    root = data_root()
    if root is None or not (root / "stanford_bunny" / "data" / "bun.conf").is_file():
        return _torus()
    bunny = StanfordBunny(root)
    points, normals, eyes = [], [], []
    for name in bunny.names:
        image, T_world_scan = bunny.scan(name), bunny.T_world_scan(name)
        cloud = to_cloud(image).moved(T_world_scan)
        points.append(np.asarray(cloud.points, np.float64))
        normals.append(np.asarray(cloud.normals, np.float64))
        eyes.append(np.tile(T_world_scan @ image.eye, (len(cloud), 1)))
    reference = load_mesh(Path(root) / "stanford_bunny" / "reconstruction" / "bun_zipper.ply")
    whole = np.concatenate(points), np.concatenate(normals), np.concatenate(eyes)
    return Scene("bunny", *whole, reference, 1000.0)


def _torus() -> Scene:
    random = np.random.default_rng(0)
    u, v = 2 * np.pi * random.random((2, POINTS))
    normals = np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=1)
    points = 50 * np.stack([np.cos(u), np.sin(u), 0 * u], axis=1) + 20 * normals
    points += 0.05 * random.normal(size=points.shape)
    return Scene("torus", points, normals, None, ring(50, 20, 400, 160), 1.0)


def ours(scene: Scene) -> ObjectMesh:
    """Thinning, pivoting, closing and segmentation."""
    return segment(ball_pivoting(scene.points, scene.normals, eyes=scene.eyes).mesh, snapping=False).mesh


def pivoting_alone(scene: Scene) -> ObjectMesh:
    """Thinning, pivoting and closing."""
    return ball_pivoting(scene.points, scene.normals, eyes=scene.eyes).mesh


def open3d_pivoting(scene: Scene, radii_mm: str) -> ObjectMesh:
    """Open3D's pivoting of the raw cloud."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scene.points))
    cloud.normals = o3d.utility.Vector3dVector(scene.normals)
    radii = o3d.utility.DoubleVector([float(radius) / scene.unit for radius in radii_mm.split(",")])
    found = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(cloud, radii)
    return ObjectMesh(np.asarray(found.vertices), np.asarray(found.triangles).astype(np.int64))


def measures(scene: Scene, mesh: ObjectMesh) -> tuple[str, ...]:
    """A row's cells after the time."""
    found: Quality = quality(mesh)
    apart = surface_distance(mesh, scene.reference)
    return (
        f"{found.triangles}",
        f"{face_components(len(mesh.faces), adjacency(mesh.faces).pairs)[0]}",
        f"{found.border_edges}",
        f"{found.border_length * scene.unit:.0f}",
        f"{found.area / quality(scene.reference).area:.4f}",
        f"{apart.there.mean * scene.unit:.4f}, {apart.back.mean * scene.unit:.4f}",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="paired runs (default 3)")
    parser.add_argument("--radii-mm", nargs="+", default=list(RADII_MM), help="Open3D's radii, as 0.5,1,2 each")
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    given = parser.parse_args()
    scene = load_scene()
    work = {
        "ours, thinned and segmented": partial(ours, scene),
        "ours without segmentation": partial(pivoting_alone, scene),
    }
    work |= {f"Open3D, {radii} mm": partial(open3d_pivoting, scene, radii) for radii in given.radii_mm}
    print(f"{scene.name}: {len(scene.points)} points")
    few = scene._replace(
        points=scene.points[::20],
        normals=scene.normals[::20],
        eyes=None if scene.eyes is None else scene.eyes[::20],
    )
    print(f"first call, on every twentieth point: {seconds(partial(ours, few)):.1f} s")
    meshes = {name: run() for name, run in work.items()}
    taken = in_turn(work, given.runs)
    rows = [(name, spread(times, 1), *measures(scene, meshes[name])) for name, times in taken.items()]
    columns = ("what", "seconds", "triangles", "parts", "border edges", "border mm", "area", "mean distance mm")
    table("Meshes of the raw cloud", columns, rows)
    mine = taken["ours, thinned and segmented"]
    values = {
        f"mesh_vs_open3d_{radii.replace(',', '_').replace('.', '')}": median_ratio(taken[f"Open3D, {radii} mm"], mine)
        for radii in RADII_MM
        if radii in given.radii_mm
    }
    if scene.name == "bunny":
        against_baseline(values, given.write_baseline)


if __name__ == "__main__":
    main()
