"""Registration with no first guess on the Stanford bunny: ours beside Open3D's and KISS-Matcher's, pair by pair.

Every pair of scans whose true overlap is at least ``--least`` both ways, counted within 2 mm under the true poses (the
thesis's bunny, metre). Open3D: FPFH with RANSAC on points thinned to 1 % of the size, then point-to-plane ICP;
KISS-Matcher with voxels of 1 % of the size, then the same ICP. A pair is right within 5 degrees and 5 mm at the
source's centroid. All get whole scans; ours is timed with what it makes ready of both scans, after a first call.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from paired import table

Pose = Float[np.ndarray, "4 4"]
TURN_DEG, SHIFT, NEAR = 5.0, 0.005, 0.002


class Scan(NamedTuple):
    """A scan as read, and its points with normals."""

    image: Any
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]


def ours(target: Scan, source: Scan) -> tuple[Pose, bool]:
    """Our search, and whether it believes what it found."""
    from jaxmodel.register.search import search
    from jaxmodel.register.verdict import SearchOutcome

    found = search(target.image, source.image)
    return found.T_target_source, found.outcome is not SearchOutcome.REFUSED


def open3d_ransac(target: Scan, source: Scan) -> tuple[Pose, bool]:
    """FPFH, RANSAC on matches, point-to-plane ICP; Open3D has no verdict, so that all it finds counts as believed."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    voxel = 0.01 * _size(target)
    clouds = [_cloud(scan).voxel_down_sample(voxel) for scan in (source, target)]
    around = o3d.geometry.KDTreeSearchParamHybrid(radius=5 * voxel, max_nn=100)
    features = [registration.compute_fpfh_feature(cloud, around) for cloud in clouds]
    o3d.utility.random.seed(0)
    found = registration.registration_ransac_based_on_feature_matching(
        *clouds, *features, True, 1.5 * voxel, registration.TransformationEstimationPointToPoint(False), 3,
        [registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
         registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel)],
        registration.RANSACConvergenceCriteria(100_000, 0.999),
    )  # fmt: skip
    return _icp(target, source, np.asarray(found.transformation)), True


def kiss_matcher(target: Scan, source: Scan) -> tuple[Pose, bool]:
    """KISS-Matcher, then the same ICP; its ``valid`` is its verdict."""
    kiss: Any = import_module("kiss_matcher")
    matcher = kiss.KISSMatcher(kiss.KISSMatcherConfig(0.01 * _size(target)))
    clouds = [list(scan.points.astype(np.float32)) for scan in (source, target)]
    found = matcher.estimate(*clouds)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.asarray(found.rotation), np.asarray(found.translation).ravel()
    return _icp(target, source, T), bool(found.valid)


METHODS: dict[str, Callable[[Scan, Scan], tuple[Pose, bool]]] = {
    "ours": ours,
    "Open3D FPFH + RANSAC + ICP": open3d_ransac,
    "KISS-Matcher + ICP": kiss_matcher,
}


def main(words: Sequence[str] | None = None) -> None:
    """Run and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--least", type=float, default=0.15, help="overlap both ways")
    arguments = parser.parse_args(words)
    from jaxmodel.io.datasets import StanfordBunny
    from jaxmodel.scan.cloud import as_cloud

    bunny = StanfordBunny()
    scans = {}
    for name in bunny.names:
        image = bunny.scan(name)
        cloud = as_cloud(image)
        assert cloud.normals is not None
        scans[name] = Scan(image, np.asarray(cloud.points, float), np.asarray(cloud.normals, float))
    shared = _shared(bunny, scans)
    pairs = [pair for pair, share in shared.items() if share >= arguments.least]
    apart = [pair for pair, share in shared.items() if share == 0]
    first = pairs[0]
    for method in METHODS.values():
        method(scans[first[0]], scans[first[1]])  # compiled, loaded
    rows, right, seconds, refused = (
        [],
        dict.fromkeys(METHODS, 0),
        {name: [] for name in METHODS},
        dict.fromkeys(METHODS, 0),
    )
    for target, source in pairs:
        row = [f"{target}, {source}", f"{100 * shared[target, source]:.0f} %"]
        for name, method in METHODS.items():
            begun = time.perf_counter()
            T, _ = method(scans[target], scans[source])
            seconds[name].append(time.perf_counter() - begun)
            turn, shift = _error(T, bunny.T_target_source(target, source), scans[source].points.mean(axis=0))
            good = turn < TURN_DEG and shift < SHIFT
            right[name] += good
            row.append(f"{turn:.2f}, {1000 * shift:.2f}" + ("" if good else " WRONG"))
        rows.append(row)
    for target, source in apart:
        for name, method in METHODS.items():
            refused[name] += not method(scans[target], scans[source])[1]
    table("Pairs", ["pair", "overlap", *(f"{name}: degrees, mm" for name in METHODS)], rows)
    ratio = {
        name: statistics.median(a / b for a, b in zip(seconds[name], seconds["ours"], strict=True)) for name in METHODS
    }
    told = [
        [name, f"{right[name]} of {len(pairs)}", f"{refused[name]} of {len(apart)}",
         f"{statistics.median(seconds[name]):.2f} ({max(seconds[name]):.2f})", f"{ratio[name]:.2f}"]
        for name in METHODS
    ]  # fmt: skip
    columns = ["method", "right", "without overlap: refused", "seconds, median (longest)", "times ours, median"]
    table("Methods", columns, told)


def _shared(bunny: Any, scans: dict[str, Scan]) -> dict[tuple[str, str], float]:
    """The smaller share of each pair within 2 mm of the other, under the true poses."""
    from scipy.spatial import KDTree

    world = {}
    for name, scan in scans.items():
        T = bunny.T_world_scan(name)
        world[name] = scan.points @ T[:3, :3].T + T[:3, 3]
    trees = {name: KDTree(points) for name, points in world.items()}

    def share(a: str, b: str) -> float:
        return float(np.isfinite(trees[b].query(world[a], distance_upper_bound=NEAR)[0]).mean())

    names = list(scans)
    return {(a, b): min(share(a, b), share(b, a)) for i, a in enumerate(names) for b in names[i + 1 :]}


def _error(T: Pose, true: Pose, centroid: Float[np.ndarray, "3"]) -> tuple[float, float]:
    from jaxmodel.geometry.se3 import rotation_angle_deg

    shift = (T - true)[:3] @ np.append(centroid, 1)
    return float(rotation_angle_deg(T[:3, :3].T @ true[:3, :3])), float(np.linalg.norm(shift))


def _icp(target: Scan, source: Scan, T: Pose) -> Pose:
    import open3d as o3d

    registration = o3d.pipelines.registration
    for reach in (0.02 * _size(target), 0.006 * _size(target)):
        T = np.asarray(
            registration.registration_icp(
                _cloud(source), _cloud(target), reach, T, registration.TransformationEstimationPointToPlane(),
                registration.ICPConvergenceCriteria(max_iteration=50),
            ).transformation
        )  # fmt: skip
    return T


def _cloud(scan: Scan) -> Any:
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan.points))
    cloud.normals = o3d.utility.Vector3dVector(scan.normals)
    return cloud


def _size(scan: Scan) -> float:
    return float(np.linalg.norm(np.ptp(scan.points, axis=0)))


if __name__ == "__main__":
    from jaxmodel.run.devices import prepare_devices

    prepare_devices()
    main()
