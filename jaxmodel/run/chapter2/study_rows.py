"""Tables of a study: rows of registrations and of iterations, and what each kind of points cost."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars
from jaxtyping import Float

from jaxmodel.register import Sweep, Trace, basin
from jaxmodel.register.outcome import Outcome
from jaxmodel.run.chapter2.trials import Trial
from jaxmodel.run.config import Right
from jaxmodel.run.convergence_table import chunk_rows, poses
from jaxmodel.run.pairs import source_extent

NO_POINTS = -1
"""Outcome of a registration that could not begin: a view has no control point of the kind."""
_COSTS = ("extraction", "table", "seconds", "note")
_ITERATION = {
    "trial": polars.Int32, "pair": polars.String, "variant": polars.String, "control_points": polars.String,
    "start": polars.Int32, "iteration": polars.Int32, "strategy": polars.Int32, "error": polars.Float64,
    "matched_fraction": polars.Float64, "shared_rate": polars.Float64, "rotation_error_deg": polars.Float64,
    "translation_error": polars.Float64,
}  # fmt: skip


def without_points(starts: int, note: str) -> polars.DataFrame:
    """Rows of starts that could not be registered, in the shape of the others."""
    nothing, whole = np.zeros(starts), np.zeros(starts, np.int32)
    lost = np.full(starts, np.inf)
    sweep = Sweep(
        np.full((starts, 4, 4), np.nan), lost, nothing, nothing, whole, whole, whole, whole, whole + NO_POINTS
    )
    return chunk_rows(np.arange(starts), sweep).with_columns(
        points_target=polars.lit(0, polars.Int32),
        points_source=polars.lit(0, polars.Int32),
        extraction=polars.lit(0.0),
        table=polars.lit(0.0),
        seconds=polars.lit(0.0),
        note=polars.lit(note),
    )


def has_points(rows: polars.DataFrame) -> bool:
    """Whether the registrations could begin."""
    return bool(rows["points_target"][0] > 0)


def poses_or(rows: polars.DataFrame, starts: Float[np.ndarray, "s 4 4"]) -> Float[np.ndarray, "s 4 4"]:
    """The poses that ``rows`` ended with, and where one is not finite the start itself."""
    T = poses(rows)
    return np.where(np.isfinite(T).all(axis=(1, 2), keepdims=True), T, starts)


def results(trials: Sequence[Trial], done: Sequence[Sequence[polars.DataFrame]], right: Right) -> polars.DataFrame:
    """``results.parquet``: one row a registration, trials and kinds in order, without anything about time."""
    parts = []
    for number, (trial, tables) in enumerate(zip(trials, done, strict=True)):
        truth = trial.pair.T_target_source
        assert truth is not None
        centroid, size = source_extent(trial.pair)
        tolerance = right.tolerance if right.tolerance is not None else right.tolerance_of_size * size
        for label, rows in zip(trial.labels, tables, strict=True):
            errors = basin.truth_errors(poses(rows), truth, centroid)
            parts.append(
                rows.drop(_COSTS).with_columns(
                    polars.lit(number, polars.Int32).alias("trial"),
                    polars.lit(trial.pair.name).alias("pair"),
                    polars.lit(trial.pair.subject).alias("subject"),
                    polars.lit(trial.pair.family).alias("family"),
                    polars.lit(trial.draw, polars.Int32).alias("draw"),
                    polars.lit(trial.variant).alias("variant"),
                    polars.lit(label).alias("control_points"),
                    polars.lit(trial.counts[0], polars.Int32).alias("asked"),
                    polars.col("outcome").replace_strict(_OUTCOMES, return_dtype=polars.String),
                    polars.Series("rotation_error_deg", errors.rotation_deg),
                    polars.Series("translation_error", errors.translation),
                    polars.Series("translation_error_of_size", errors.translation / size),
                    polars.Series("right", basin.right(errors, right.tolerance_deg, tolerance)),
                )
            )
    first = ("trial", "pair", "subject", "family", "draw", "variant", "control_points", "asked")
    counts = ("points_target", "points_source")
    return polars.concat(parts, how="vertical").select(*first, *counts, polars.exclude(*first, *counts))


_OUTCOMES = {NO_POINTS: "no_control_points", **{int(code): code.name.lower() for code in Outcome}}


def trace_rows(number: int, trial: Trial, label: str, start: int, trace: Trace) -> polars.DataFrame:
    """One registration as rows of ``iterations.parquet``: values before each iteration's fit."""
    truth = trial.pair.T_target_source
    assert truth is not None
    errors = basin.truth_errors(trace.T_target_source, truth, source_extent(trial.pair)[0])
    n = len(trace.error)
    columns = {
        "trial": [number] * n, "pair": [trial.pair.name] * n, "variant": [trial.variant] * n,
        "control_points": [label] * n, "start": [start] * n, "iteration": range(1, n + 1), "strategy": trace.strategy,
        "error": trace.error, "matched_fraction": trace.matched_fraction, "shared_rate": trace.shared_rate,
        "rotation_error_deg": errors.rotation_deg, "translation_error": errors.translation,
    }  # fmt: skip
    return polars.DataFrame(
        [polars.Series(name, columns[name]).cast(kind) for name, kind in _ITERATION.items()], schema=_ITERATION
    )


def no_traces() -> polars.DataFrame:
    """``iterations.parquet`` without rows."""
    return polars.DataFrame(schema=_ITERATION)


def costs(trials: Sequence[Trial], done: Sequence[Sequence[polars.DataFrame]]) -> list[dict[str, Any]]:
    """For each kind of each trial: its points, and seconds of their making, of the voxel tables, of a registration.

    A registration's seconds are the sweep's wall time divided by its starts, all cores working.
    """
    return [
        {
            "trial": number,
            "pair": trial.pair.name,
            "variant": trial.variant,
            "control_points": label,
            "points": {"target": int(rows["points_target"][0]), "source": int(rows["points_source"][0])},
            "extraction": float(rows["extraction"][0]),
            "table": float(rows["table"][0]),
            "registration": float(np.mean(rows["seconds"].to_numpy())),
            "note": rows["note"][0],
        }
        for number, (trial, tables) in enumerate(zip(trials, done, strict=True))
        for label, rows in zip(trial.labels, tables, strict=True)
    ]
