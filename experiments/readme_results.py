"""Write the table of results into README.md, between its two marks, from finished runs and the benchmark's baseline.

Run it after ``experiments/convergence.py``, ``experiments/chapter2.py`` and the scripts of ``experiments/bench`` with
``--write-baseline``: nothing in the table is typed by hand.
"""

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- results: written by experiments/readme_results.py -->", "<!-- end of results -->"
SHOWN = ("converged", "true rotation error", "iterations", "time with extraction")
PICTURE = "bunny/figures/bun000-bun045-error-and-truth.png"


def convergence_rows(runs: Path) -> list[tuple[str, str, str, str]]:
    """Success of the thesis's method over 1000 starts, pooled over the pairs of each family."""
    rows = []
    for folder, scans in (("bunny", "real scans"), ("objects", "built-in objects")):
        summary: dict[str, Any] = json.loads((runs / folder / "summary.json").read_text())
        for row in summary["published"]:
            if not row["ours"]:
                continue
            published = ", ".join(f"{kind} {100 * rate:g} %" for kind, rate in row["published"].items())
            ours = ", ".join(
                f"{kind} {100 * both['all_pairs']['rate']:.1f} %" for kind, both in row["ours"].items()
            )
            pairs = max(both["all_pairs"]["pairs"] for both in row["ours"].values())
            what = f"success from 1000 starts, {row['what']} (§2.9.2; {scans}, {pairs} pairs)"
            rows.append((what, published, ours, "`python experiments/convergence.py`"))
        cases = summary["cases"]
        right, named = sum(case["best"]["right"] for case in cases), [c for c in cases if c["plateau"]["found"]]
        sound = sum(min(c["plateau"]["precision"], c["plateau"]["recall"]) >= 0.95 for c in named)
        what = f"lowest error is the right pose; right basin named without the truth ({scans})"
        ours = (
            f"{right} of {len(cases)} sweeps; named in {len(named)}, {sound} of them with precision and recall >= 0.95"
        )
        rows.append((what, '"clearly identifiable"', ours, "the same"))
    return rows


def chapter_rows(chapter: Path) -> list[tuple[str, str, str, str]]:
    """Contours against vertices: each family of objects from each kind of starts."""
    rows: dict[str, list[str]] = {}
    claims = {}
    for line in json.loads((chapter / "conclusion.json").read_text())["lines"]:
        where, figure, claimed, contours, vertices, difference, ours = line
        if figure not in SHOWN:
            continue
        if claimed != "nothing":
            claims[where] = f"{claimed} better"
        rows.setdefault(where, []).append(f"{figure} {contours} and {vertices}, {difference}: {ours.split(':')[0]}")
    return [
        (
            f"contours and vertices, difference [95 % interval]: better is (§2.9.6; {where})",
            claims[where],
            "; ".join(rows[where]),
            "`python experiments/chapter2.py`",
        )
        for where in rows
    ]


def benchmark_rows() -> list[tuple[str, str, str, str]]:
    """The paired benchmarks' ratios, from the committed baseline."""
    value = {name: metric["value"] for name, metric in json.loads(BASELINE.read_text()).items()}
    sweep = (
        f"{value['sweep_vs_small_gicp_2_threads']:.0f} x small_gicp (2 threads), "
        f"{value['sweep_vs_small_gicp_best_use']:.0f} x its best use (2 processes), "
        f"{value['sweep_vs_open3d']:.0f} x Open3D; with the voxel table's build "
        f"{value['sweep_with_table_vs_small_gicp_2_threads']:.0f} x and {value['sweep_with_table_vs_open3d']:.0f} x"
    )
    lanes = f"{value['lanes_vs_vmap']:.1f} x (refilled lanes), {value['cores_vs_vmap']:.1f} x (cores)"
    memory = f"{value['peak_memory_100000_vs_1000']:.2f} x"
    return [
        ("starts/s of plain point-to-point ICP, 2 cores", "", sweep, "`python experiments/bench/sweep_vs_peers.py`"),
        ("lane engine against `vmap(while_loop)`", "", lanes, "`python experiments/bench/lane_engine.py`"),
        ("peak memory, 100 000 starts against 1000", "", memory, "`python experiments/bench/memory.py`"),
    ]


BASELINE = ROOT / "experiments" / "bench" / "baseline.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, default=Path("runs/convergence"), help="--out of convergence.py")
    parser.add_argument("--chapter", type=Path, default=Path("runs/chapter2"), help="--out of chapter2.py")
    given = parser.parse_args()
    runs = given.runs
    lines = ["| what | published | ours | command |", "| --- | --- | --- | --- |"]
    found = (*convergence_rows(runs), *chapter_rows(given.chapter), *benchmark_rows())
    lines += ["| " + " | ".join(row) + " |" for row in found]
    readme = ROOT / "README.md"
    before, rest = readme.read_text().split(BEGIN)
    _, after = rest.split(END)
    readme.write_text(f"{before}{BEGIN}\n\n" + "\n".join(lines) + f"\n\n{END}{after}")
    pictures = ROOT / "experiments" / "pictures"
    shutil.copyfile(runs / PICTURE, pictures / "convergence.png")
    shutil.copyfile(given.chapter / "conclusion.png", pictures / "chapter2.png")
    print(f"wrote {len(lines) - 2} rows to {readme}")


if __name__ == "__main__":
    main()
