"""Plain point-to-point ICP from 1000 starts: ours against small_gicp and Open3D, same points, starts and limits.

All get the same two sets of random points, the same starts, the same distance limit and at most 100 iterations. Ours
and small_gicp stop when a step turns by less than 6e-4 rad and moves by less than the pair's length. Open3D has no such
rule: it stops when fitness and inlier RMSE both change by less than a relative 1e-6 in a step.

small_gicp is used in two ways: one align call after another with 2 threads each, and, since that leaves most of the
time to its threads' coordination, as many processes as cores with one thread each. Open3D uses its own threads.
Compilation and the building of the voxel table are reported apart; the second ratio counts the table.
"""

import argparse
import dataclasses
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from paired import Pair, against_baseline, in_turn, is_right, load_pair, median_ratio, seconds, spread, table

TURN = 6e-4  # rad
MOST_ITERATIONS = 100
Starts = Float[np.ndarray, "s 4 4"]


class Ours:
    """The sweep taken apart: ``prepare`` builds the table, ``run`` does the starts, ``whole`` is both."""

    def __init__(self, pair: Pair, starts: Starts, method: Any) -> None:
        from jaxmodel.lanes import Engine

        self.pair, self.starts, self.method = pair, starts, method
        self.engine = Engine("cores", chunk=250)
        self.prepare()

    def prepare(self) -> None:
        from jaxmodel.register.icp import Icp, Pose
        from jaxmodel.register.problem import prepare

        problem, self.frames = prepare(self.pair.target, self.pair.source, self.method)
        self.kernel, self.poses = Icp(problem, self.method), Pose(*self.frames.to_centred(self.starts))

    def compile(self) -> None:
        """The same program on two starts: hardly more than its compilation when called first."""
        from jaxmodel.lanes import run
        from jaxmodel.register.icp import Pose

        run(self.kernel, Pose(self.poses.rotation[:2], self.poses.translation[:2]), self.engine)

    def run(self) -> Starts:
        from jaxmodel.lanes import run

        result = run(self.kernel, self.poses, self.engine)
        self.steps = float(np.mean(result.steps))
        return self.frames.from_centred(result.pose.rotation, result.pose.translation)

    def whole(self) -> Starts:
        from jaxmodel.register import sweep

        return sweep(self.pair.target, self.pair.source, self.starts, self.method, engine=self.engine).T_target_source


def plain_method(pair: Pair) -> Any:
    """``point_to_point`` with the pair's limits, which the method counts in sizes of the target."""
    from jaxmodel.register import methods

    size = float(np.linalg.norm(np.ptp(pair.target, axis=0)))
    return dataclasses.replace(
        methods.named("point_to_point"),
        max_distance=pair.limit / size,
        rotation_tolerance_deg=float(np.degrees(TURN)),
        translation_tolerance=pair.move / size,
        max_iterations=MOST_ITERATIONS,
    )


def small_gicp_poses(pair: Pair, threads: int, starts: Starts) -> Starts:
    """One ``align`` per start; cloud and tree are made once."""
    import small_gicp  # pyright: ignore[reportMissingImports]

    cloud, moving = small_gicp.PointCloud(pair.target), small_gicp.PointCloud(pair.source)
    tree = small_gicp.KdTree(cloud, num_threads=threads)
    poses = [
        small_gicp.align(
            cloud,
            moving,
            tree,
            start,
            registration_type="ICP",
            max_correspondence_distance=pair.limit,
            num_threads=threads,
            max_iterations=MOST_ITERATIONS,
            rotation_epsilon=TURN,
            translation_epsilon=pair.move,
        ).T_target_source
        for start in starts
    ]
    return np.array(poses)


def open3d_poses(pair: Pair, starts: Starts) -> Starts:
    """One ``registration_icp`` per start; the call builds its own tree."""
    import open3d

    registration = open3d.pipelines.registration
    cloud, moving = (
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points)) for points in (pair.target, pair.source)
    )
    rule = registration.ICPConvergenceCriteria(1e-6, 1e-6, MOST_ITERATIONS)
    plain = registration.TransformationEstimationPointToPoint(False)
    poses = [registration.registration_icp(moving, cloud, pair.limit, T, plain, rule).transformation for T in starts]
    return np.array(poses)


def spread_over(pool: Any, count: int, pair: Pair, starts: Starts) -> Starts:
    """The starts dealt out to ``count`` processes, one thread each."""
    parts = pool.map(partial(small_gicp_poses, pair, 1), [starts[worker::count] for worker in range(count)])
    poses = np.empty_like(starts)
    for worker, part in enumerate(parts):
        poses[worker::count] = part
    return poses


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="paired runs (default 5)")
    parser.add_argument("--points", type=int, default=2000, help="random points of each view (default 2000)")
    parser.add_argument("--starts", type=int, default=1000, help="of the 1000 Euler starts, drawn at random")
    parser.add_argument(
        "--peer-starts",
        type=int,
        default=1000,
        help="starts given to the peers, drawn at random; rates are per start, so fewer than all is an estimate",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    return parser.parse_args()


def picked(count: int, wanted: int, seed: int) -> Int[np.ndarray, " w"]:
    """``wanted`` of ``count`` starts drawn at random: even strides would fall in with the grid's angles."""
    return np.sort(np.random.default_rng([seed, count]).permutation(count)[:wanted])


def main() -> None:
    given = arguments()
    os.environ.setdefault("JAXMODEL_CACHE", "")  # compile for real: the time is reported
    from jaxmodel.register import methods
    from jaxmodel.register.starts import euler_starts
    from jaxmodel.run.devices import prepare_devices

    cores = prepare_devices()
    pair = load_pair(given.points, given.seed)
    starts = euler_starts(pair.target, pair.source)
    starts = starts[picked(len(starts), given.starts, given.seed)]
    subset = picked(len(starts), given.peer_starts, given.seed)
    fewer = starts[subset]
    print(
        f"{pair.name}, {len(pair.source)} -> {len(pair.target)} points, {len(starts)} starts (peers: {len(fewer)}), "
        f"limit {pair.limit:g}, stop at {TURN:g} rad and {pair.move:g}, {cores} cores, {given.runs} paired runs"
    )

    ours = Ours(pair, starts, plain_method(pair))
    thesis = Ours(pair, starts, methods.named("thesis_2005"))
    compiled = [seconds(contender.compile) for contender in (ours, thesis)]
    with multiprocessing.get_context("spawn").Pool(cores) as pool:
        peers: dict[str, Callable[[Starts], Starts]] = {
            f"small_gicp, {cores} threads": partial(small_gicp_poses, pair, cores),
            f"small_gicp, {cores} processes": partial(spread_over, pool, cores, pair),
            "Open3D": partial(open3d_poses, pair),
        }
        poses = {"ours": ours.run()}
        for name, peer in peers.items():  # warms each up, too
            poses[name] = peer(fewer)
        taken = in_turn(
            {
                "ours": ours.run,
                "ours, table included": ours.whole,
                "table": ours.prepare,
                **{name: partial(peer, fewer) for name, peer in peers.items()},
            },
            given.runs,
        )
    begun = time.perf_counter()
    poses["ours, thesis_2005"] = thesis.run()
    taken["ours, thesis_2005"] = [time.perf_counter() - begun]
    poses["ours, the peers' starts"] = poses["ours"][subset]
    report(pair, poses, taken, compiled, (ours, thesis), list(peers), given.write_baseline)


def report(
    pair: Pair,
    poses: dict[str, Starts],
    taken: dict[str, list[float]],
    compiled: Sequence[float],
    own: tuple[Ours, Ours],
    peers: Sequence[str],
    write: bool,
) -> None:
    """Rates, ratios and success rates; ``compiled`` are the seconds of compilation, plain and thesis_2005."""
    right = {name: is_right(pair, found) for name, found in poses.items()}
    right["ours, table included"] = right["ours"]
    per_start = {n: [t / len(right[n]) for t in times] for n, times in taken.items() if n != "table"}
    rows = []
    for name, times in per_start.items():
        compared = [
            f"{median_ratio(times, per_start[mine]):.1f}" if name in peers else ""
            for mine in ("ours", "ours, table included")
        ]
        share = right[name]
        rate = statistics.median(1 / t for t in times)
        rows.append((name, f"{rate:.1f}", spread(taken[name]), *compared, f"{share.mean():.3f} of {len(share)}"))
    table(
        f"Starts per second (right: 5 degrees, {pair.tolerance:g} at the centroid)",
        ("what", "starts/s", "seconds", "ours is faster by", "table included", "right"),
        rows,
    )
    same, number = right["ours, the peers' starts"], len(right["ours, the peers' starts"])
    print(f"\nours on the {number} starts of the peers: {same.mean():.3f} right")
    table_seconds = statistics.median(taken["table"])
    print(f"voxel table: {table_seconds:.2f} s; compilation: {compiled[0]:.1f} s, thesis_2005 {compiled[1]:.1f} s")
    print(f"mean steps: {own[0].steps:.1f}, thesis_2005 {own[1].steps:.1f}")
    two, many, other = (per_start[name] for name in peers)
    best = two if statistics.median(two) <= statistics.median(many) else many
    values = {
        "sweep_vs_small_gicp_2_threads": median_ratio(two, per_start["ours"]),
        "sweep_vs_small_gicp_best_use": median_ratio(best, per_start["ours"]),
        "sweep_vs_open3d": median_ratio(other, per_start["ours"]),
        "sweep_with_table_vs_small_gicp_2_threads": median_ratio(two, per_start["ours, table included"]),
        "sweep_with_table_vs_open3d": median_ratio(other, per_start["ours, table included"]),
        "sweep_starts_per_second": 1 / statistics.median(per_start["ours"]),
        "thesis_2005_starts_per_second": 1 / statistics.median(per_start["ours, thesis_2005"]),
        "sweep_success_rate": float(right["ours"].mean()),
    }
    against_baseline(values, write)


if __name__ == "__main__":
    main()
