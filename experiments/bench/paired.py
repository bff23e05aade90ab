"""What the benchmarks share: one pair of clouds with its truth, runs taken in turn, medians, and named metrics."""

import json
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

BASELINE = Path(__file__).with_name("baseline.json")


class Pair(NamedTuple):
    """Random points of two views with the true motion. Lengths in the unit of the data.

    ``limit`` is the distance beyond which pairs are dropped, ``move`` the translation below which a step counts as
    standing still, ``tolerance`` how far from the truth the source's centroid may end.
    """

    name: str
    target: Float[np.ndarray, "n 3"]
    source: Float[np.ndarray, "n 3"]
    T_target_source: Float[np.ndarray, "4 4"]
    source_centroid: Float[np.ndarray, "3"]
    limit: float
    move: float
    tolerance: float


def load_pair(points: int, seed: int) -> Pair:
    """bun000 <- bun045 where the data folder is there (50 mm, 0.01 mm, 5 mm), else the built-in boulder, 45 degrees."""
    from jaxmodel.control_points import Subsample, select
    from jaxmodel.io.datasets import ObjectViews, StanfordBunny, data_root
    from jaxmodel.scan.cloud import as_cloud

    root = data_root()
    has_bunny = root is not None and (root / "stanford_bunny" / "data" / "bun.conf").is_file()
    views = StanfordBunny(root) if has_bunny else ObjectViews("boulder", (0, 45))
    names = ("bun000", "bun045") if has_bunny else views.names
    target, source = (views.scan(name) for name in names)
    whole = as_cloud(source).points
    size = float(np.linalg.norm(np.ptp(whole, axis=0)))
    lengths = (0.05, 1e-5, 0.005) if has_bunny else (0.22 * size, 4.5e-5 * size, 0.03 * size)
    how = Subsample(count=points, how="random")
    return Pair(
        f"{names[0]} <- {names[1]}",
        np.asarray(select(target, how, seed).points, np.float64),
        np.asarray(select(source, how, seed + 1).points, np.float64),
        views.T_target_source(*names),
        whole.mean(axis=0, dtype=np.float64),
        *lengths,
    )


def is_right(pair: Pair, T_target_source: Float[np.ndarray, "s 4 4"]) -> Bool[np.ndarray, " s"]:
    """Within 5 degrees and the pair's tolerance at the source's centroid."""
    from jaxmodel.register import basin

    errors = basin.truth_errors(T_target_source, pair.T_target_source, pair.source_centroid)
    return basin.right(errors, 5.0, pair.tolerance)


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call; ``work`` must return only when its results are in host memory."""
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def in_turn(contenders: Mapping[str, Callable[[], object]], runs: int) -> dict[str, list[float]]:
    """Seconds of ``runs`` calls each, taken in turn A B C A B C, so that a change of the machine's load hits all."""
    taken: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(runs):
        for name, work in contenders.items():
            taken[name].append(seconds(work))
    return taken


class Spent(NamedTuple):
    """Seconds of each run: on the wall, and of this process on all processors."""

    wall: list[float]
    processor: list[float]


def both_clocks(contenders: Mapping[str, Callable[[], object]], runs: int) -> dict[str, Spent]:
    """As ``in_turn``, by the wall and by the processors' clock: the latter says little about waiting for others."""
    taken = {name: Spent([], []) for name in contenders}
    for _ in range(runs):
        for name, work in contenders.items():
            begun = time.process_time()
            taken[name].wall.append(seconds(work))
            taken[name].processor.append(time.process_time() - begun)
    return taken


def median_ratio(slow: Sequence[float], fast: Sequence[float]) -> float:
    """Median over the paired runs of slow / fast."""
    return statistics.median(a / b for a, b in zip(slow, fast, strict=True))


def spread(values: Sequence[float], digits: int = 2) -> str:
    """``median (smallest to largest)``."""
    return f"{statistics.median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A Markdown table on standard output."""
    print(f"\n{title}\n")
    for row in (columns, ["---"] * len(columns), *rows):
        print("| " + " | ".join(row) + " |")


def against_baseline(values: Mapping[str, float], write: bool) -> None:
    """Print each metric beside the committed baseline; with ``write`` the values become the baseline."""
    metrics = json.loads(BASELINE.read_text())
    rows = []
    for name, value in values.items():
        metric = metrics[name]
        before, higher = metric["value"], metric["direction"] == "higher"
        verdict = "no baseline yet"
        if before is not None:
            change = value / before - 1 if before else 0.0
            worse = -change if higher else change
            allowed = "within tolerance" if worse <= metric["tolerance"] else "WORSE than allowed"
            verdict = f"{100 * change:+.0f} %, {allowed}"
        goal = "" if metric["goal"] is None else f"{'>=' if higher else '<='} {metric['goal']:g}"
        was = "" if before is None else f"{before:.4g}"
        rows.append((name, f"{value:.4g}", metric["unit"], goal, was, verdict))
        if write:
            metric["value"] = float(f"{value:.4g}")
    table("Metrics", ("metric", "now", "unit", "goal", "baseline", "against the baseline"), rows)
    if write:
        BASELINE.write_text(json.dumps(metrics, indent=2) + "\n")
        print(f"\nwrote {len(values)} metrics to {BASELINE}")
