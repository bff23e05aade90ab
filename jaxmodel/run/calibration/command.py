"""``jaxmodel calibrate``: from its words to the experiment ``calibration``, and its exit code."""

from pathlib import Path
from typing import Any

from jaxmodel.errors import InputError, RunError
from jaxmodel.io.results import json_text
from jaxmodel.run import arguments, console
from jaxmodel.run.commands import folder_of, run_experiment


def calibrate(command: arguments.Calibrate, line: str) -> None:
    """Calibrate and write ``calibration.json``.

    Raises :class:`RunError` (exit code 1) when all files are written but the motions leave something of the answer
    open, so that a script does not take a part for the whole.
    """
    out = folder_of(command, None)
    summary = run_experiment(_tree(command), "jaxmodel calibrate", out, command.resume is not None, False, line)
    found = summary["recommended"]
    console.write(f"wrote {out / 'calibration.json'}: {found['method']}, {found['sentence']}")
    if command.json:
        status = "ok" if found["usable"] else "partial"
        console.write(json_text({"status": status, "out": str(out), **found}, indent=None))
    if not found["usable"]:
        raise RunError(f"{out}: the answer is only a part, {found['sentence']}")


def _tree(command: arguments.Calibrate) -> dict[str, Any]:
    """The experiment as a YAML would say it."""
    if command.scales is not None and not command.unknown_scale:
        raise InputError(f"--scales {command.scales} needs --unknown-scale")
    if command.images is None and (command.camera is not None or command.target is not None):
        raise InputError("--camera and --target describe pictures, which --images names")
    return {
        "experiment": "calibration",
        "seed": command.seed,
        "poses": str(command.poses.absolute()),
        "camera_poses": _path(command.camera_poses),
        "images": None if command.images is None else _images(command),
        "setup": command.setup,
        "method": command.method,
        "scales": (command.scales or "one") if command.unknown_scale else "known",
        "noise": command.noise,
        "loss": command.loss,
        "forms": {
            "hand": {name: getattr(command, name) for name in ("angle", "length", "rotation", "quaternion")},
            "camera": {
                name: getattr(command, f"camera_{name}") or getattr(command, name)
                for name in ("angle", "length", "rotation", "quaternion")
            },
        },
        "time_offset": command.time_offset,
        "largest_offset_s": command.largest_offset,
        "most_poses": command.most_poses,
        "working_distance": command.working_distance,
        "keep_outliers": command.keep_outliers,
        "bootstrap": command.bootstrap,
    }


def _images(command: arguments.Calibrate) -> dict[str, Any]:
    if command.target is None and not command.unknown_scale:
        raise InputError("--images needs --target, for example chessboard:9x6:0.025 (inner corners, square in metres); "
                         "without one, --unknown-scale, --setup moving-frames and --camera")  # fmt: skip
    return {"folder": _path(command.images), "target": command.target, "camera": _path(command.camera)}


def _path(path: Path | None) -> str | None:
    return None if path is None else str(path.absolute())
