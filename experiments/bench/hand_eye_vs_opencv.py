"""Hand-eye calibration of 100 000 sets of 16 poses: ours against OpenCV's loop and scipy's least squares.

All are timed from absolute poses to X and use all 120 pairs of each set. OpenCV and scipy get a sample of the sets
(their time is the same for each), in one process as their users' loops run and, their best use, in as many processes as
cores. OpenCV's linear method is ANDREFF, which our ``linear_one_step`` is; ``linear`` is the two steps. The nonlinear
method is compared with scipy.optimize.least_squares: over the residuals of all pairs, and through the same 13 x 13
quadratic form as ours. Accuracy is the median error of each on the sample. Beside the wall time stands the processor
time of all cores, which another program's load hardly changes.
"""

import argparse
import multiprocessing
import os
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float
from paired import Spent, against_baseline, both_clocks, median_ratio, seconds, spread, table
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Poses = Float[np.ndarray, "b n 4 4"]
ANGLE_NOISE, LENGTH_NOISE = 0.005, 0.005
OURS = {"linear": "ANDREFF", "linear_one_step": "ANDREFF", "tsai_lenz": "TSAI"}


def drawn(sets: int, poses: int, seed: int) -> tuple[Float[np.ndarray, "b 4 4"], Poses, Poses]:
    """X (T_hand_camera), hand and noisy camera poses; rotations of normal roll, pitch and yaw of 0.7 rad."""
    from jaxmodel.calibrate.simulation import rigid
    from jaxmodel.geometry import se3

    random = np.random.default_rng(seed)
    X, Z = rigid(random.normal(size=(2, sets, 6)), 1.0, 1.0)
    hand = rigid(random.normal(size=(sets, poses, 6)), 0.7, 1.0)
    camera = se3.inverse(hand @ X[:, None]) @ Z[:, None]
    wrong = rigid(random.normal(size=(sets, poses, 6)), ANGLE_NOISE, LENGTH_NOISE)
    camera[..., :3, :3] = wrong[..., :3, :3] @ camera[..., :3, :3]
    camera[..., :3, 3] += wrong[..., :3, 3]
    return X, hand, camera


def opencv(method: str, hand: Poses, camera: Poses) -> Float[np.ndarray, "b 4 4"]:
    """One ``calibrateHandEye`` a set."""
    import cv2

    cv2.setNumThreads(1)
    code, found = getattr(cv2, f"CALIB_HAND_EYE_{method}"), np.tile(np.eye(4), (len(hand), 1, 1))
    for X, h, c in zip(found, hand, camera, strict=True):
        X[:3, :3], t = cv2.calibrateHandEye(h[:, :3, :3], h[:, :3, 3], c[:, :3, :3], c[:, :3, 3], method=code)
        X[:3, 3] = t[:, 0]
    return found


def spread_over(pool: Any, count: int, work: Any, *sets: np.ndarray) -> Float[np.ndarray, "b 4 4"]:
    """The sets dealt out to ``count`` processes."""
    parts = pool.starmap(work, [tuple(each[worker::count] for each in sets) for worker in range(count)])
    found = np.empty((len(sets[0]), 4, 4))
    for worker, part in enumerate(parts):
        found[worker::count] = part
    return found


def pairs(hand: Poses, camera: Poses) -> tuple[np.ndarray, np.ndarray]:
    """A and B of all pairs."""
    from jaxmodel.geometry import se3

    i, j = np.triu_indices(hand.shape[1], 1)
    return camera[:, j] @ se3.inverse(camera[:, i]), se3.inverse(hand[:, j]) @ hand[:, i]


def pair_by_pair(hand: Poses, camera: Poses) -> Float[np.ndarray, "b 4 4"]:
    """Our nonlinear method for any pairs of motions."""
    from jaxmodel.calibrate import solve_many
    from jaxmodel.geometry import se3

    A, B = pairs(hand, camera)
    return se3.inverse(solve_many(A, B, method="nonlinear", verdict=False).X)


def scipy_pairs(start: Float[np.ndarray, "b 4 4"], hand: Poses, camera: Poses) -> Float[np.ndarray, "b 4 4"]:
    """Levenberg-Marquardt over the residuals of all pairs, one set after the other, from our linear solution."""
    from jaxmodel.geometry import se3

    A, B = pairs(hand, camera)
    found = np.tile(np.eye(4), (len(A), 1, 1))
    for X, Y, a, b in zip(found, se3.inverse(start), A, B, strict=True):

        def residual(v: np.ndarray, a: np.ndarray = a, b: np.ndarray = b) -> np.ndarray:
            R = Rotation.from_rotvec(v[:3]).as_matrix()
            turn = a[:, :3, :3] @ R - R @ b[:, :3, :3]
            shift = a[:, :3, :3] @ v[3:] - v[3:] + a[:, :3, 3] - b[:, :3, 3] @ R.T
            return np.concatenate([turn.ravel() / np.sqrt(2), shift.ravel()])

        v = np.concatenate([Rotation.from_matrix(Y[:3, :3]).as_rotvec(), Y[:3, 3]])
        _place(X, least_squares(residual, v, method="lm").x)
    return found


def scipy_form(start: Float[np.ndarray, "b 4 4"], hand: Poses, camera: Poses) -> Float[np.ndarray, "b 4 4"]:
    """As ``scipy_pairs`` through the square root of the 13 x 13 form, whatever the number of pairs."""
    from jaxmodel.geometry import se3

    A, B = pairs(hand, camera)
    found = np.tile(np.eye(4), (len(A), 1, 1))
    for X, Y, a, b in zip(found, se3.inverse(start), A, B, strict=True):
        n = len(a)
        rows = np.zeros((n, 12, 13))
        rows[:, :9, :9] = (
            np.einsum("nij,kl->nikjl", a[:, :3, :3], np.eye(3)) - np.einsum("ij,nlk->nikjl", np.eye(3), b[:, :3, :3])
        ).reshape(n, 9, 9) / np.sqrt(2)
        rows[:, 9:, :9] = -np.einsum("ij,nl->nijl", np.eye(3), b[:, :3, 3]).reshape(n, 3, 9)
        rows[:, 9:, 9:12], rows[:, 9:, 12] = a[:, :3, :3] - np.eye(3), a[:, :3, 3]
        flat = rows.reshape(-1, 13)
        values, vectors = np.linalg.eigh(flat.T @ flat)
        root = np.sqrt(np.maximum(values, 0))[:, None] * vectors.T

        def residual(v: np.ndarray, root: np.ndarray = root) -> np.ndarray:
            return root @ np.concatenate([Rotation.from_rotvec(v[:3]).as_matrix().ravel(), v[3:], [1.0]])

        v = np.concatenate([Rotation.from_matrix(Y[:3, :3]).as_rotvec(), Y[:3, 3]])
        _place(X, least_squares(residual, v, method="lm").x)
    return found


def _place(X: np.ndarray, v: np.ndarray) -> None:
    """X = Y^-1 of the solution Y of AX = XB."""
    R = Rotation.from_rotvec(v[:3]).as_matrix()
    X[:3, :3], X[:3, 3] = R.T, -R.T @ v[3:]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="paired runs (default 5)")
    parser.add_argument("--sets", type=int, default=100_000)
    parser.add_argument("--poses", type=int, default=16, help="of each set (default 16: 120 pairs)")
    parser.add_argument("--peer-sets", type=int, default=1000, help="sets given to OpenCV (default 1000)")
    parser.add_argument("--pair-sets", type=int, default=2000, help="sets of our nonlinear method pair by pair")
    parser.add_argument("--scipy-sets", type=int, default=100, help="sets given to scipy")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    os.environ.setdefault("JAXMODEL_CACHE", "")  # compile for real: the time is reported
    from jaxmodel.calibrate.many_poses import solve_many_poses
    from jaxmodel.calibrate.simulation import errors
    from jaxmodel.run.devices import prepare_devices

    cores = prepare_devices()
    X, hand, camera = drawn(given.sets, given.poses, given.seed)
    sets = {"peer": given.peer_sets, "pairs": given.pair_sets, "scipy": given.scipy_sets}
    part = {name: (hand[:count], camera[:count]) for name, count in sets.items()}
    print(f"{len(hand)} sets of {given.poses} poses, noise {ANGLE_NOISE:g} rad and {LENGTH_NOISE:g}, {cores} cores")
    work: dict[str, tuple[Any, int]] = {}
    for method in (*OURS, "nonlinear"):
        ours = partial(solve_many_poses, hand, camera, method=method)
        print(f"{method}: compiled in {seconds(ours):.1f} s, {len(hand)} sets included")
        work[f"ours, {method}"] = ours, len(hand)
    work["ours, nonlinear pair by pair"] = partial(pair_by_pair, *part["pairs"]), given.pair_sets
    peers: dict[str, tuple[Any, tuple[np.ndarray, ...]]] = {
        f"OpenCV {peer}": (partial(opencv, peer), part["peer"]) for peer in sorted(set(OURS.values()))
    }
    start = solve_many_poses(*part["scipy"])
    peers["scipy, all pairs"] = scipy_pairs, (start, *part["scipy"])
    peers["scipy, 13 x 13 form"] = scipy_form, (start, *part["scipy"])
    with multiprocessing.get_context("spawn").Pool(cores) as pool:
        for name, (alone, its) in peers.items():
            work[name] = partial(alone, *its), len(its[0])
            work[f"{name}, {cores} processes"] = partial(spread_over, pool, cores, alone, *its), len(its[0])
        found = {name: run() for name, (run, _) in work.items()}  # warms each up, too
        taken = both_clocks({name: run for name, (run, _) in work.items()}, given.runs)
    per_set = {
        name: Spent([t / work[name][1] for t in spent.wall], [t / work[name][1] for t in spent.processor])
        for name, spent in taken.items()
    }
    rows = []
    for name, spent in per_set.items():
        count = min(len(found[name]), given.peer_sets)
        angle, shift = errors(found[name][:count], X[:count])
        wall, processor = ([1e6 * t for t in times] for times in spent)
        own = "" if name.endswith("processes") else spread(processor, 1)  # the processes' clocks are not ours to read
        rows.append((name, spread(wall, 1), own, f"{np.median(angle):.4f}°", f"{np.median(shift):.5f}", str(count)))
    columns = ("what", "wall us", "processor us", "rotation", "translation", "of")
    table("Microseconds a set, and median errors on the first sets", columns, rows)
    ratios = [
        (f"hand_eye_{method}_vs_opencv_{{}}", f"ours, {method}", f"OpenCV {peer}") for method, peer in OURS.items()
    ]
    for key, name in (("all_pairs", "scipy, all pairs"), ("form", "scipy, 13 x 13 form")):
        ratios.append((f"hand_eye_nonlinear_vs_scipy_{key}_{{}}", "ours, nonlinear", name))
    values = {"hand_eye_sets_per_second": 1 / float(np.median(per_set["ours, linear"].wall))}
    for key, mine, peer in ratios:
        values[key.format("loop")] = median_ratio(per_set[peer].wall, per_set[mine].wall)
        values[key.format("best_use")] = median_ratio(per_set[f"{peer}, {cores} processes"].wall, per_set[mine].wall)
        values[key.format("processor")] = median_ratio(per_set[peer].processor, per_set[mine].processor)
    against_baseline(values, given.write_baseline)


if __name__ == "__main__":
    main()
