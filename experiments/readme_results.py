"""Write the tables of results into README.md and experiments/README.md, between their marks, from finished runs.

Run it after ``experiments/convergence.py``, ``experiments/chapter2.py``, ``experiments/hand_eye.py``,
``experiments/meshing.py``, ``experiments/next_view.py`` and the scripts of ``experiments/bench`` with
``--write-baseline``: nothing in the tables is typed by hand. With ``--only`` the rows of the other scripts stay as they
are.
"""

import argparse
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxmodel.calibrate.errors import quaternion_error_angle_deg
from jaxmodel.run.published import published_table

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- results: written by experiments/readme_results.py -->", "<!-- end of results -->"
HAND_EYE = "<!-- hand-eye: written by experiments/readme_results.py -->", "<!-- end of hand-eye -->"
MESHES = "<!-- meshes: written by experiments/readme_results.py -->", "<!-- end of meshes -->"
NEXT_VIEW = "<!-- next view: written by experiments/readme_results.py -->", "<!-- end of next view -->"
GROUPS = ("convergence", "chapter2", "hand_eye", "meshing", "next_view", "bench")
METHODS = ("axis/angle", "dual quaternions", "nonlinear", "linear", "self-calibration")
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
            ours = ", ".join(f"{kind} {100 * both['all_pairs']['rate']:.1f} %" for kind, both in row["ours"].items())
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


def hand_eye_rows(folder: Path) -> list[tuple[str, str, str, str]]:
    """RR-3507 in few rows: its tables for the linear method and self-calibration, and how its claims fare."""
    command = "`python experiments/hand_eye.py`"
    verdicts = json.loads((folder / "claims.json").read_text())
    rows = [
        (f"hand-eye, {says}", "as said", f"{ours}: {verdict}", command)
        for says, ours, verdict in verdicts["statements"]
        if "(Table 3." in says
    ]
    for line in _table_rows(folder):
        run, method, *of = line
        if method in ("linear", "self-calibration") and of[0]:
            what = f"hand-eye, {run}, {method}: rotation, translation (simulated robots; median [90 %])"
            rows.append((what, f"{of[0]}, {of[2]}", f"{of[1]}, {of[3]}", command))
    counts = verdicts["typical_draw"], verdicts["stated"]
    words = "; ".join(", ".join(f"{n} {word}" for word, n in of.items() if n) for of in counts)
    rows.append(("hand-eye, claims of RR-3507: comparisons (typical draw, 95 %); other statements", "", words, command))
    return rows


def _table_rows(folder: Path) -> list[tuple[str, ...]]:
    """Run, method, and the errors to the reference of Tables 3.3 and 4.1 and of §4.3: published, ours, for both.

    Two methods that the report has not follow its own: they show where a difference comes from.
    """
    data = published_table("hand_eye")
    tables = (
        ("hand_eye_trajectories", data["table_3_3"], "Table 3.3", "axis/angle with unit axes"),
        ("hand_eye_self_calibration", data["table_4_1"], "Table 4.1", "self-calibration on the target's points"),
    )
    rows = []
    for name, table, where, extra in tables:
        for of in json.loads((folder / name / "summary.json").read_text())["runs"]:
            run, method = of["run"], of["method"]
            ours = _spread(of["angle_deg"], 1, "°"), _spread(of["translation"], 100, " %")
            said = {}
            if run in table and method in METHODS:
                said = {what: values[METHODS.index(method)] for what, values in table[run].items()}
            elif run not in table and method == METHODS[-1]:
                said = data["self_calibration_33"]
            elif method != extra or run not in table:
                continue
            turn = f"{_number(float(quaternion_error_angle_deg(np.array(said['rotation']))))}°" if said else ""
            shift = f"{_number(100 * said['translation'])} %" if said else ""
            label = f"{run} ({where if run in table else '§4.3'})" if said else run
            rows.append((label, method, turn, ours[0], shift, ours[1]))
    return rows


def _spread(of: dict[str, float], factor: float, unit: str) -> str:
    value, low, high = (_number(factor * of[key]) for key in ("value", "low", "high"))
    return f"{value} [{low}, {high}]{unit}"


def _number(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def hand_eye_tables(folder: Path) -> list[str]:
    """Everything RR-3507 says beside ours, as Markdown."""
    verdicts = json.loads((folder / "claims.json").read_text())
    columns = ("run", "method", "rotation: published", "ours", "translation: published", "ours")
    lines = [*_markdown(columns, _table_rows(folder)), ""]
    columns = ("published", "ours", "verdict")
    lines += [*_markdown(columns, verdicts["statements"]), ""]
    said: dict[str, list[tuple[str, ...]]] = {}
    for says, ratio, quantity, _, typical in verdicts["claims"]:
        said.setdefault(says, []).append((f"{quantity}, {ratio}", *typical.rsplit(" ", 1)))
    rows = []
    for says, found in said.items():
        counts = [(sum(of[-1] == word for of in found), word) for word in ("confirmed", "contradicted", "undecided")]
        ours = "; ".join(" ".join(of) for of in found)
        rows.append((says, ours, ", ".join(f"{count} {word}" for count, word in counts if count)))
    return lines + _markdown(("published", "ours: ratio of the errors of a typical draw (95 %)", "verdicts"), rows)


def _markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    cells = [[cell.replace("|", "\\|") for cell in row] for row in (columns, ["---"] * len(columns), *rows)]
    return ["| " + " | ".join(row) + " |" for row in cells]


def write_between(path: Path, marks: tuple[str, str], lines: Sequence[str]) -> None:
    """Replace what stands between two marks of a file."""
    before, rest = path.read_text().split(marks[0])
    _, after = rest.split(marks[1])
    path.write_text(f"{before}{marks[0]}\n\n" + "\n".join(lines) + f"\n\n{marks[1]}{after}")


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
    meshes = (
        f"{value['mesh_vs_open3d_05_1_2']:.2g} x with radii of 0.5, 1, 2 mm, "
        f"{value['mesh_vs_open3d_08_12_2']:.2g} x with 0.8, 1.2, 2 mm"
    )
    march = ", ".join(
        f"{value[f'march_vs_castray_{scene}_{cells}']:.0f} x ({name}, {cells}³)"
        for scene, name in (("room", "room"), ("around", "object"))
        for cells in (64, 128)
    )
    rays = f"{march}; one decision on a 64³ map {value['next_view_seconds_64']:.2f} s"
    memory = f"{value['peak_memory_100000_vs_1000']:.2f} x"
    return [
        ("starts/s of plain point-to-point ICP, 2 cores", "", sweep, "`python experiments/bench/sweep_vs_peers.py`"),
        ("lane engine against `vmap(while_loop)`", "", lanes, "`python experiments/bench/lane_engine.py`"),
        (
            "ten bunny scans thinned, meshed and segmented, against Open3D's bare ball pivoting",
            "",
            meshes,
            "`python experiments/bench/mesh_vs_open3d.py`",
        ),
        (
            "rays/s of the exact march, 2 cores, against pyoctomap's `castRay`, one Python call a ray",
            "",
            rays,
            "`python experiments/bench/ray_march_vs_octomap.py`",
        ),
        ("peak memory, 100 000 starts against 1000", "", memory, "`python experiments/bench/memory.py`"),
    ]


BASELINE = ROOT / "experiments" / "bench" / "baseline.json"


def tables_of(folder: Path) -> list[str]:
    """Every table that a script left in ``results.json``, as Markdown."""
    lines = []
    for table in json.loads((folder / "results.json").read_text())["tables"]:
        lines += [f"*{table['title']}*", "", *_markdown(table["columns"], table["rows"]), ""]
    return lines[:-1]


def rows_by_script(readme: str) -> dict[str, list[tuple[str, ...]]]:
    """The rows that a README has, by the script of their last cell; "the same" is that of the row before."""
    table = readme.split(BEGIN)[1].split(END)[0].strip().splitlines()[2:]
    found: dict[str, list[tuple[str, ...]]] = {}
    script = ""
    for line in table:
        cells = tuple(cell.replace("\\|", "|") for cell in re.split(r"(?<!\\) \| ", line[2:-2]))
        script = script if cells[-1] == "the same" else _group(cells[-1])
        found.setdefault(script, []).append(cells)
    return found


def _group(command: str) -> str:
    return "bench" if "/bench/" in command else Path(command.strip("`").split(" ")[1]).stem


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, default=Path("runs/convergence"), help="--out of convergence.py")
    parser.add_argument("--chapter", type=Path, default=Path("runs/chapter2"), help="--out of chapter2.py")
    parser.add_argument("--hand-eye", type=Path, default=Path("runs/hand-eye"), help="--out of hand_eye.py")
    parser.add_argument("--meshes", type=Path, default=Path("runs/meshing"), help="--out of meshing.py")
    parser.add_argument("--next-view", type=Path, default=Path("runs/next_view"), help="--out of next_view.py")
    parser.add_argument("--only", nargs="+", choices=GROUPS, default=GROUPS, help="only the rows of these scripts")
    given = parser.parse_args()
    readme, page, pictures = ROOT / "README.md", ROOT / "experiments" / "README.md", ROOT / "experiments" / "pictures"
    rows = rows_by_script(readme.read_text())
    made = {
        "convergence": lambda: convergence_rows(given.runs),
        "chapter2": lambda: chapter_rows(given.chapter),
        "hand_eye": lambda: hand_eye_rows(given.hand_eye),
        "meshing": lambda: json.loads((given.meshes / "results.json").read_text())["rows"],
        "next_view": lambda: json.loads((given.next_view / "results.json").read_text())["rows"],
        "bench": benchmark_rows,
    }
    rows |= {name: made[name]() for name in given.only}
    found = [row for name in GROUPS for row in rows.get(name, [])]
    write_between(readme, (BEGIN, END), _markdown(("what", "published", "ours", "command"), found))
    if "hand_eye" in given.only:
        write_between(page, HAND_EYE, hand_eye_tables(given.hand_eye))
        shutil.copyfile(given.hand_eye / "hand_eye.png", pictures / "hand_eye.png")
    if "meshing" in given.only:
        write_between(page, MESHES, tables_of(given.meshes))
        shutil.copyfile(given.meshes / "meshing.png", pictures / "meshing.png")
    if "next_view" in given.only:
        write_between(page, NEXT_VIEW, tables_of(given.next_view))
        shutil.copyfile(given.next_view / "next_view.png", pictures / "next_view.png")
    if "convergence" in given.only:
        shutil.copyfile(given.runs / PICTURE, pictures / "convergence.png")
    if "chapter2" in given.only:
        shutil.copyfile(given.chapter / "conclusion.png", pictures / "chapter2.png")
    print(f"wrote {len(found)} rows to {readme}")


if __name__ == "__main__":
    main()
