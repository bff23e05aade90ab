"""Which experiments there are: the word after ``experiment:`` in a YAML, and the module that runs it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from jaxmodel.errors import InputError
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import structure
from jaxmodel.io.structuring import nearest, show
from jaxmodel.run.console import Progress

EXPERIMENTS = {"convergence": "jaxmodel.run.convergence"}
"""Name -> module holding a ``Config`` class and ``prepare(config)``, imported when asked for."""


class Prepared(ABC):
    """An experiment with all its inputs read and checked, ready to run."""

    inputs: dict[str, str]
    """Input file -> SHA-256 of its content."""
    resolved: dict[str, Any]
    """The configuration with every default and named file written out."""
    bytes_needed: int

    @abstractmethod
    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Run (or go on), write the results into the folder and return the summary."""


def load_experiment(raw: Mapping[str, Any], where: str) -> tuple[str, Any]:
    """The experiment's name and its ``Config`` made from a raw tree. Unknown names are an ``InputError``."""
    if "experiment" not in raw:
        raise InputError(f"{where}: the key 'experiment' is required and missing, expected: {', '.join(EXPERIMENTS)}")
    name = raw["experiment"]
    if name not in EXPERIMENTS:
        raise InputError(f"{where}: experiment: unknown experiment {show(name)}, {nearest(name, list(EXPERIMENTS))}")
    return name, structure(raw, import_module(EXPERIMENTS[name]).Config, where)


def prepare_experiment(name: str, config: Any) -> Prepared:
    """Read and check everything the experiment needs, before its folder is made."""
    return import_module(EXPERIMENTS[name]).prepare(config)
