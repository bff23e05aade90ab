"""A study (thesis §2.9.3 to 2.9.6): many tests, each registering one pair with every kind of control points.

One shape for all experiments of the chapter. An experiment says which trials there are and what to make of their rows;
here the trials are run, chunk by chunk into the run's folder, and the tables and the summary are written. Within a
trial all kinds get the same starts and the same number of points: the first kind listed says how many there are, the
others are asked for as many (§2.9.3: the mesh is decimated to the number of points that the contours gave).
"""

import dataclasses
import hashlib
import json
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import polars
from jaxtyping import Float

from jaxmodel.control_points import Contours, ControlPoints, RankedContours, select
from jaxmodel.errors import InputError
from jaxmodel.geometry.masked import size_class
from jaxmodel.io.results import RunDir, json_text
from jaxmodel.io.strict_yaml import unstructure
from jaxmodel.lanes import Engine
from jaxmodel.register import IcpMethod, methods, register_trace
from jaxmodel.register.problem import prepare
from jaxmodel.register.sweep import sweep_prepared
from jaxmodel.run.chapter2 import study_rows
from jaxmodel.run.chapter2.trials import StudyConfig, Trial
from jaxmodel.run.console import Progress
from jaxmodel.run.convergence_table import case_rows, chunk_rows
from jaxmodel.run.faults import unequal_counts, without_any
from jaxmodel.run.provenance import hash_files
from jaxmodel.run.registry import Prepared, experiment_module
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage

Summarise = Callable[[Any, list[Trial], polars.DataFrame, polars.DataFrame, list[dict[str, Any]]], dict[str, Any]]
"""Config, trials, rows of all registrations, rows of all iterations, what each kind of each trial cost -> what the
experiment adds to the summary."""


class Points(NamedTuple):
    """Control points of both views, and the seconds their making took."""

    target: Cloud
    source: Cloud
    seconds: float


class Study(Prepared):
    """The trials of one experiment with their scans in memory; see ``run/registry.py`` for the contract."""

    def __init__(self, name: str, config: StudyConfig, trials: list[Trial], summarise: Summarise) -> None:
        self.name, self.config, self.trials, self.summarise = name, config, trials, summarise
        given = config.method
        self.method_name = "inline" if isinstance(given, IcpMethod) else given
        self.method = given if isinstance(given, IcpMethod) else methods.named(given)
        self.inputs = hash_files(dict.fromkeys(file for trial in trials for file in trial.pair.files))
        self.resolved = {**unstructure(config), "method": {"name": self.method_name, **unstructure(self.method)}}
        self.registrations = sum(len(trial.starts) * len(trial.kinds) for trial in trials)
        self.bytes_needed = 20_000_000 + 800 * self.registrations
        self._made: dict[tuple[str, ControlPoints], tuple[Cloud, float]] = {}
        self._ranked: dict[tuple[str, tuple[str, ...]], tuple[RankedContours, float]] = {}
        self._compiled: set[tuple[int, int]] = set()
        for trial in trials:
            _check_kinds(trial)

    def execute(self, folder: RunDir, progress: Progress) -> dict[str, Any]:
        """Run what is not yet done, write the tables, the pictures and ``summary.json``."""
        begun = time.perf_counter()
        progress.begin("registrations", self.registrations)
        done: list[list[polars.DataFrame]] = []
        traces = [study_rows.no_traces()]
        for number, trial in enumerate(self.trials):
            done.append([])
            for kind, label in enumerate(trial.labels):
                progress.describe(f"{trial.pair.name}, {label}")
                done[number].append(self._rows(number, kind, done, folder, progress))
                traces += self._traces(number, kind, done[number], folder)
        costs = study_rows.costs(self.trials, done)
        table = study_rows.results(self.trials, done, self.config.right)
        iterations = polars.concat(traces, how="vertical")
        folder.write_table("iterations.parquet", iterations)
        folder.write_table("results.parquet", table)
        summary: dict[str, Any] = {
            "experiment": self.name,
            "method": self.method_name,
            "registrations": self.registrations,
            "unequal": unequal_counts(costs),
            "missing": without_any(costs),
            **self.summarise(self.config, self.trials, table, iterations, costs),
            "costs": costs,
        }
        summary = json.loads(json_text(summary))  # as "jaxmodel report" will read it, so that it draws the same
        progress.describe("pictures")
        summary["figures"] = experiment_module(self.name).draw(folder, summary)
        summary["seconds"] = round(time.perf_counter() - begun, 3)
        folder.write_json("summary.json", summary)
        folder.remove_parts()
        return summary

    def _rows(
        self, number: int, kind: int, done: list[list[polars.DataFrame]], folder: RunDir, progress: Progress
    ) -> polars.DataFrame:
        """One kind of one trial: what is kept of it, else the points are made and the starts run."""
        trial, key = self.trials[number], f"rows{number:04d}k{kind}"
        starts = trial.starts
        if trial.follows is not None:
            starts = study_rows.poses_or(done[trial.follows][kind], starts)
        parts = folder.read_parts(key)
        kept = sum(len(part) for part in parts.values())
        progress.advance(kept)
        if kept == len(starts):
            return case_rows(parts, len(starts), folder.path / "parts")
        try:
            points = self._points(trial, kind, done[number])
        except InputError as refused:
            chunks = iter([(0, study_rows.without_points(len(starts), str(refused)))])
        else:
            chunks = self._sweep(points, starts, frozenset(parts))
        for chunk, rows in chunks:
            parts[chunk] = rows
            folder.write_part(key, chunk, rows)
            progress.advance(len(rows))
        return case_rows(parts, len(starts), folder.path / "parts")

    def _sweep(
        self, points: Points, starts: Float[np.ndarray, "s 4 4"], skip: frozenset[int]
    ) -> Iterator[tuple[int, polars.DataFrame]]:
        """The chunks not in ``skip``, as they are done; what each costs is measured without compilation."""
        wanted = self.config.engine
        engine = Engine(Engine(wanted.executor).resolved(), lanes=wanted.lanes, chunk=wanted.chunk)
        order = np.arange(len(starts))
        if wanted.order == "shuffled":
            order = np.random.default_rng([self.config.seed, len(starts)]).permutation(len(starts))
        begun = time.perf_counter()
        prepared = prepare(points.target, points.source, self.method)
        table_seconds = time.perf_counter() - begun
        shape = size_class(len(points.target)), size_class(len(points.source))
        if shape not in self._compiled:
            next(sweep_prepared(prepared, starts[:1], self.method, engine))
            self._compiled.add(shape)
        begun = time.perf_counter()
        for chunk, indices, sweep in sweep_prepared(prepared, starts, self.method, engine, order, skip):
            seconds = time.perf_counter() - begun
            yield (
                chunk,
                chunk_rows(indices, sweep).with_columns(
                    points_target=polars.lit(len(points.target), polars.Int32),
                    points_source=polars.lit(len(points.source), polars.Int32),
                    extraction=polars.lit(points.seconds, polars.Float64),
                    table=polars.lit(table_seconds, polars.Float64),
                    seconds=polars.lit(seconds / len(indices), polars.Float64),
                    note=polars.lit(""),
                ),
            )
            begun = time.perf_counter()

    def _traces(self, number: int, kind: int, rows: list[polars.DataFrame], folder: RunDir) -> list[polars.DataFrame]:
        """The first starts of one kind, iteration by iteration; none where there were no points."""
        trial, key = self.trials[number], f"trace{number:04d}k{kind}"
        if not trial.traced or not study_rows.has_points(rows[kind]):
            return []
        kept = folder.read_parts(key)
        for start in range(min(trial.traced, len(trial.starts))):
            if start not in kept:
                points = self._points(trial, kind, rows[:kind])
                _, trace = register_trace(points.target, points.source, trial.starts[start], self.method)
                kept[start] = study_rows.trace_rows(number, trial, trial.labels[kind], start, trace)
                folder.write_part(key, start, kept[start])
        return [kept[start] for start in sorted(kept)]

    def _points(self, trial: Trial, kind: int, before: list[polars.DataFrame]) -> Points:
        """Control points of both views, as many as the first kind gave; ``InputError`` where a view has none."""
        counts = trial.counts
        if kind and study_rows.has_points(before[0]):
            counts = int(before[0]["points_target"][0]), int(before[0]["points_source"][0])
        found = []
        for scan, count in zip((trial.pair.target, trial.pair.source), counts, strict=True):
            options = dataclasses.replace(trial.kinds[kind], count=count)
            found.append(self._selected(scan, options))
        return Points(found[0][0], found[1][0], found[0][1] + found[1][1])

    def _selected(self, scan: RangeImage | Cloud, options: ControlPoints) -> tuple[Cloud, float]:
        """Control points of one view and the seconds they take; nothing is made twice, and its time is told again."""
        view = hashlib.sha256(scan.points.tobytes()).hexdigest()  # a view can be in many pairs
        if (view, options) not in self._made:
            if isinstance(options, Contours) and isinstance(scan, RangeImage):
                ranked, before = self._contours(view, scan, options)
                begun = time.perf_counter()
                made = ranked.most_important(options.count)
            else:
                begun, before = time.perf_counter(), 0.0
                made = select(scan, options, self.config.seed)
            self._made[view, options] = made, before + time.perf_counter() - begun
        return self._made[view, options]

    def _contours(self, view: str, scan: RangeImage, options: Contours) -> tuple[RankedContours, float]:
        """The ranked contours of a view, which give any number of points, and the seconds of their making."""
        if (view, options.labels) not in self._ranked:
            begun = time.perf_counter()
            ranked = RankedContours(scan, options.kinds)
            self._ranked[view, options.labels] = ranked, time.perf_counter() - begun
        return self._ranked[view, options.labels]


def _check_kinds(trial: Trial) -> None:
    for kind in trial.kinds:
        if kind.kind != "subsample" and not all(
            isinstance(scan, RangeImage) for scan in (trial.pair.target, trial.pair.source)
        ):
            raise InputError(f"{trial.pair.name}: the kind {kind.kind} needs range images, and this is a cloud")
