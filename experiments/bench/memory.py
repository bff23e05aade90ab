"""Peak resident memory of a whole ``jaxmodel run``: 100 000 starts against 1000, each in its own process.

The problem is cheap on purpose (few points, few iterations) and the kernels are compiled beforehand, so that what grows
with the number of starts cannot hide behind what does not: compiling takes more memory than running. Tables, labels,
pictures and report are all part of it.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from paired import against_baseline, table

ROOT = Path(__file__).resolve().parents[2]
COMMAND = "import sys; from jaxmodel.run.cli import main; main(sys.argv[1:])"


def config(starts: int, points: int, iterations: int, chunk: int) -> str:
    """The experiment as YAML (JSON is YAML): one built-in object, evenly spread starts."""
    method = {
        "strategies": [{"slope_percent": 0.1, "statistical_filter": False}],
        "stop": "slope",
        "cells": 32,
        "max_iterations": iterations,
    }
    return json.dumps(
        {
            "experiment": "convergence",
            "scans": {"kind": "objects", "names": ["boulder"], "sensor": {"width": 60, "height": 60}},
            "control_points": [{"kind": "subsample", "count": points}],
            "starts": {"kind": "even", "count": starts},
            "method": method,
            "claims": {"starts": 0},
            "engine": {"chunk": chunk},
        }
    )


def measure(cache: str, starts: int, points: int, iterations: int, chunk: int) -> tuple[float, float]:
    """Peak resident memory (MB) and seconds of one run in its own process, compiled kernels in ``cache``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "memory.yaml"
        path.write_text(config(starts, points, iterations, chunk))
        words = [sys.executable, "-c", COMMAND, "run", str(path), "--out", str(Path(folder) / "run")]
        begun = time.perf_counter()
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "JAXMODEL_CACHE": cache}
        process = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            raise SystemExit(f"the run of {starts} starts ended with exit code {process.returncode}")
        unit = 1 if sys.platform == "darwin" else 1024  # of ru_maxrss, byte
        return usage.ru_maxrss * unit / 1e6, time.perf_counter() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="runs of each size, in turn (default 3)")
    parser.add_argument("--few", type=int, default=1000, help="starts of the small run (default 1000)")
    parser.add_argument("--many", type=int, default=100_000, help="starts of the large run (default 100000)")
    parser.add_argument("--points", type=int, default=200, help="control points of each view (default 200)")
    parser.add_argument("--iterations", type=int, default=20, help="most iterations of a start (default 20)")
    parser.add_argument("--chunk", type=int, default=250, help="starts of one chunk (default 250)")
    parser.add_argument("--write-baseline", action="store_true", help="keep the figures in baseline.json")
    given = parser.parse_args()

    taken: dict[int, list[tuple[float, float]]] = {given.few: [], given.many: []}
    with tempfile.TemporaryDirectory() as cache:
        cold, _ = measure(cache, given.few, given.points, given.iterations, given.chunk)
        for _ in range(given.runs):
            for starts, measured in taken.items():
                measured.append(measure(cache, starts, given.points, given.iterations, given.chunk))
    rows = [
        (
            str(starts),
            f"{statistics.median(peak for peak, _ in runs):.0f}",
            ", ".join(f"{peak:.0f}" for peak, _ in runs),
            f"{statistics.median(taken for _, taken in runs):.1f}",
        )
        for starts, runs in taken.items()
    ]
    table("Memory of a whole run", ("starts", "peak MB, median", "peak MB, each run", "seconds"), rows)
    print(f"\n{given.few} starts, compilation included: {cold:.0f} MB")
    pairs = zip(taken[given.many], taken[given.few], strict=True)
    ratio = statistics.median(many[0] / few[0] for many, few in pairs)
    against_baseline({"peak_memory_100000_vs_1000": ratio}, given.write_baseline)


if __name__ == "__main__":
    main()
