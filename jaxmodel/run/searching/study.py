"""The experiment ``search``: pairs of scans registered with no first guess, and judged where the truth is known.

``jaxmodel register TARGET SOURCE`` without a first guess is this experiment on one pair of files.
"""

import time
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import polars

from jaxmodel.io.results import RunDir
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.register.candidates import PairOfViews
from jaxmodel.register.degeneracy import Kind
from jaxmodel.register.search import SearchOptions, search_pair, views_of
from jaxmodel.register.verdict import Found, SearchOutcome
from jaxmodel.run.config import Scans
from jaxmodel.run.console import Progress
from jaxmodel.run.pairs import Pair, load_pairs
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared
from jaxmodel.run.searching.judging import maps_onto_itself, pose_error
from jaxmodel.run.searching.pictures import keep_pair
from jaxmodel.run.searching.report import draw, tables
from jaxmodel.run.searching.summary import summarised

__all__ = ["Config", "SearchStudy", "draw", "prepare", "tables"]

TYPES = {
    "equivalents": polars.List(polars.List(polars.Float64)),
    **dict.fromkeys(("turn_deg", "shift", "true_target", "true_source"), polars.Float64),
    **dict.fromkeys(("right", "alike"), polars.Boolean),
}
"""Of columns that may be empty in one pair and not in another."""
MOST_DRAWN = 12
"""Pairs that get pictures: the first ones."""


@dataclass(frozen=True)
class Config:
    """The YAML of the experiment.

    ``scans``: one or several nodes of pairs. A pair is expected to be found where both scans show at least
    ``least_overlap`` of each other under the truth; it is right within ``right_deg`` and ``right_shift`` (in the
    length of the search, the smaller scan's size), or where a symmetry of the object leads there.
    """

    scans: tuple[Scans, ...]
    experiment: Literal["search"] = "search"
    seed: int = 0
    least_overlap: float = 0.15
    right_deg: float = 5.0
    right_shift: float = 0.02
    search: SearchOptions = field(default_factory=SearchOptions)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected 0 or more")
        if not self.scans:
            raise ValueError("scans is empty, expected at least one node of scans")
        if not 0 <= self.least_overlap <= 1:
            raise ValueError(f"least_overlap is {self.least_overlap}, expected 0 to 1")
        for key in ("right_deg", "right_shift"):
            if not getattr(self, key) > 0:
                raise ValueError(f"{key} is {getattr(self, key)}, expected above 0")


class SearchStudy(Prepared):
    """All pairs; see ``run/registry.py`` for the contract."""

    def __init__(self, config: Config) -> None:
        self.config = config
        self.pairs = [pair for node in config.scans for pair in load_pairs(node, config.seed)]
        self.inputs = hash_files(dict.fromkeys(file for pair in self.pairs for file in pair.files))
        self.resolved = unstructure(config)
        self.bytes_needed = 30_000_000
        if len(self.pairs) == 1:  # refuse what cannot be searched before anything is written
            self.ready = {0: views_of(_scans(self.pairs[0]))}
        else:
            self.ready = {}

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Search the pairs that are not yet searched, write the table, the pictures and ``summary.json``."""
        begun = time.perf_counter()
        progress.begin("pairs", len(self.pairs))
        rows = []
        for number, pair in enumerate(self.pairs):
            progress.describe(pair.name)
            parts = folder.read_parts(f"pair{number:05d}")
            if 0 not in parts:
                parts[0] = polars.DataFrame([self._row(folder, number, pair)], schema_overrides=TYPES)
                folder.write_part(f"pair{number:05d}", 0, parts[0])
            rows.append(parts[0])
            progress.advance(1)
        table = polars.concat(rows, how="vertical")
        folder.write_table("results.parquet", table.drop("prepare_seconds", "seconds"))
        summary: dict[str, Any] = {"experiment": "search", **summarised(table, self.config.least_overlap)}
        summary["drawn"] = min(len(self.pairs), MOST_DRAWN)
        progress.describe("pictures")
        summary["figures"] = draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _row(self, folder: RunDir, number: int, pair: Pair) -> dict[str, Any]:
        begun = time.perf_counter()
        views, length = self.ready.get(number) or views_of(_scans(pair))
        prepared = time.perf_counter()
        both = PairOfViews(views["the target"], views["the source"], length)
        found = search_pair(both, self.config.search)
        ended = time.perf_counter()
        if number < MOST_DRAWN:
            keep_pair(folder, number, pair, found.T_target_source)
        return {
            "pair": pair.name,
            "family": pair.family,
            "subject": pair.subject,
            **_told(found),
            **self._judged(pair, both, found),
            "prepare_seconds": prepared - begun,
            "seconds": ended - begun,
        }

    def _judged(self, pair: Pair, both: PairOfViews, found: Found) -> dict[str, Any]:
        true = pair.T_target_source
        if true is None:
            return dict.fromkeys(("turn_deg", "shift", "right", "alike", "true_target", "true_source"))
        error = pose_error(found.T_target_source, true, both.source.centre)
        right = error.turn_deg < self.config.right_deg and error.shift < self.config.right_shift * both.length
        alike = pair.solid is not None and maps_onto_itself(pair.solid, found.T_target_source, true, both.length)
        evidence = both.examined(true[None], self.config.search.last_reach).evidence
        return {
            "turn_deg": error.turn_deg,
            "shift": error.shift,
            "right": bool(right),
            "alike": bool(right or alike),
            "true_target": float(evidence.target.near[0]),
            "true_source": float(evidence.source.near[0]),
        }


def prepare(config: Config) -> SearchStudy:
    """Read and check everything ``config`` names."""
    return SearchStudy(config)


def _scans(pair: Pair) -> dict[str, Any]:
    return {"the target": pair.target, "the source": pair.source}


def _told(found: Found) -> dict[str, Any]:
    return {
        **{f"T_{i}{j}": float(found.T_target_source[i, j]) for i in range(3) for j in range(4)},
        "outcome": SearchOutcome(found.outcome).name.lower(),
        "probability": found.probability,
        "overlap_target": found.overlap[0],
        "overlap_source": found.overlap[1],
        "contradicted": found.contradicted,
        "scatter": found.scatter,
        "rival": found.rival,
        "free": Kind.HELD.name.lower() if found.freedom is None else found.freedom.kind.name.lower(),
        "free_axis": [0.0] * 3 if found.freedom is None else [float(v) for v in found.freedom.axis],
        "free_point": [0.0] * 3 if found.freedom is None else [float(v) for v in found.freedom.point],
        "equivalents": [[float(v) for v in np.asarray(T)[:3].ravel()] for T in found.equivalents],
    }
