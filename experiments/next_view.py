"""The experiments on next best views of thesis chapter 4 from one command: Figs 4.2 to 4.13, and what it leaves open.

Runs all five (each is also one ``jaxmodel run CONFIG``), prints their tables *published | ours*, and leaves what the
READMEs show of them in ``results.json`` and ``next_view.png``. Started again, it goes on where it was. Without the data
folder, only the built-in objects are modelled.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple


class Part(NamedTuple):
    """The experiment's module, and what ``--quick`` and a missing data folder change, dotted key -> YAML."""

    module: str
    quick: Mapping[str, str]
    without_data: Mapping[str, str]


_BUILT_IN = {"objects": "[y_pipe, valve, block_curved, gourd, stepped_block]"}
_COARSE = {"search.views": "200", "search.spiral": "8", "search.rays": "256", "search.fine": "256"}
PARTS: Mapping[str, Part] = {
    "next_view_search": Part(
        "search_study",
        {"objects": "[gourd]", "maps": "2", "starts": "1", "field_views": "1000", "scene.cells": "32",
         "methods": "[pattern, views, hill_climbing]", **_COARSE},
        _BUILT_IN,
    ),
    "next_view_objects": Part(
        "objects_study",
        {"objects": "[gourd]", "planners": "[utility, random]", "registered": "[]", "noises": "[0.0]",
         "loop.views": "3", "scene.cells": "32", "scene.pixels": "64", **_COARSE},
        _BUILT_IN,
    ),
    "next_view_cube": Part("environment_study", {"loop.views": "3", "place.pixels": "48", **_COARSE}, {}),
    "next_view_rooms": Part(
        "environment_study",
        {"loop.views": "2", "voxels": "[0.5]", "planners": "[utility]", "place.pixels": "48", **_COARSE},
        {},
    ),
    "next_view_arm": Part(
        "arm_study",
        {"loop.views": "2", "bases": "[fixed, moving]", "scene.cells": "32", "scene.pixels": "48", "reach.views": "40",
         "reach.places": "0", "reach.elevations": "[45]", "reach.circle_views": "24", **_COARSE},
        {},
    ),
}  # fmt: skip
COMMAND = "`python experiments/next_view.py`"
Row = tuple[str, str, str, str]


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


def rows_of(name: str, summary: Mapping[str, Any]) -> list[Row]:
    """What the README shows of one experiment."""
    makers = {
        "next_view_search": search_rows,
        "next_view_objects": object_rows,
        "next_view_cube": environment_rows,
        "next_view_rooms": environment_rows,
        "next_view_arm": arm_rows,
    }
    return makers[name](summary)


def search_rows(summary: Mapping[str, Any]) -> list[Row]:
    """How near the view found comes to the best of the field."""
    from jaxmodel.run.planning.search_report import NAMES, PUBLISHED

    return [
        (
            f"next view, {NAMES[of['method']]}: 0.99 of the best of {summary['field_views']} views (§4.3.2)",
            PUBLISHED.get(of["method"], ""),
            f"on {100 * of['reached']:.1f} % of {of['maps']} maps, mean {of['mean']:.3f}, {of['seconds']:.2f} s",
            COMMAND,
        )
        for of in summary["methods"]
        if of["method"] in ("pattern", "hill_climbing")
    ]


def object_rows(summary: Mapping[str, Any]) -> list[Row]:
    """Coverage by planner, noise-free and not."""
    from jaxmodel.run.planning.objects_report import planner_name
    from jaxmodel.run.planning.summary import FEW, MANY

    rows = []
    for of in summary["planners"]:
        curve = of["coverage"]
        marks = ", ".join(f"{100 * curve[min(k, len(curve)) - 1]:.1f} % after {k}" for k in (FEW, MANY))
        ours = f"{marks} views; area {of['area_few']:.3f}; {of['views']:.1f} views"
        what = f"{len(summary['objects'])} objects, {planner_name(of)}: part seen of what can be seen (§4.5)"
        rows.append((what, "no numbers", ours, COMMAND))
    return rows


def environment_rows(summary: Mapping[str, Any]) -> list[Row]:
    """The table *published | ours* of the cube or the rooms."""
    from jaxmodel.run.planning.environment_report import tables

    names = {"cube": "cube by pan and tilt (Figs 4.5-4.8)", "two_rooms": "two rooms (Figs 4.10, 4.11)"}
    last = tables(summary, "")[-1]
    return [(f"{names[summary['environment']]}, {row[0]}", row[1], row[2], COMMAND) for row in last.rows]


def arm_rows(summary: Mapping[str, Any]) -> list[Row]:
    """What the arm sees, with its base fixed and moving."""
    from jaxmodel.run.planning.arm_report import tables

    last = tables(summary, "")[-1]
    return [
        (f"{summary['object']} by an arm, {row[0]}: part seen after 1, 3, 5, 10, all views (§4.5)", row[1],
         row[2] if not row[3] else f"{row[2]} ({row[3]} views, {row[4]} places of the base)", COMMAND)
        for row in last.rows
    ]  # fmt: skip


def results(summaries: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """``rows`` of the README's table, and the ``tables`` of all experiments for the page of experiments."""
    rows: list[Row] = []
    shown = []
    for name, summary in summaries.items():
        rows += rows_of(name, summary)
        module = import_module(f"jaxmodel.run.planning.{PARTS[name].module}")
        for table in module.tables(summary, f"jaxmodel run {name}"):
            if table.title != "Share of the reachable surface seen":  # run by run: the report shows it
                shown.append(table._asdict())
    return {"rows": rows, "tables": shown}


def picture(out: Path, summary: Mapping[str, Any]) -> bytes:
    """An object by the view that first saw it, and its map, for two of the objects."""
    from jaxmodel.io.results import RunDir
    from jaxmodel.run.meshing.drawing_data import kept
    from jaxmodel.view.mesh_figure import MeshPanel, mesh_png

    panels = []
    with RunDir.resume(out / "next_view_objects") as folder:
        names = list(summary["objects"])
        for name in [name for name in ("bunny", "valve") if name in names] or names[:2]:
            drawn = kept(folder, f"object{names.index(name):03d}")
            panels += [
                MeshPanel(f"{name}: views, and what each saw first", *drawn["views"]),
                MeshPanel(f"{name}: the map at the end", *drawn["map"]),
            ]
    return mesh_png(panels)


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder of all runs (default runs/next_view, or runs/next_view-quick)")
    parser.add_argument("--quick", action="store_true", help="tiny runs: does it all work?")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), help="only these experiments")
    given = parser.parse_args(words)
    from jaxmodel.run.devices import prepare_devices, quiet_compiler

    quiet_compiler()
    prepare_devices()
    from jaxmodel.io.datasets import data_root
    from jaxmodel.io.results import json_text, write_atomically
    from jaxmodel.run.console import write

    out = given.out or Path("runs") / ("next_view-quick" if given.quick else "next_view")
    begun, summaries = time.perf_counter(), {}
    for name, part in PARTS.items():
        if given.only and name not in given.only:
            continue
        started = time.perf_counter()
        write(f"\n=== {name} ===")
        summaries[name] = run(name, out / name, part.quick if given.quick else {} if data_root() else part.without_data)
        write(f"{name}: {time.perf_counter() - started:.0f} s")
    write_atomically(out / "results.json", json_text(results(summaries)).encode())
    if "next_view_objects" in summaries:
        write_atomically(out / "next_view.png", picture(out, summaries["next_view_objects"]))
    write(f"all in {out}, {time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
