"""Which experiments there are: the word after ``experiment:`` in a YAML, and the module that runs it.

A module of an experiment holds ``Config`` (a frozen dataclass, the YAML), ``prepare(config)`` (reads and checks), and
two functions of what a finished run left: ``tables(summary, command)`` and ``draw(folder, summary)``.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from typing import Any, Protocol, cast, runtime_checkable

from jaxmodel.errors import InputError
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import structure
from jaxmodel.io.structuring import nearest, show
from jaxmodel.run.console import Progress
from jaxmodel.view.table import Table

EXPERIMENTS = {
    "convergence": "jaxmodel.run.convergence",
    "edges": "jaxmodel.run.chapter2.edge_quality",
    "search": "jaxmodel.run.searching.study",
    "multiview": "jaxmodel.run.aligning.study",
    "mesh_segments": "jaxmodel.run.meshing.segments_study",
    "mesh_quality": "jaxmodel.run.meshing.quality_study",
    "resolution": "jaxmodel.run.chapter2.resolution",
    "overlap": "jaxmodel.run.chapter2.overlap",
    "iterations": "jaxmodel.run.chapter2.iterations",
    "user_starts": "jaxmodel.run.chapter2.user_starts",
    "cylinder": "jaxmodel.run.chapter2.cylinder",
    "global_table": "jaxmodel.run.chapter2.global_table",
    "next_view_objects": "jaxmodel.run.planning.objects_study",
    "next_view_arm": "jaxmodel.run.planning.arm_study",
    "next_view_search": "jaxmodel.run.planning.search_study",
    "next_view_environment": "jaxmodel.run.planning.environment_study",
    "calibration": "jaxmodel.run.calibration.job",
    "hand_eye_noise": "jaxmodel.run.hand_eye.noise",
    "hand_eye_count": "jaxmodel.run.hand_eye.count",
    "hand_eye_trajectories": "jaxmodel.run.hand_eye.trajectories",
    "hand_eye_averaging": "jaxmodel.run.hand_eye.averaging",
    "hand_eye_self_calibration": "jaxmodel.run.hand_eye.self_calibration",
    "hand_eye_observability": "jaxmodel.run.hand_eye.observability",
}
"""Name -> module with the members of ``Experiment``, imported when asked for."""


class Prepared(ABC):
    """An experiment with all its inputs read and checked, ready to run."""

    inputs: dict[str, str]
    """Input file -> SHA-256 of its content."""
    resolved: dict[str, Any]
    """The configuration with every default and named file written out."""
    bytes_needed: int

    @abstractmethod
    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Run (or go on), write all files of the folder, ``summary.json`` last, and return the summary.

        The summary has ``experiment`` (the name in ``EXPERIMENTS``) and ``figures`` (what ``draw`` returned).
        """


@runtime_checkable
class Experiment(Protocol):
    """What the module of an experiment holds."""

    Config: type[Any]

    def prepare(self, config: Any) -> Prepared:
        """Read and check everything ``config`` names."""
        ...

    def tables(self, summary: Mapping[str, Any], command: str) -> list[Table]:
        """The tables of a finished run, *published | ours* last; ``command`` is the line that made it."""
        ...

    def draw(self, folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
        """Write ``figures/*.png`` and ``report.html`` from the folder alone; the figures' names, relative to it."""
        ...


def experiment_module(name: str) -> Experiment:
    """The module of a known experiment."""
    return cast(Experiment, import_module(EXPERIMENTS[name]))


def load_experiment(raw: Mapping[str, Any], where: str) -> tuple[str, Any]:
    """The experiment's name and its ``Config`` made from a raw tree. Unknown names are an ``InputError``."""
    if "experiment" not in raw:
        raise InputError(f"{where}: the key 'experiment' is required and missing, expected: {', '.join(EXPERIMENTS)}")
    name = raw["experiment"]
    if name not in EXPERIMENTS:
        raise InputError(f"{where}: experiment: unknown experiment {show(name)}, {nearest(name, list(EXPERIMENTS))}")
    return name, structure(raw, experiment_module(name).Config, where)


def prepare_experiment(name: str, config: Any) -> Prepared:
    """Read and check everything the experiment needs, before its folder is made."""
    return experiment_module(name).prepare(config)
