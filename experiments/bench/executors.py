"""Do the executors of the lane engine agree where agreement is hardest: a method of many decisions on real scans?

Every start of the sweep is run by ``cores`` and by ``lanes`` with each lane count. ICP decides by comparisons (which
point is closest, which pair is kept), so one bit of difference can end in another basin. On a CPU lanes are slow.
"""

import argparse
import time

import numpy as np
from paired import against_baseline, is_right, load_pair, table


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=2000, help="random points of each view (default 2000)")
    parser.add_argument("--steps", type=int, default=10, help="Euler grid: steps cubed starts (default 10)")
    parser.add_argument("--method", default="thesis_2005", help="a file of configs/methods")
    parser.add_argument("--lanes", type=int, nargs="+", default=[64, 256], help="lane counts (default 64 256)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    from jaxmodel.geometry.se3 import rotation_angle_deg
    from jaxmodel.register import sweep
    from jaxmodel.register.basin import same_basin
    from jaxmodel.register.starts import euler_starts
    from jaxmodel.run.devices import prepare_devices

    prepare_devices()
    pair = load_pair(given.points, given.seed)
    starts = euler_starts(pair.target, pair.source, given.steps)
    size = float(np.linalg.norm(np.ptp(pair.source, axis=0)))
    found, rows, least = {}, [], 1.0
    for name, lanes in {"cores": None, **{f"{lanes} lanes": lanes for lanes in given.lanes}}.items():
        begun = time.perf_counter()
        found[name] = sweep(pair.target, pair.source, starts, given.method, lanes=lanes, chunk=len(starts))
        taken = time.perf_counter() - begun
        for other in list(found)[:-1] or [name]:
            a, b = found[name], found[other]
            same = same_basin(a, b, pair.source_centroid, size)
            turned = rotation_angle_deg(np.swapaxes(a.T_target_source[:, :3, :3], 1, 2) @ b.T_target_source[:, :3, :3])
            least = min(least, float(same.mean()))
            rows.append(
                (
                    name,
                    f"{taken:.0f}",
                    f"{is_right(pair, a.T_target_source).mean():.3f}",
                    other,
                    f"{same.mean():.4f}",
                    f"{(np.radians(turned) <= 1e-5).mean():.4f}",
                    f"{(a.steps == b.steps).mean():.4f}",
                )
            )
    columns = ("executor", "seconds", "right", "against", "same basin", "within 1e-5 rad", "same steps")
    table(f"{pair.name}, {given.points} points, {len(starts)} starts, {given.method}", columns, rows)
    against_baseline({"executors_same_basin_thesis": least}, given.write_baseline)


if __name__ == "__main__":
    main()
