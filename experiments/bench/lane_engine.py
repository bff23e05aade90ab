"""Both executors of the lane engine against ``vmap(while_loop)``: same kernel, same starts, all in one batch.

The gain of refilled lanes is the wait they save, so it is stated for starts of which the longest takes several times
the mean number of steps; the script prints that factor. ``vmap`` gets all starts as one batch on one device, as its
users write it; ``lanes`` runs on one device too, ``cores`` on one per core. All must end with the same poses.
"""

import argparse
import dataclasses
import os
import statistics

import numpy as np
from paired import against_baseline, in_turn, is_right, load_pair, median_ratio, seconds, spread, table


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="paired runs (default 5)")
    parser.add_argument("--points", type=int, default=1000, help="random points of each view (default 1000)")
    parser.add_argument("--steps", type=int, default=10, help="Euler grid: steps cubed starts (default 10)")
    parser.add_argument("--method", default="besl_mckay_1992", help="a file of configs/methods")
    parser.add_argument("--max-iterations", type=int, default=400, help="of the method (default 400)")
    parser.add_argument("--lanes", type=int, default=128, help="lanes refilled (default 128)")
    parser.add_argument("--steps-per-round", type=int, default=8, help="steps between two refills (default 8)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    os.environ.setdefault("JAXMODEL_CACHE", "")  # compile for real: the time is reported
    import jax

    from jaxmodel import lanes
    from jaxmodel.geometry.se3 import rotation_angle_deg
    from jaxmodel.register import methods
    from jaxmodel.register.basin import labels
    from jaxmodel.register.icp import Icp, IcpResult, Pose
    from jaxmodel.register.problem import prepare
    from jaxmodel.register.starts import euler_starts
    from jaxmodel.run.devices import prepare_devices

    cores = prepare_devices()
    pair = load_pair(given.points, given.seed)
    method = dataclasses.replace(methods.named(given.method), max_iterations=given.max_iterations)
    starts = euler_starts(pair.target, pair.source, given.steps)
    problem, frames = prepare(pair.target, pair.source, method)
    kernel, poses = Icp(problem, method), Pose(*frames.to_centred(starts))
    refilled = lanes.Engine("lanes", given.lanes, len(starts), given.steps_per_round)
    found: dict[str, IcpResult] = {}

    def keep(name: str, result: IcpResult) -> None:
        found[name] = jax.tree.map(np.asarray, result)  # blocks until ready

    contenders = {
        "vmap": lambda: keep("vmap", lanes.vmap_baseline(kernel, poses)),
        "lanes": lambda: keep("lanes", lanes.run(kernel, poses, refilled)),
        "cores": lambda: keep("cores", lanes.run(kernel, poses, lanes.Engine("cores", chunk=len(starts)))),
    }
    first = {name: seconds(work) for name, work in contenders.items()}
    taken = in_turn(contenders, given.runs)

    steps = found["vmap"].steps
    longest = float(steps.max() / steps.mean())
    print(
        f"{pair.name}, {given.points} points, {len(starts)} starts, {given.method}, {cores} cores, {given.lanes} lanes "
        f"refilled every {given.steps_per_round} steps, {given.runs} paired runs\n"
        f"steps: mean {steps.mean():.1f}, longest {steps.max()}: {longest:.2f} times the mean"
    )
    if longest < 3:
        print("the longest start takes less than 3 times the mean: no case for refilled lanes")
    world = {n: frames.from_centred(r.pose.rotation, r.pose.translation) for n, r in found.items()}
    size = float(np.linalg.norm(np.ptp(pair.source, axis=0)))
    rows, same = [], {}
    for name, result in found.items():
        both = np.concatenate([world["vmap"], world[name]])
        basin = labels(both, np.concatenate([found["vmap"].error, result.error]), pair.source_centroid, size)
        agree = basin[: len(starts)] == basin[len(starts) :]
        same[name] = float(agree.mean())
        relative = np.swapaxes(world["vmap"][:, :3, :3], 1, 2) @ world[name][:, :3, :3]
        turned = np.radians(rotation_angle_deg(relative))[agree]
        rows.append(
            (
                name,
                f"{len(starts) / statistics.median(taken[name]):.1f}",
                spread(taken[name]),
                f"{median_ratio(taken['vmap'], taken[name]):.2f}",
                f"{max(0.0, first[name] - statistics.median(taken[name])):.1f}",
                f"{is_right(pair, world[name]).mean():.3f}",
                f"{same[name]:.4f}",
                f"{(turned <= 1e-5).mean():.3f}, {np.quantile(turned, 0.5):.1e}, {turned.max():.1e}",
            )
        )
    columns = ("executor", "starts/s", "seconds", "vs vmap", "compilation s", "right", "same basin as vmap")
    table("Lane engine", (*columns, "rotation from vmap's there: within 1e-5 rad, median, largest"), rows)
    values = {
        "lanes_vs_vmap": median_ratio(taken["vmap"], taken["lanes"]),
        "cores_vs_vmap": median_ratio(taken["vmap"], taken["cores"]),
        "executors_same_basin": min(same.values()),
    }
    against_baseline(values, given.write_baseline)


if __name__ == "__main__":
    main()
