"""A hand-eye experiment as a run: cells (one setting each) of many draws, measured chunk by chunk.

One shape for all of them. An experiment says which cells there are and what to make of their rows; here the chunks are
measured into the run's folder, and the tables and the summary are written.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars

from jaxmodel.io.results import RunDir, json_text
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.run.console import Progress
from jaxmodel.run.convergence_table import case_rows
from jaxmodel.run.registry import Prepared, experiment_module

Label = str | float | int
_SECONDS = "seconds "


class Measured(NamedTuple):
    """What some draws of a cell gave: columns with one value a draw, and each method's seconds for one draw."""

    columns: Mapping[str, np.ndarray]
    seconds: Mapping[str, float] = {}


class Cell(NamedTuple):
    """One setting. ``measure(first, count)`` gives draws ``first`` to ``first + count``, the same in any chunk."""

    labels: Mapping[str, Label]
    draws: int
    measure: Callable[[int, int], Measured]


Summarise = Callable[[Any, polars.DataFrame, list[dict[str, Any]]], dict[str, Any]]
"""Config, rows of all draws, seconds of each method in each cell -> what the experiment adds to the summary."""


class HandEyeStudy(Prepared):
    """The cells of one experiment; see ``run/registry.py`` for the contract."""

    def __init__(self, name: str, config: Any, cells: Sequence[Cell], summarise: Summarise) -> None:
        self.name, self.config, self.cells, self.summarise = name, config, cells, summarise
        self.inputs = {}
        self.resolved = unstructure(config)
        self.draws = sum(cell.draws for cell in cells)
        self.bytes_needed = 20_000_000 + 400 * self.draws

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Run what is not yet done, write the tables, the pictures and ``summary.json``."""
        begun = time.perf_counter()
        progress.begin("draws", self.draws)
        tables, seconds = [], []
        for number, cell in enumerate(self.cells):
            progress.describe(", ".join(f"{name} {value}" for name, value in cell.labels.items()))
            rows = self._rows(number, cell, folder, progress)
            taken = [name for name in rows.columns if name.startswith(_SECONDS)]
            means = {name.removeprefix(_SECONDS): float(np.mean(rows[name].to_numpy())) for name in taken}
            seconds.append({**cell.labels, "seconds": means})
            labels = [polars.lit(value).alias(name) for name, value in cell.labels.items()]
            tables.append(rows.drop(taken).select(*labels, polars.all()))
        table = polars.concat(tables, how="diagonal_relaxed")
        folder.write_table("results.parquet", table)
        summary = {
            "experiment": self.name,
            "draws": self.draws,
            **self.summarise(self.config, table, seconds),
            "times": seconds,
        }
        summary = json.loads(json_text(summary))  # as "jaxmodel report" will read it, so that it draws the same
        progress.describe("pictures")
        summary["figures"] = experiment_module(self.name).draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _rows(self, number: int, cell: Cell, folder: RunDir, progress: Progress) -> polars.DataFrame:
        key, size = f"cell{number:04d}", self.config.chunk
        parts = folder.read_parts(key)
        progress.advance(sum(len(part) for part in parts.values()))
        for chunk, first in enumerate(range(0, cell.draws, size)):
            if chunk in parts:
                continue
            count = min(size, cell.draws - first)
            measured = cell.measure(first, count)
            columns = {
                "start": np.arange(first, first + count, dtype=np.int32),
                **measured.columns,
                **{_SECONDS + name: np.full(count, value) for name, value in measured.seconds.items()},
            }
            parts[chunk] = polars.DataFrame(columns)
            folder.write_part(key, chunk, parts[chunk])
            progress.advance(count)
        return case_rows(parts, cell.draws, folder.path / "parts").rename({"start": "draw"})
