"""Time and peak memory of the edges of a range image: a small image and a whole turn of a large scanner.

The scene is a room with a pillar and a ball, with noise along the rays. Every measurement is a process of its own,
warmed up on a small image; its peak includes the interpreter and the image. Canny's edges of the same distances as a
picture (OpenCV on 8 bits where it is installed, scikit-image) stand beside for scale only: they know neither jumps
from creases, nor noise along rays, nor mixed points. The metrics are processor seconds, which others on the machine
hardly change: the detector is one thread, so that an idle machine takes as many.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from jaxtyping import Float
from paired import against_baseline, spread, table

ROOT = Path(__file__).resolve().parents[2]
SIZES = {"400x512": (400, 512), "1400x8000": (1400, 8000)}
SIGMA = 0.002  # metre


def distances(turn: Float[np.ndarray, " w"], lift: Float[np.ndarray, " h"]) -> Float[np.ndarray, "h w"]:
    """How far a sensor 1.5 above the floor of the room sees along rays of these angles in radian."""
    flat = np.cos(lift)[:, None]
    across = np.stack([np.cos(turn), np.sin(turn)])
    with np.errstate(divide="ignore"):
        walls = np.min(
            np.where(across > 0, np.array([[4.0], [3.0]]), np.array([[3.0], [5.0]])) / np.abs(across), axis=0
        )
        level = np.where(lift > 0, 1.2, 1.5) / np.abs(np.sin(lift))
    reach = np.minimum(walls / flat, level[:, None])
    for centre, radius, upright in ((np.array([1.5, 1.0, 0.0]), 0.3, True), (np.array([-1.5, -2.0, -0.4]), 0.6, False)):
        ahead = flat * (across.T @ centre[:2]) + (0.0 if upright else centre[2] * np.sin(lift)[:, None])
        square = flat**2 if upright else 1.0
        left = ahead**2 - square * (centre[: 2 if upright else 3] @ centre[: 2 if upright else 3] - radius**2)
        hit = (left > 0) & (ahead > 0)
        reach = np.where(hit, np.minimum(reach, (ahead - np.sqrt(np.maximum(left, 0.0))) / square), reach)
    return reach


def work(name: str, rows: int, columns: int) -> dict[str, float]:
    """Wall and processor seconds of one detection, and how many edge pixels it has."""
    from jaxmodel.control_points.edges import EdgeKind, find_edges
    from jaxmodel.scan.range_image import RangeImage

    def image(rows: int, columns: int, turn_by: float, lift_by: float) -> RangeImage:
        turn = (np.arange(columns) / columns - 0.5) * turn_by
        lift = np.linspace(0.5, -0.5, rows) * lift_by
        points = np.empty((rows, columns, 3))
        rng = np.random.default_rng(0)
        for row in range(rows):
            flat = np.cos(lift[row])
            rays = np.stack([flat * np.cos(turn), flat * np.sin(turn), np.full(columns, np.sin(lift[row]))], axis=1)
            reach = distances(turn, lift[row : row + 1])[0] + SIGMA * rng.normal(size=columns)
            points[row] = reach[:, None] * rays
        return RangeImage(points, np.ones((rows, columns), dtype=bool))

    def canny_opencv(scan: RangeImage) -> int:
        import cv2

        reach = np.linalg.norm(scan.points, axis=-1)
        return int(np.count_nonzero(cv2.Canny((255 * reach / reach.max()).astype(np.uint8), 50, 100)))

    def canny_skimage(scan: RangeImage) -> int:
        from skimage.feature import canny

        return int(canny(np.linalg.norm(scan.points, axis=-1)).sum())

    def ours(scan: RangeImage) -> int:
        return int(np.count_nonzero(find_edges(scan).kind != EdgeKind.NONE))

    detect = {"jaxmodel": ours, "OpenCV Canny": canny_opencv, "scikit-image Canny": canny_skimage}[name]
    detect(image(60, 80, 1.2, 0.9))
    scan = image(rows, columns, 2 * np.pi, 2.0) if columns > 2000 else image(rows, columns, 1.2, 0.9)
    wall, processor = time.perf_counter(), time.process_time()
    found = detect(scan)
    return {"wall": time.perf_counter() - wall, "processor": time.process_time() - processor, "found": found}


def measure(name: str, size: str) -> dict[str, float]:
    """:func:`work` in its own process, with its peak resident memory in GiB."""
    words = [sys.executable, __file__, "--work", name, "--size", size]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    said = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"{name} on {size} ended with exit code {process.returncode}")
    unit = 1 if sys.platform == "darwin" else 1024  # of ru_maxrss, byte
    return {**json.loads(said), "peak": usage.ru_maxrss * unit / 2**30}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="runs of each, in turn (default 3)")
    parser.add_argument("--size", choices=SIZES, help="this size alone (default both)")
    parser.add_argument("--work", help=argparse.SUPPRESS)
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    given = parser.parse_args()
    if given.work:
        print(json.dumps(work(given.work, *SIZES[given.size])))
        return

    peers = ["OpenCV Canny"] if find_spec("cv2") else []
    names = ["jaxmodel", *peers, "scikit-image Canny"]
    rows, values = [], {}
    for size in [given.size] if given.size else SIZES:
        taken: dict[str, list[dict[str, float]]] = {name: [] for name in names}
        for _ in range(given.runs):
            for name in names:
                taken[name].append(measure(name, size))
        for name, runs in taken.items():
            middle = {part: statistics.median(run[part] for run in runs) for part in runs[0]}
            wall = spread([run["wall"] for run in runs])
            rows.append(
                (size, name, wall, f"{middle['processor']:.2f}", f"{middle['peak']:.2f}", f"{runs[0]['found']}")
            )
            if name == "jaxmodel":
                values |= {
                    f"edges_processor_seconds_{size}": middle["processor"],
                    f"edges_peak_gib_{size}": middle["peak"],
                }
    table("Edges", ("image", "detector", "seconds", "processor seconds", "peak GiB", "edge pixels"), rows)
    against_baseline(values, given.write_baseline)


if __name__ == "__main__":
    main()
