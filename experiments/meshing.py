"""The experiments on meshes of thesis chapters 3 and 5 from one command: Tables 3.1, 3.2 and 5.2 and their figures.

Runs both experiments (each is also one ``jaxmodel run CONFIG``), prints their tables *published | ours*, and draws the
README's picture. Started again, it goes on where it was. Without the data folder, built-in objects take the place of
Hoppe's clouds and of the bunny.
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


_BUILT_IN = "[{kind: pot, name: pot, stands_for: teapot, count: 26103}, "
    "{kind: object, name: torso, object: torso, count: 8000}]"
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
    from jaxmodel.io.results import write_atomically
    from jaxmodel.run.console import write

    out = given.out or Path("runs") / ("meshing-quick" if given.quick else "meshing")
    begun = time.perf_counter()
    for name, part in PARTS.items():
        if given.only and name not in given.only:
            continue
        started = time.perf_counter()
        write(f"\n=== {name} ===")
        run(name, out / name, part.quick if given.quick else {} if data_root() else part.without_data)
        write(f"{name}: {time.perf_counter() - started:.0f} s")
    if not given.only or "mesh_segments" in given.only:
        write_atomically(out / "meshing.png", picture(out))
    write(f"all in {out}, {time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
