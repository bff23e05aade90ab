"""A case: one pair of scans with one kind of control points and all its starts. What one sweep works on."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxmodel.control_points import ControlPoints, select
from jaxmodel.errors import InputError
from jaxmodel.io.poses import load_transform
from jaxmodel.register.starts import euler_starts, even_starts
from jaxmodel.run.config import EulerStarts, FileStarts, Starts
from jaxmodel.run.pairs import Pair
from jaxmodel.scan.cloud import Cloud, as_cloud


@dataclass(frozen=True)
class Case:
    """One pair with one kind of control points: a whole sweep of starts."""

    pair: Pair
    control_points: str
    target: Cloud
    source: Cloud
    starts: Float[np.ndarray, "s 4 4"]
    """T_target_source, the same for every kind of control points of the pair."""
    source_centroid: Float[np.ndarray, "3"]
    """Of all the source's points, in its frame: where the translation error is measured."""
    size: float
    """Diagonal of the source's bounding box, in the unit of the data."""


def make_cases(
    pair: Pair, kinds: tuple[ControlPoints, ...], starts: Starts, seed: int, equal_counts: bool = False
) -> list[Case]:
    """One case for each kind of control points of a pair; ``equal_counts``: as many points as the first kind gave."""
    target, source = as_cloud(pair.target, f"{pair.name}, target"), as_cloud(pair.source, f"{pair.name}, source")
    if isinstance(starts, EulerStarts):
        T_target_source = euler_starts(target.points, source.points, starts.steps, starts.translation)
        if starts.count is not None:
            T_target_source = T_target_source[
                np.linspace(0, len(T_target_source) - 1, starts.count).round().astype(int)
            ]
    elif isinstance(starts, FileStarts):
        T_target_source = load_transform(starts.path)[None]
    else:
        T_target_source = even_starts(target.points, source.points, starts.count)
    words = [options.kind for options in kinds]
    chosen: list[tuple[Cloud, Cloud]] = []
    for options in kinds:
        wanted = [options, options]
        if equal_counts and chosen:
            wanted = [dataclasses.replace(options, count=len(cloud)) for cloud in chosen[0]]
        try:
            chosen.append((select(pair.target, wanted[0], seed), select(pair.source, wanted[1], seed)))
        except InputError as error:
            raise InputError(f"{pair.name}: {error}") from error
    return [
        Case(
            pair=pair,
            control_points=options.kind if words.count(options.kind) == 1 else f"{options.kind}-{number}",
            target=chosen[number][0],
            source=chosen[number][1],
            starts=np.asarray(T_target_source, dtype=np.float64),
            source_centroid=source.points.mean(axis=0, dtype=np.float64),
            size=float(np.linalg.norm(np.ptp(source.points, axis=0))),
        )
        for number, options in enumerate(kinds)
    ]
