"""``jaxmodel plan``: the experiment ``next_view_objects`` on one mesh."""

from pathlib import Path
from typing import Any

from jaxmodel.run.commands import folder_of, run_experiment
from jaxmodel.run.planning.arguments import Plan
from jaxmodel.run.planning.objects import PLANNING_OBJECTS


def plan(command: Plan, line: str) -> None:
    """Make the run, write its folder, and show it."""
    raw: dict[str, Any] = {
        "experiment": "next_view_objects",
        "seed": command.seed,
        "objects": [command.mesh if command.mesh in PLANNING_OBJECTS else str(Path(command.mesh).absolute())],
        "planners": [] if command.register else [command.planner],
        "registered": [command.planner] if command.register else [],
        "starts": 1,
        "noises": [command.noise],
        "scene": {
            "pixels": command.pixels,
            "field_of_view_deg": command.field_of_view,
            "distance": command.distance,
            "lowest_deg": command.lowest,
            "cells": command.cells,
        },
        "loop": {"views": command.views},
        "search": {"minimum_overlap": command.overlap},
    }
    out, resumed = folder_of(command, None), command.resume is not None
    run_experiment(raw, "jaxmodel plan", out, resumed, command.json, line)
