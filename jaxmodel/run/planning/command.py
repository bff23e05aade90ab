"""``jaxmodel plan``: the experiment ``next_view_objects`` on one mesh; with an arm, ``next_view_arm``."""

from pathlib import Path
from typing import Any

from jaxmodel.errors import InputError
from jaxmodel.run.commands import folder_of, run_experiment
from jaxmodel.run.planning.arguments import Plan
from jaxmodel.run.planning.arm_scene import BUILT_IN
from jaxmodel.run.planning.objects import PLANNING_OBJECTS


def plan(command: Plan, line: str) -> None:
    """Make the run, write its folder, and show it."""
    if command.arm is None and command.mount is not None:
        raise InputError("--mount needs --arm: it says where the arm's flange carries the sensor.")
    raw = _of_object(command) if command.arm is None else _of_arm(command)
    out, resumed = folder_of(command, None), command.resume is not None
    run_experiment(raw, "jaxmodel plan", out, resumed, command.json, line)


def _of_object(command: Plan) -> dict[str, Any]:
    return {
        "experiment": "next_view_objects",
        "seed": command.seed,
        "objects": [_named(command.mesh)],
        "planners": [] if command.register else [command.planner],
        "registered": [command.planner] if command.register else [],
        "starts": 1,
        "noises": [command.noise],
        "scene": _looks(command, command.lowest),
        "loop": {"views": command.views},
        "search": {"minimum_overlap": command.overlap},
    }


def _of_arm(command: Plan) -> dict[str, Any]:
    if command.register or command.planner != "utility":
        raise InputError("--arm plans by utility and takes poses from the joints: leave --register and --planner out.")
    return {
        "experiment": "next_view_arm",
        "seed": command.seed,
        "object": _named(command.mesh),
        "bases": ["moving"],
        "noise": command.noise,
        "arm": {
            "arm": command.arm if command.arm == BUILT_IN else str(Path(command.arm or "").absolute()),
            "mount": None if command.mount is None else str(Path(command.mount).absolute()),
            "size": command.object_size,
            "distance": command.base_distance,
            "below": command.base_below,
        },
        "scene": _looks(command, max(command.lowest, 0.0)),
        "reach": {"views": 200, "places": 0, "elevations": [15.0, 45.0, 75.0], "circle_views": 90},
        "loop": {"views": command.views, "worth": 0.01},
        "search": {"minimum_overlap": command.overlap},
    }


def _looks(command: Plan, lowest: float) -> dict[str, Any]:
    return {
        "pixels": command.pixels,
        "field_of_view_deg": command.field_of_view,
        "distance": command.distance,
        "lowest_deg": lowest,
        "cells": command.cells,
    }


def _named(mesh: str) -> str:
    return mesh if mesh in PLANNING_OBJECTS else str(Path(mesh).absolute())
