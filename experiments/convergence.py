"""Success of ICP over 1000 initial rotations (thesis §2.9.2, MISSION row 1.8): published beside ours.

Runs configs/experiments/bunny_convergence.yaml where the real scans are there, and objects_convergence.yaml, then
prints *published | ours | command* in both ways of counting and a table of all pairs. Both take two kinds of control
points, subsampled and mesh vertices, side by side. Started again, it goes on where it was.
"""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class Part(NamedTuple):
    """One of the two experiments."""

    title: str
    config: str
    folder: Path
    changes: tuple[str, ...]


def parts(out: Path, pairs: Sequence[str]) -> list[Part]:
    """The experiments to run: bunny pairs are named ``bun000-bun045``, objects by their name."""
    from jaxmodel.io.datasets import data_root

    root = data_root()
    has_bunny = root is not None and (root / "stanford_bunny").is_dir()
    found = []
    real, made = [name for name in pairs if "-" in name], [name for name in pairs if "-" not in name]
    if real and not has_bunny:
        sys.exit(f"convergence: {real[0]} is a pair of real scans, and there are none: set JAXMODEL_DATA")
    if has_bunny and (real or not pairs):
        listed = ", ".join(f"[{', '.join(name.split('-'))}]" for name in real)
        chosen = ("--scans.pairs", f"[{listed}]") if real else ()
        found.append(Part("real scans, bunny", "bunny_convergence", out / "bunny", chosen))
    if made or not pairs:
        chosen = ("--scans.names", f"[{', '.join(made)}]") if made else ()
        found.append(Part("built-in objects", "objects_convergence", out / "objects", chosen))
    return found


def run(part: Part) -> dict[str, Any]:
    """The summary of one experiment, run or resumed in its folder."""
    from jaxmodel.io.results import read_json
    from jaxmodel.run.cli import execute

    there = "--resume" if (part.folder / "manifest.json").is_file() else "--out"
    code = execute(["run", f"configs/experiments/{part.config}.yaml", *part.changes, there, str(part.folder)])
    if code:
        sys.exit(code)
    return read_json(part.folder / "summary.json")


def overlaps(part: Part) -> dict[str, tuple[float, float]]:
    """Share of each scan's points that the other covers at the true pose: of the target's points, of the source's.

    Covered means closer than the experiment's ``overlap_distance``, or 1.4 median spacings where it has none.
    """
    from scipy.spatial import KDTree

    from jaxmodel.io.results import read_json
    from jaxmodel.io.strict_yaml import structure
    from jaxmodel.run.convergence import Config
    from jaxmodel.run.pairs import load_pairs
    from jaxmodel.scan.cloud import as_cloud, resolution

    raw = read_json(part.folder / "manifest.json")["config"]
    config = structure({**raw, "method": raw["method"]["name"]}, Config, str(part.folder))
    found = {}
    for pair in load_pairs(config.scans, config.seed):
        target, source = as_cloud(pair.target).points, as_cloud(pair.source).points
        assert pair.T_target_source is not None
        moved = source @ pair.T_target_source[:3, :3].T + pair.T_target_source[:3, 3]
        reach = getattr(config.scans, "overlap_distance", 1.4 * resolution(target))
        first, second = (
            float(np.mean(np.isfinite(KDTree(b).query(a, distance_upper_bound=reach)[0])))
            for a, b in ((target, moved), (moved, target))
        )
        found[pair.name] = first, second
    return found


def pair_line(case: dict[str, Any], overlap: tuple[float, float]) -> tuple[str, ...]:
    """One sweep as text, under ``PAIR_COLUMNS``."""
    success, plateau, best = case["success"], case["plateau"], case["best"]

    def share(value: float | None) -> str:
        return "" if value is None else f"{value:.2f}"

    return (
        case["pair"],
        f"{overlap[0]:.2f}, {overlap[1]:.2f}",
        case["control_points"],
        f"{success['count']} = {100 * success['rate']:.1f} %",
        f"{100 * success['low']:.1f} to {100 * success['high']:.1f} %",
        "right" if best["right"] else f"wrong, {best['rotation_error_deg']:.0f}°",
        f"{plateau['members']} starts" if plateau["found"] else "none",
        share(plateau["precision"]),
        share(plateau["recall"]),
    )


PAIR_COLUMNS = (
    "pair", "overlap", "points", "right", "95 % (Wilson)", "Sweep.best", "plateau", "precision", "recall",
)  # fmt: skip


def verdicts(cases: Sequence[dict[str, Any]], overlap: dict[str, tuple[float, float]]) -> list[str]:
    """What is asked of the real scans, for each kind of control points, as sentences."""
    lines = []
    for kind in dict.fromkeys(case["control_points"] for case in cases):
        ours = [case for case in cases if case["control_points"] == kind]
        asked = [case for case in ours if min(overlap[case["pair"]]) >= 0.5]
        right = sum(case["best"]["right"] for case in asked)
        basins = [case["plateau"] for case in ours if case["success"]["count"]]
        named = [plateau for plateau in basins if plateau["found"]]
        sharp = sum(min(plateau["precision"] or 0, plateau["recall"] or 0) >= 0.95 for plateau in named)
        misled = [case["pair"] for case in ours if case["plateau"]["found"] and not case["best"]["right"]]
        lines.append(
            f"{kind}: Sweep.best is right on {right} of {len(asked)} pairs with overlap >= 0.5 both ways. "
            f"Of {len(basins)} pairs with a right start, the truth-free test names a basin on {len(named)}, "
            f"with precision and recall >= 0.95 on {sharp}, and abstains on {len(basins) - len(named)}. "
            f"Over all {len(ours)} pairs it names a wrong basin on {len(misled)}"
            f"{' (' + ', '.join(misled) + ')' if misled else ''}."
        )
    either = {case["pair"] for case in cases if case["best"]["right"] and min(overlap[case["pair"]]) >= 0.5}
    lines.append(f"Right with at least one kind of points: {len(either)}.")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/convergence"), help="folder of the two runs")
    parser.add_argument(
        "--pairs", nargs="+", default=[], metavar="NAME", help="only these: bun000-bun045 ..., boulder ..."
    )
    given = parser.parse_args()
    from jaxmodel.run.devices import prepare_devices, quiet_compiler

    quiet_compiler()
    from jaxmodel.run.console import write, write_table
    from jaxmodel.run.published import COLUMNS, published_lines

    prepare_devices()
    done = [(part, run(part)) for part in parts(given.out, given.pairs)]
    published = []
    for part, summary in done:
        overlap = overlaps(part)
        write_table(
            f"{part.title}, {summary['method']}, {summary['cases'][0]['starts']} starts",
            PAIR_COLUMNS,
            [pair_line(case, overlap[case["pair"]]) for case in summary["cases"]],
        )
        for sentence in verdicts(summary["cases"], overlap):
            write(sentence)
        ran = [row for row in summary["published"] if row["ours"]]
        command = shlex.join(["jaxmodel", "run", f"configs/experiments/{part.config}.yaml", *part.changes])
        published += [(f"{row[0]} ({part.title})", *row[1:]) for row in published_lines(ran, command)]
    absent = [row for row in done[0][1]["published"] if not any(_has(s, row["what"]) for _, s in done)]
    write_table("Published | ours | command", COLUMNS, [*published, *published_lines(absent, "")])


def _has(summary: dict[str, Any], what: str) -> bool:
    return any(row["what"] == what and row["ours"] for row in summary["published"])


if __name__ == "__main__":
    main()
