"""What each command does, from its parsed words to a finished folder."""

import math
from pathlib import Path
from typing import Any

from jaxmodel.errors import InputError, RunError
from jaxmodel.io.results import RunDir, json_text, read_json
from jaxmodel.io.strict_yaml import config_files, override, read_yaml
from jaxmodel.run import arguments, console
from jaxmodel.run.devices import prepare_devices
from jaxmodel.run.faults import fault_tables
from jaxmodel.run.provenance import check_same, manifest
from jaxmodel.run.registry import EXPERIMENTS, experiment_module, load_experiment, prepare_experiment

POINTS = 2000
"""Control points of each scan, where no number is given."""
REGISTER_STARTS = 500
"""Evenly spread starts that ``jaxmodel register`` tries with a method or control points but no first guess."""


def run(command: arguments.Run, changes: list[tuple[str, str]], line: str) -> None:
    """``jaxmodel run``: any experiment from its YAML."""
    path = _config_path(command.config)
    raw = override(read_yaml(path), changes, str(path))
    run_experiment(raw, str(path), folder_of(command, path.stem), command.resume is not None, command.json, line)


def sweep(command: arguments.Sweep, line: str) -> None:
    """``jaxmodel sweep``: the convergence experiment on one pair of files."""
    from jaxmodel.run.config import MOST_STARTS

    if not 1 <= command.starts <= MOST_STARTS:
        raise InputError(f"--starts is {command.starts}, expected 1 to {MOST_STARTS}")
    starts: dict[str, Any] = {"kind": "even", "count": command.starts}
    if command.grid == "euler":
        starts = {"kind": "euler", "steps": math.ceil(round(command.starts ** (1 / 3), 9)), "count": command.starts}
    engine = {name: getattr(command, name) for name in ("executor", "lanes", "chunk", "order")}
    raw = _filerun_experiment(command, command.truth, starts) | {"engine": engine}
    out, resumed = folder_of(command, None), command.resume is not None
    run_experiment(raw, "jaxmodel sweep", out, resumed, command.json, line)


def register(command: arguments.Register, line: str) -> None:
    """``jaxmodel register``: one motion, in ``transform.json``; a search that finds none it believes ends with 1."""
    out, resumed = folder_of(command, None), command.resume is not None
    chosen = command.control_points != "subsample" or command.labels != ("crease",) or command.count is not None
    searched = command.init is None and command.method is None and not chosen
    raw = _search_experiment(command) if searched else _filerun_experiment(command, None, _starts(command))
    summary = run_experiment(raw, "jaxmodel register", out, resumed, False, line)
    from jaxmodel.run.single import searched_transform, transform_of

    if searched:
        result = searched_transform(command.target, command.source, summary["pairs"][0])
    else:
        result = transform_of(command.target, command.source, summary["cases"][0])
    with RunDir.resume(out) as folder:
        folder.write_json("transform.json", result)
    console.write(f"wrote {out / 'transform.json'}: {result['sentence']}, overlap {result['overlap']:.2f}")
    if searched and result["free"]["kind"] != "held":
        console.write(f"note: the shared surface is {result['free']['sentence']}")
    refused = searched and result["outcome"] == "refused"
    if command.json:
        status = "failed" if refused else "ok"
        console.write(json_text({"status": status, "out": str(out), **result}, indent=None))
    if refused:
        told = f"{result['sentence']} (confidence {result['confidence']:.2f})"
        raise RunError(f"{told}; the best pose is in {out / 'transform.json'}")


def align(command: arguments.Align, line: str) -> None:
    """``jaxmodel align``: the experiment ``multiview`` on scan files."""
    raw: dict[str, Any] = {
        "experiment": "multiview",
        "seed": command.seed,
        "scans": {
            "kind": "files",
            "paths": [str(path.absolute()) for path in command.scans],
            "truth": None if command.truth is None else str(command.truth.absolute()),
        },
        "orders": [command.order],
    }
    out, resumed = folder_of(command, None), command.resume is not None
    summary = run_experiment(raw, "jaxmodel align", out, resumed, command.json, line)
    placed = sum(view["placed"] for view in summary["views"])
    console.write(f"wrote {out / 'poses.json'} and {out / 'merged.ply'}: {placed} of {len(summary['views'])} scans")
    if summary["left_out"]:
        console.write(f"note: no pair that is believed joins {', '.join(summary['left_out'])} to the others")


def _starts(command: arguments.Register) -> dict[str, Any]:
    if command.init is None:
        return {"kind": "even", "count": REGISTER_STARTS}
    return {"kind": "file", "path": str(command.init.absolute())}


def _search_experiment(command: arguments.Register) -> dict[str, Any]:
    """The experiment ``search`` on two files, as a YAML would say it."""
    files = {"target": str(command.target.absolute()), "source": str(command.source.absolute())}
    return {"experiment": "search", "seed": command.seed, "scans": [{"kind": "files", **files}]}


def _filerun_experiment(
    command: arguments.Sweep | arguments.Register, truth: Path | None, starts: dict[str, Any]
) -> dict[str, Any]:
    """The convergence experiment on two files, as a YAML would say it."""
    return {
        "experiment": "convergence",
        "seed": command.seed,
        "scans": {
            "kind": "files",
            "target": str(command.target.absolute()),
            "source": str(command.source.absolute()),
            "truth": None if truth is None else str(truth.absolute()),
        },
        "control_points": [_control_points(command)],
        "starts": starts,
        "method": command.method or "thesis_2005",
        "claims": {"starts": 0},
    }


def _control_points(command: arguments.Sweep | arguments.Register) -> dict[str, Any]:
    chosen: dict[str, Any] = {"kind": command.control_points, "count": command.count or POINTS}
    if command.control_points == "contours":
        return chosen | {"labels": list(command.labels)}
    if command.labels != ("crease",):
        raise InputError(f"--labels needs --control-points contours, not {command.control_points}")
    return chosen


def report(command: arguments.Report) -> None:
    """``jaxmodel report``: draw a finished run again."""
    summary = read_json(command.folder / "summary.json")
    name = summary.get("experiment")
    if name not in EXPERIMENTS:
        raise InputError(f"{command.folder}: holds no experiment of this version, so there is nothing to draw")
    with RunDir.resume(command.folder) as folder:
        figures = experiment_module(name).draw(folder, summary)
    console.write(f"wrote {command.folder / 'report.html'} and {len(figures)} figures")
    if command.json:
        content = {"status": "ok", "out": str(command.folder), "report": "report.html", "figures": figures}
        console.write(json_text(content, indent=None))


def run_experiment(raw: dict[str, Any], where: str, out: Path, resumed: bool, json: bool, line: str) -> dict[str, Any]:
    """Run an experiment given as its YAML would say it, or go on with it, and show what came out; its summary."""
    if not resumed:
        RunDir.refuse(out)
    elif not out.is_dir():
        raise InputError(f"{out}: no such folder, nothing to resume")
    prepare_devices()
    name, config = load_experiment(raw, where)
    prepared = prepare_experiment(name, config)
    about = manifest(name, prepared.resolved, prepared.inputs, line)
    folder = RunDir.resume(out) if resumed else RunDir.create(out, about, prepared.bytes_needed)
    try:
        with folder, console.Progress() as progress:
            if resumed:
                check_same(folder.read_json("manifest.json"), about, out)
            if folder.finished():
                folder.remove_parts()
                summary = folder.read_json("summary.json")
            else:
                summary = prepared.execute(folder, progress)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"finished chunks are kept, go on with --resume {out}") from None
    _show(summary, out, line)
    if json:
        console.write(json_text({"status": "ok", "out": str(out), "summary": summary}, indent=None))
    return summary


def _show(summary: dict[str, Any], out: Path, line: str) -> None:
    for table in [*experiment_module(summary["experiment"]).tables(summary, line), *fault_tables(summary)]:
        console.write_table(*table)
    console.write(f"wrote {out}: results.parquet, summary.json, report.html and {len(summary['figures'])} figures")


def _config_path(given: Path) -> Path:
    """The file itself, or a built-in experiment of that name."""
    if given.is_file():
        return given
    built_in = config_files() / "experiments" / given.with_suffix(".yaml").name
    if built_in.is_file() and given.parent in (Path("."), Path("configs/experiments")):
        return built_in
    names = ", ".join(sorted(path.stem for path in built_in.parent.glob("*.yaml")))
    raise InputError(f"{given}: no such file, expected a YAML file or the name of a built-in experiment ({names})")


def folder_of(
    command: arguments.Run
    | arguments.Sweep
    | arguments.Register
    | arguments.Align
    | arguments.Calibrate
    | arguments.Plan,
    name: str | None,
) -> Path:
    """The folder that a command names; without one, the first free number below ``runs`` if ``name`` is given."""
    if command.resume is not None:
        if command.out is not None and command.out.absolute() != command.resume.absolute():
            raise InputError(f"--out {command.out} and --resume {command.resume} name two folders, expected one")
        return command.resume
    if command.out is not None:
        return command.out
    if name is None:
        raise InputError("--out is required: the folder for the results")
    number = 1
    while (Path("runs") / f"{name}-{number}").exists():
        number += 1
    return Path("runs") / f"{name}-{number}"
