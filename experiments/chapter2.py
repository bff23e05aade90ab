"""The experiments of thesis chapter 2 from one command, ending with its conclusion put to the test.

Runs every experiment of the chapter (each is also one ``jaxmodel run CONFIG``), prints their tables *published | ours*,
and then asks: contours better on structured objects, mesh vertices on free-form ones? Convergence rate, final true
error, iterations and time, each with a 95 % interval over pairs of scans. Started again, it goes on where it was.
Without the real data the experiments run on the built-in objects alone.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import polars

ROOT = Path(__file__).resolve().parents[1]


class Part(NamedTuple):
    """One experiment. ``quick``: what ``--quick`` changes, dotted key -> YAML, beside the groups."""

    config: str
    quick: Mapping[str, str] = {}
    bunny: bool = False
    """Real scans only, so that there is nothing to run without them."""


_CONVERGENCE = {
    "starts": "{kind: euler, steps: 3, translation: centroids}", "claims.starts": "0", "claims.permutations": "19",
    "control_points": "[{kind: contours, count: 150, labels: [crease, depth, border]}, {kind: vertices, count: 150}]",
}  # fmt: skip
_TWO_STARTS = {"counts": "[150]", "draws": "1", "starts.count": "3", "resamples": "200"}
PARTS = (
    Part("edges", {"views": "1", "noises": "[0.0, 0.002]", "sensor": "{width: 100, height: 100}"}),
    Part("bunny_contours", bunny=True),
    Part(
        "objects_contours",
        {**_CONVERGENCE, "scans.names": "[block_steps, torso]", "scans.sensor": "{width: 90, height: 90}"},
    ),
    Part(
        "resolution",
        {
            **_TWO_STARTS,
            "counts": "[150, 100]",
            "combined": "{high: 150, low: 80}",
            "two_steps": "{high: 150, low: 60}",
        },
    ),
    Part("resolution_bunny", bunny=True),
    Part("overlap", {**_TWO_STARTS, "angles_deg": "[20, 60]"}),
    Part("iterations", {**_TWO_STARTS, "tests": "2"}),
    Part("user_starts", _TWO_STARTS),
    Part("cylinder", _TWO_STARTS),
    Part("global_table", _TWO_STARTS),
)
_QUICK_GROUP = {
    "control_points": [{"kind": "contours", "labels": ["crease", "depth", "border"]}, {"kind": "vertices"}],
    "scans": {
        "kind": "objects",
        "views_deg": [0, 20],
        "turns_deg": [0, 90],
        "sensor": {"width": 90, "height": 90},
    },
}
CLAIMS = {
    ("structured", "rate"): "contours",
    ("structured", "rotation_error_deg"): "contours",
    ("structured", "translation_error_of_size"): "contours",
    ("structured", "steps"): "contours",
    ("free_form", "rate"): "vertices",
    ("free_form", "rotation_error_deg"): "vertices",
    ("free_form", "translation_error_of_size"): "vertices",
    ("free_form", "steps"): "vertices",
}
"""What thesis §2.9.6 says is better; of times it says nothing."""


def changes(part: Part, quick: bool, has_data: bool) -> list[tuple[str, str]]:
    """What is changed of a part's configuration: for ``--quick``, and where the real data are not there."""
    from jaxmodel.io.strict_yaml import config_files, read_yaml

    found = list(part.quick.items()) if quick else []
    groups = read_yaml(config_files() / "experiments" / f"{part.config}.yaml").get("groups")
    if groups is None:
        return found
    if quick:
        names = [("BLOCK2", "block_steps"), ("HAPPY", "torso")]
        groups = [
            {**_QUICK_GROUP, "stands_for": stands_for, "scans": {**_QUICK_GROUP["scans"], "names": [name]}}
            for stands_for, name in names
        ]
        return [*found, ("groups", json.dumps(groups))]
    if has_data or part.bunny:
        return found
    kept = [group for group in groups if group["scans"]["kind"] == "objects"]
    if not kept:  # every object of the experiment is a mesh of the data folder: a built-in one stands in
        scans = {**groups[0]["scans"], "kind": "objects", "names": ["block_steps"]}
        scans.pop("family", None)
        kept = [{**groups[0], "scans": scans}]
    return [*found, ("groups", json.dumps(kept))]


def run(part: Part, folder: Path, given: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """The summary of one part, run or continued in its folder."""
    from jaxmodel.io.results import read_json
    from jaxmodel.run.cli import execute

    there = "--resume" if (folder / "manifest.json").is_file() else "--out"
    words = [word for key, value in given for word in (f"--{key}", value)]
    code = execute(["run", f"configs/experiments/{part.config}.yaml", *words, there, str(folder)])
    if code:
        sys.exit(code)
    return read_json(folder / "summary.json")


def convergence_rows(folders: Sequence[Path]) -> polars.DataFrame:
    """Rows of finished convergence runs in the shape of a study's, a trial for each pair."""
    from jaxmodel.io.results import read_json

    parts, before = [], 0
    for folder in folders:
        cases = read_json(folder / "summary.json")["cases"]
        families = {case["pair"]: case["family"] for case in cases}
        numbers = {pair: before + place for place, pair in enumerate(families)}
        before += len(numbers)
        parts.append(
            polars.read_parquet(
                folder / "results.parquet",
                columns=["pair", "control_points", "start", "right", "steps", "rotation_error_deg"],
            ).with_columns(
                polars.col("pair").replace_strict(numbers, return_dtype=polars.Int32).alias("trial"),
                polars.col("pair").replace_strict(families, return_dtype=polars.String).alias("family"),
                polars.lit(float("nan")).alias("translation_error_of_size"),
            )
        )
    return polars.concat(parts, how="vertical")


def conclusion(out: Path, summaries: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Kind of starts -> family -> contours compared with vertices."""
    from jaxmodel.io.results import json_text
    from jaxmodel.run.chapter2.comparison import by_family

    found = {}
    if "global_table" in summaries:
        found["close starts"] = summaries["global_table"]["comparison"]
    if "user_starts" in summaries:
        found["starts as by a user"] = summaries["user_starts"]["comparison"]
    grids = [out / name for name in ("bunny_contours", "objects_contours") if name in summaries]
    if grids:
        found["all rotations"] = by_family(convergence_rows(grids), [])
    return json.loads(json_text(found))  # what is not a number is null, here as in the summaries


def verdict_lines(found: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """One line for each figure of each family and kind of starts, with the thesis's word and ours."""
    from jaxmodel.run.chapter2.comparison import FIGURES, text, verdict

    lines = []
    for starts, families in found.items():
        for family, compared in families.items():
            for figure in FIGURES:
                of = compared["figures"][figure.key]
                if of["difference"]["value"] is None:
                    continue
                said, ours = CLAIMS.get((family, figure.key), "nothing"), verdict(compared, figure)
                word = "undecided" if ours == "undecided" else "confirmed" if ours == said else "contradicted"
                lines.append(
                    (
                        f"{family.replace('_', '-')}, {starts}",
                        figure.what,
                        said,
                        *(text(of[kind], figure) for kind in compared["kinds"]),
                        text(of["difference"], figure, signed=True),
                        ours if said == "nothing" or ours == "undecided" else f"{ours}: {word}",
                    )
                )
    return lines


VERDICT_COLUMNS = (
    "objects, starts", "figure", "thesis: better is", "contours", "vertices", "difference, 95 % interval", "ours",
)  # fmt: skip


def answers(lines: Sequence[tuple[str, ...]], found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The chapter's question answered in sentences, one for each family."""
    sentences = []
    for family, claimed in (("structured", "contours"), ("free-form", "vertices")):
        mine = [line for line in lines if line[0].startswith(f"{family},") and line[2] != "nothing"]
        if not mine:
            continue
        counted = {word: [f"{line[1]} ({line[0].split(', ', 1)[1]})" for line in mine if line[-1].endswith(word)]
                   for word in ("confirmed", "contradicted", "undecided")}  # fmt: skip
        parts = [f"{word} in {len(which)}: {', '.join(which)}" for word, which in counted.items() if which]
        sentences.append(f"{family} objects, {claimed} better? {'; '.join(parts)}.")
    tests = {starts: sum(of["tests"] for of in families.values()) for starts, families in found.items()}
    sentences.append(f"Tests, each with both kinds: {', '.join(f'{n} from {starts}' for starts, n in tests.items())}.")
    return sentences


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder of all runs (default runs/chapter2, or runs/chapter2-quick)")
    parser.add_argument("--quick", action="store_true", help="tiny runs on two built-in objects: does it all work?")
    parser.add_argument("--only", nargs="+", choices=[part.config for part in PARTS], help="only these experiments")
    given = parser.parse_args(words)
    from jaxmodel.run.devices import prepare_devices, quiet_compiler

    quiet_compiler()
    prepare_devices()
    from jaxmodel.io.datasets import data_root
    from jaxmodel.run.chapter2.comparison import chart
    from jaxmodel.run.console import write, write_table

    out = given.out or Path("runs") / ("chapter2-quick" if given.quick else "chapter2")
    root = data_root()
    has_bunny, has_meshes = (root is not None and (root / name).is_dir() for name in ("stanford_bunny", "meshes"))
    summaries, begun = {}, time.perf_counter()
    for part in PARTS:
        left_out = part.bunny and (given.quick or not has_bunny)
        if left_out or (given.only and part.config not in given.only):
            continue
        started = time.perf_counter()
        write(f"\n=== {part.config} ===")
        changed = changes(part, given.quick, has_bunny and has_meshes)
        summaries[part.config] = run(part, out / part.config, changed)
        write(f"{part.config}: {time.perf_counter() - started:.0f} s")
    found = conclusion(out, summaries)
    lines = verdict_lines(found)
    write_table("The conclusion of chapter 2 put to the test", VERDICT_COLUMNS, lines)
    said = answers(lines, found)
    for sentence in said:
        write(sentence)
    from jaxmodel.io.results import json_text, write_atomically
    from jaxmodel.view.chart_drawing import chart_png

    bars = {f"{family[:10]}, {starts}": of for starts, families in found.items() for family, of in families.items()}
    if bars:
        write_atomically(out / "conclusion.png", chart_png(chart("conclusion", "Conclusion of chapter 2", bars)))
    seconds = round(time.perf_counter() - begun, 1)
    write_atomically(
        out / "conclusion.json",
        json_text({"answers": said, "lines": lines, "comparison": found, "seconds": seconds}).encode(),
    )
    write(f"wrote {out / 'conclusion.json'} and conclusion.png, {seconds:.0f} s in all")


if __name__ == "__main__":
    main()
