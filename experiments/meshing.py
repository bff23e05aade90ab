"""The experiments on meshes of thesis chapters 3 and 5 from one command: Tables 3.1, 3.2 and 5.2 and their figures.

Runs both experiments (each is also one ``jaxmodel run CONFIG``), prints their tables *published | ours*, and leaves
what the READMEs show of them in ``results.json`` and ``meshing.png``. Started again, it goes on where it was. Without
the data folder, built-in objects take the place of Hoppe's clouds and of the bunny.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple


class Part(NamedTuple):
    """What ``--quick`` and what a missing data folder change, dotted key -> YAML."""

    quick: Mapping[str, str]
    without_data: Mapping[str, str]


_POT = "{kind: pot, name: pot, stands_for: teapot, count: 26103}"
_BUILT_IN = f"[{_POT}, {{kind: object, name: torso, object: torso, count: 8000}}]"
PARTS: Mapping[str, Part] = {
    "mesh_quality": Part(
        {
            "objects": "[{kind: pot, name: pot, stands_for: teapot, count: 8000}, {kind: object, name: torso, "
            "object: torso, stands_for: scurv, count: 6000}]",
            "methods": "[ball, ball_thinned, deformable_5]",
            "runs": "1",
            "sweep": "[torso]",
            "radii": "[1.0, 2.0]",
            "passes": "[torso]",
        },
        {"objects": _BUILT_IN, "sweep": "[torso]", "passes": "[]"},
    ),
    "mesh_segments": Part(
        {
            "scenes": "[one_plane, crossing_planes, nine_facets]",
            "methods": "[ball-pivoting, deformable]",
            "method_points": "1500",
            "order": "3",
            "grow": "boulder",
        },
        {"grow": "boulder"},
    ),
}


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


Row = tuple[str, str, str, str]


def quality_rows(summary: Mapping[str, Any]) -> list[Row]:
    """Table 3.2 in the README: each object, the ranking counted, what the text says beside it."""
    from jaxmodel.run.meshing.quality_tables import tables
    from jaxmodel.run.published import published_table

    published = published_table("mesh_quality")["objects"]
    of = {(row["object"], row["method"]): row for row in summary["rows"]}
    rows: list[Row] = []
    for name, stands_for in summary["stands_for"].items():
        ball, surface = of.get((name, "ball_thinned")), of.get((name, "deformable_5"))
        if not stands_for or not ball or not surface:
            continue
        said = published[stands_for]
        known = stands_for if stands_for == name else f"{name} for {stands_for}"
        what = f"Q_equ, Q_nor of ball pivoting; of the deformable surface (Table 3.2; {known})"
        rows.append((what, _criteria(said["ball"], said["deformable_5"]), _criteria(ball, surface), COMMAND))
    shown = {table.title: table for table in tables(summary, "")}
    for criterion, said, thinned, _ in shown["The ranking of Table 3.2, counted"].rows:
        rows.append((f"ball pivoting better than the surface by {criterion} (Table 3.2)", said, thinned, COMMAND))
    verdicts = [row[-1] for row in shown["Statements of thesis §3.5.3 and Table 3.1"].rows]
    counted = ", ".join(f"{verdicts.count(word)} {word}" for word in ("reproduced", "contradicted"))
    rows.append(("what the text says of both methods (§3.5.3, Table 3.1)", "as said", counted, COMMAND))
    return rows


def _criteria(*of: Mapping[str, Any]) -> str:
    return "; ".join(f"{one['Q_equ']:.3f}, {one['Q_nor']:.3f}" for one in of)


def segments_rows(summary: Mapping[str, Any]) -> list[Row]:
    """Table 5.2, Table 3.1 and Fig. 3.1 in the README."""
    from jaxmodel.run.published import published_table

    known = published_table("mesh_segments")
    rows: list[Row] = []
    for of in summary["scenes"]:
        said = known["scenes"].get(of["scene"])
        if said:
            what = f"triangles; segments of several views (Table 5.2, Fig. {said['figure']}; {of['scene']}, simulated)"
            true, count = (of["expected_planes"], of["planes"]) if of["expected_planes"] else (
                of["expected_segments"], of["segments"])  # fmt: skip
            ours = f"{of['after']}, {of['lying_over']} of them over another; {count} of {true}"
            rows.append((what, f"{said['after']}; {said['segments']}", ours, COMMAND))
    for of in summary["methods"]:
        said = known["methods"].get(of["method"])
        if said:
            ours = (f"half a ball: {of['opening']} border; a ball: {'closed' if of['closed'] else 'open'}; "
                    f"{100 * of['hollow']:.0f} % of a hollow followed")  # fmt: skip
            words = f"{said['openings']}; {said['closed']}; concavities: {said['concavities']}"
            rows.append((f"{of['method']} (Table 3.1)", words, ours, COMMAND))
    if summary["growth"]:
        first, last = summary["growth"][0], summary["growth"][-1]
        ours = (f"{first['kept_triangles']} of {first['of_triangles']} triangles stay when view 2 comes; at the end "
                f"{last['triangles']} in {last['components']} part, {last['lying_over']} over another")  # fmt: skip
        rows.append(("view 1's mesh grown from its border by three views (Fig. 3.1)", "a picture", ours, COMMAND))
    return rows


COMMAND = "`python experiments/meshing.py`"


def results(summaries: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """``rows`` of the README's table, and every ``tables`` of both experiments for the page of experiments."""
    from jaxmodel.run.meshing import quality_tables, segments_report

    rows: list[Row] = []
    shown = []
    for name, summary in summaries.items():
        made, tables = (
            (quality_rows, quality_tables.tables) if name == "mesh_quality" else (segments_rows, segments_report.tables)
        )
        rows += made(summary)
        of_run = tables(summary, f"jaxmodel run {name}")
        shown += [table._asdict() for table in of_run if not table.title.startswith("One pass")]  # a figure shows it
    return {"rows": rows, "tables": shown}


def picture(out: Path) -> bytes:
    """Figs 3.11 and 5.4: the views, and the segments of the one mesh made of them."""
    from jaxmodel.io.results import RunDir
    from jaxmodel.run.meshing.drawing_data import kept
    from jaxmodel.view.mesh_figure import MeshPanel, mesh_png

    panels = []
    with RunDir.resume(out / "mesh_segments") as folder:
        for scene in ("crossing_planes", "nine_facets"):
            drawn = kept(folder, scene)
            views, mesh = f"{scene}: the views", f"{scene}: one mesh, its segments"
            panels += [MeshPanel(views, *drawn["views"]), MeshPanel(mesh, *drawn["mesh"])]
    return mesh_png(panels)


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder of both runs (default runs/meshing, or runs/meshing-quick)")
    parser.add_argument("--quick", action="store_true", help="tiny runs: does it all work?")
    parser.add_argument("--only", nargs="+", choices=list(PARTS), help="only these experiments")
    given = parser.parse_args(words)
    from jaxmodel.run.devices import prepare_devices, quiet_compiler

    quiet_compiler()
    prepare_devices()
    from jaxmodel.io.datasets import data_root
    from jaxmodel.io.results import json_text, write_atomically
    from jaxmodel.run.console import write

    out = given.out or Path("runs") / ("meshing-quick" if given.quick else "meshing")
    begun, summaries = time.perf_counter(), {}
    for name, part in PARTS.items():
        if given.only and name not in given.only:
            continue
        started = time.perf_counter()
        write(f"\n=== {name} ===")
        summaries[name] = run(name, out / name, part.quick if given.quick else {} if data_root() else part.without_data)
        write(f"{name}: {time.perf_counter() - started:.0f} s")
    write_atomically(out / "results.json", json_text(results(summaries)).encode())
    if not given.only or "mesh_segments" in given.only:
        write_atomically(out / "meshing.png", picture(out))
    write(f"all in {out}, {time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
