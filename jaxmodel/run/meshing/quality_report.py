"""Tables, figures and report of the experiment ``mesh_quality``."""

from collections.abc import Mapping
from typing import Any

from jaxmodel.io.results import RunDir
from jaxmodel.view.table import Table


def tables(summary: Mapping[str, Any], command: str) -> list[Table]:
    rows = [[str(v)[:60] for v in row.values()] for row in summary["rows"]]
    return [Table(command, list(summary["rows"][0]), rows)]


def draw(folder: RunDir, summary: Mapping[str, Any]) -> list[str]:
    return []
