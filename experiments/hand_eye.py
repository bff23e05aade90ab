"""The hand-eye experiments of RR-3507 from one command, ending with all its claims put to the test.

Runs every experiment (each is also one ``jaxmodel run CONFIG``), prints their tables *published | ours*, and then lists
each claim of the report as confirmed, contradicted or undecided, with 95 % intervals. Everything is simulated, the
report's robot included, which is not available. Started again, it goes on where it was.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_FEW = {"draws": "20", "chunk": "20"}
_REPORT = {**_FEW, "report_draws": "10", "resamples": "100"}
_BENCH = {**_FEW, "bench.positions": "16", "bench.reference_draws": "20", "resamples": "200"}
PARTS: Mapping[str, Mapping[str, str]] = {
    "hand_eye_averaging": {"draws": "4", "chunk": "4", "resamples": "200"},
    "hand_eye_observability": {"draws": "1", "chunk": "1"},
    "hand_eye_noise": {**_REPORT, "noise": "[0, 0.1, 0.2]"},
    "hand_eye_count": {**_REPORT, "counts": "[2, 15]", "timed": "[2]"},
    "hand_eye_trajectories": {**_BENCH, "steps": "14", "weights": "[{penalty: 1}]"},
    "hand_eye_self_calibration": {**_BENCH, "motions": "16", "scales": "[0.5, 1]", "pure": "1"},
}
"""Experiment -> what ``--quick`` changes, dotted key -> YAML: batches of one size and few lengths, for compilation is
most of its time."""


def run(name: str, folder: Path, changes: Mapping[str, str]) -> dict[str, Any]:
    """The summary of one experiment, run or continued in its folder."""
    from jaxmodel.io.results import read_json
    from jaxmodel.run.cli import execute

    there = "--resume" if (folder / "manifest.json").is_file() else "--out"
    words = [word for key, value in changes.items() for word in (f"--{key}", value)]
    code = execute(["run", f"configs/experiments/{name}.yaml", *words, there, str(folder)])
    if code:
        sys.exit(code)
    return read_json(folder / "summary.json")


def verdicts(summaries: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """One line for each claim that is a comparison: what is said, the methods, both verdicts."""
    from jaxmodel.run.hand_eye.claims import shown

    return [
        (claim["says"], f"{claim['better']} / {claim['worse']}", claim["quantity"].removesuffix("_deg"),
         shown(claim["rms"]), shown(claim["typical"]))
        for summary in summaries.values()
        for claim in summary.get("claims", ())
    ]  # fmt: skip


def statements(summaries: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """One line for each other statement of the report."""
    return [
        (of["says"], of["ours"], of["verdict"])
        for summary in summaries.values()
        for of in summary.get("statements", ())
    ]


def counted(lines: Sequence[tuple[str, ...]]) -> dict[str, int]:
    """How many lines end in each verdict."""
    return {word: sum(line[-1].endswith(word) for line in lines) for word in ("confirmed", "contradicted", "undecided")}


def picture(out: Path, summaries: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Figs 3.2, 3.4 and 3.5, those that were run, with all draws: medians of rotation, and of translation below."""
    from jaxmodel.run.hand_eye import count, noise
    from jaxmodel.run.study_report import read_table
    from jaxmodel.view.chart_drawing import chart_png
    from jaxmodel.view.charts import Chart

    panels = []
    for name, module, figures in (("hand_eye_noise", noise, ("3.2", "3.4")), ("hand_eye_count", count, ("3.5",))):
        if name not in summaries:
            continue
        charts = module.charts(summaries[name], read_table(out / name / "results.parquet"))
        draws = summaries[name]["all_draws"]
        panels += [
            chart.panels for figure in figures for chart in charts if chart.name == f"figure-{figure}-{draws}-draws"
        ]
    return chart_png(Chart("hand_eye", "RR-3507", [of[place] for place in (2, 3) for of in panels]))


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder of all runs (default runs/hand-eye, or runs/hand-eye-quick)")
    parser.add_argument("--quick", action="store_true", help="tiny runs: does it all work?")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), help="only these experiments")
    given = parser.parse_args(words)
    from jaxmodel.run.devices import prepare_devices, quiet_compiler

    quiet_compiler()
    prepare_devices()
    from jaxmodel.io.results import json_text, write_atomically
    from jaxmodel.run.console import write, write_table

    out = given.out or Path("runs") / ("hand-eye-quick" if given.quick else "hand-eye")
    summaries, begun, used = {}, time.perf_counter(), time.process_time()
    for name, quick in PARTS.items():
        if given.only and name not in given.only:
            continue
        started = time.perf_counter()
        write(f"\n=== {name} ===")
        summaries[name] = run(name, out / name, quick if given.quick else {})
        write(f"{name}: {time.perf_counter() - started:.0f} s")
    lines, others = verdicts(summaries), statements(summaries)
    columns = ("published", "ratio", "error of", "ours: RMS (95 %)", "ours: typical draw (95 %)")
    write_table("The claims of RR-3507 put to the test; a ratio below 1 is as claimed", columns, lines)
    write_table("Its other statements", ("published", "ours", "verdict"), others)
    seconds = {"seconds": round(time.perf_counter() - begun, 1), "processor": round(time.process_time() - used, 1)}
    content = {"claims": lines, "typical_draw": counted(lines), "statements": others, "stated": counted(others)}
    write_atomically(out / "claims.json", json_text({**content, **seconds}).encode())
    if {"hand_eye_noise", "hand_eye_count"} & set(summaries):
        write_atomically(out / "hand_eye.png", picture(out, summaries))
    for what in ("typical_draw", "stated"):
        write(f"{what.replace('_', ' ')}: {', '.join(f'{n} {word}' for word, n in content[what].items())}")
    write(f"wrote {out / 'claims.json'}, {seconds['seconds']:.0f} s in all, processor {seconds['processor']:.0f} s")


if __name__ == "__main__":
    main()
