"""The experiment ``convergence`` (thesis §2.9.2): every pair registered from every start, for each kind of point.

``prepare`` reads and checks everything; ``execute`` sweeps chunk by chunk into the run's folder, then writes the
table, the pictures and the summary. Nothing about speed enters the table, so it is the same bytes every time.
"""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import polars
from jaxtyping import Float, Int

from jaxmodel.control_points import ControlPoints, Subsample
from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.lanes import Engine
from jaxmodel.register import claims, methods, sweep_chunks
from jaxmodel.register.method import IcpMethod
from jaxmodel.run.cases import Case, make_cases
from jaxmodel.run.config import Claims, EulerStarts, Execution, FileStarts, Right, Scans, Starts
from jaxmodel.run.console import Progress
from jaxmodel.run.convergence_table import case_rows, chunk_rows, finish_case, pooled_translation
from jaxmodel.run.faults import unequal_counts
from jaxmodel.run.pairs import load_pairs
from jaxmodel.run.pictures import draw, tables
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.published import published_rows
from jaxmodel.run.registry import Prepared
from jaxmodel.run.scene import make_scene

__all__ = ["Config", "Convergence", "draw", "prepare", "tables"]


@dataclass(frozen=True)
class Config:
    """The YAML of a convergence experiment.

    ``equal_counts``: every kind of control points has as many as the first kind gave, scan by scan.
    """

    scans: Scans
    experiment: Literal["convergence"] = "convergence"
    seed: int = 0
    control_points: tuple[ControlPoints, ...] = (Subsample(),)
    equal_counts: bool = False
    starts: Starts = field(default_factory=EulerStarts)
    method: str | IcpMethod = "thesis_2005"
    right: Right = field(default_factory=Right)
    claims: Claims = field(default_factory=Claims)
    engine: Execution = field(default_factory=Execution)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if not self.control_points:
            raise ValueError("control_points is empty, expected at least one kind")


class Convergence(Prepared):
    """The experiment with its inputs in memory; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.method_name, self.method = _method(config.method)
        pairs = load_pairs(config.scans, config.seed)
        files = [file for pair in pairs for file in pair.files]
        files += [Path(config.starts.path)] if isinstance(config.starts, FileStarts) else []
        self.inputs = hash_files(dict.fromkeys(files))
        self.resolved = {**unstructure(config), "method": {"name": self.method_name, **unstructure(self.method)}}
        self.cases = [
            case
            for pair in pairs
            for case in make_cases(pair, config.control_points, config.starts, config.seed, config.equal_counts)
        ]
        self.bytes_needed = 20_000_000 + 400 * sum(len(case.starts) for case in self.cases)

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Sweep what is not yet done, write ``results.parquet``, the pictures and ``summary.json``."""
        begun = time.perf_counter()
        progress.begin("starts", sum(len(c.starts) + len(self._offset_choice(c)) for c in self.cases))
        finished_tables, summaries = [], []
        for number, case in enumerate(self.cases):
            progress.describe(f"{case.pair.name}, {case.control_points}")
            finished = self._case(number, case, folder, progress)
            finished_tables.append(finished[0])
            summaries.append(finished[1])
            del finished  # the tables are let go before the pictures are made
        folder.write_table("results.parquet", polars.concat(finished_tables, how="vertical"))
        finished_tables.clear()
        summary: dict[str, Any] = {
            "experiment": "convergence",
            "method": self.method_name,
            "cases": summaries,
            "unequal": unequal_counts(summaries) if self.config.equal_counts else [],
            "translation_claim": pooled_translation(summaries),
            "published": published_rows(summaries),
        }
        progress.describe("pictures")
        best = [entry["best"] for entry in summaries]
        poses = [np.array(entry["T_target_source"]) for entry in best]
        scene = make_scene(self.cases, self.method, [entry["start"] for entry in best], poses)
        folder.write("scene.npz", scene)
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _case(
        self, number: int, case: Case, folder: RunDir, progress: Progress
    ) -> tuple[polars.DataFrame, dict[str, Any]]:
        """One sweep: the case's starts, and after them those run again with a random translation."""
        begun = time.perf_counter()
        size, chosen = self.config.claims.offset_of_size * case.size, self._offset_choice(case)
        starts = case.starts
        if len(chosen):
            starts = np.concatenate([starts, claims.offset_starts(starts, size, self.config.seed, chosen)])
        key = f"case{number:03d}"
        parts = folder.read_parts(key)
        kept = sum(len(part) for part in parts.values())
        progress.advance(kept)
        if kept < len(starts):
            self._sweep(key, case, starts, parts, folder, progress)
        rows = case_rows(parts, len(starts), folder.path / "parts")
        parts.clear()
        seconds = time.perf_counter() - begun
        offset = rows[len(case.starts) :] if len(chosen) else None
        table, summary = finish_case(
            case,
            self.method_name,
            rows[: len(case.starts)],
            self.config.right,
            self.config.claims,
            self.config.seed,
            chosen,
            offset,
        )
        summary["seconds"] = round(seconds, 3)
        summary["starts_per_second"] = round((len(starts) - kept) / seconds, 1) if kept < len(starts) else None
        return table, summary

    def _sweep(
        self,
        key: str,
        case: Case,
        starts: Float[np.ndarray, "s 4 4"],
        parts: dict[int, polars.DataFrame],
        folder: RunDir,
        progress: Progress,
    ) -> None:
        """Run the chunks that ``parts`` does not hold, and keep each as it is done."""
        wanted = self.config.engine
        # memory is taken for a whole chunk; below this size all sweeps share one compiled program
        chunk = min(wanted.chunk, max(len(starts), Execution.chunk))
        engine = Engine(wanted.executor, lanes=wanted.lanes, chunk=chunk)
        order = np.arange(len(starts))
        if wanted.order == "shuffled":
            order = np.random.default_rng([self.config.seed, len(starts)]).permutation(len(starts))
        chunks = sweep_chunks(
            case.target, case.source, starts, self.method, order=order, skip=frozenset(parts), engine=engine
        )
        for chunk, indices, sweep in chunks:
            parts[chunk] = chunk_rows(indices, sweep)
            folder.write_part(key, chunk, parts[chunk])
            progress.advance(len(indices))

    def _offset_choice(self, case: Case) -> Int[np.ndarray, " c"]:
        count = min(self.config.claims.starts, len(case.starts)) if case.pair.T_target_source is not None else 0
        draw = np.random.default_rng([self.config.seed, len(case.starts), count])
        return np.sort(draw.permutation(len(case.starts))[:count])


def prepare(config: Config) -> Convergence:
    """Read and check everything ``config`` names."""
    return Convergence(config)


def _method(given: str | IcpMethod) -> tuple[str, IcpMethod]:
    return (given, methods.named(given)) if isinstance(given, str) else ("inline", given)
