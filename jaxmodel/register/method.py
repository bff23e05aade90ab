"""What a registration method is: options, solver and YAML node in one (configs/methods/ holds the published ones).

Floats and counts are traced leaves, so changing their values compiles nothing; flags and shapes are static. Lengths are
multiples of the target's resolution (median spacing of its control points) or of its size (diagonal of its box), as
each field says: no default is absolute.
"""

from typing import Literal

import equinox as eqx


def _require(value: object, name: str, least: float | int) -> None:
    # traced leaves pass through here as arrays or abstract values: only plain numbers can be judged
    if isinstance(value, (int, float)) and not value >= least:
        raise ValueError(f"{name} must be at least {least:g}, not {value}")


class Strategy(eqx.Module):
    """One strategy of the coarse-to-fine scheme (thesis §2.7).

    ``neighbourhood``: clusters searched on each side of a point's own; None for no limit.
    ``stack``: depth of the stack of nearest candidates (§2.5.3). ``unique``: no target point is paired twice.
    ``exact``: rank several candidates per cell by true distance, else take the cell's one. ``statistical_filter``:
    apply Zhang's filter here. ``recluster``: refit the clusters to the joint box on entering. ``slope_percent``: the
    strategy ends when the error has not risen and changed by less than this share of the first error.
    """

    slope_percent: float = 0.1
    neighbourhood: float | None = None
    stack: int = eqx.field(static=True, default=1)
    unique: bool = eqx.field(static=True, default=False)
    exact: bool = eqx.field(static=True, default=False)
    statistical_filter: bool = eqx.field(static=True, default=True)
    recluster: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        if self.stack < 1:
            raise ValueError(f"stack must be at least 1, not {self.stack}")
        _require(self.slope_percent, "slope_percent", 0.0)
        if self.neighbourhood is not None:
            _require(self.neighbourhood, "neighbourhood", 0.0)


class ZhangFilter(eqx.Module):
    """Zhang's statistical filter (§2.5.3, ERRATA: a fixed scale D).

    ``scale``: D in resolutions of the target. ``initial``: the first distance limit, in D (Zhang 1994 uses 20).
    """

    scale: float = 1.0
    initial: float = 20.0

    def __check_init__(self) -> None:
        _require(self.scale, "scale", 0.0)
        _require(self.initial, "initial", 0.0)


class IcpMethod(eqx.Module):
    """A complete ICP variant.

    ``strategies`` are run in order; the last one's end is convergence. ``stop``: "slope" ends a strategy by its
    ``slope_percent``, "motion" when a step turns by less than ``rotation_tolerance_deg`` and moves the source's
    centroid by less than ``translation_tolerance`` sizes. ``max_distance``: pairs further apart are never kept, in
    sizes of the target; None for no limit. ``border_filter``: drop pairs whose target point lies on a border.
    ``clusters``: clusters along the longest edge of the two clouds' joint box. ``cells``: edge of the voxel table of
    the strategies that are not exact; ``exact_cells`` and ``candidates``: of those that are; if the two edges are
    equal, one table serves all.
    """

    strategies: tuple[Strategy, ...] = (Strategy(),)
    zhang: ZhangFilter | None = None
    max_distance: float | None = None
    rotation_tolerance_deg: float = 0.035
    translation_tolerance: float = 5e-5
    max_iterations: int = 100
    objective: Literal["point_to_point", "point_to_plane"] = eqx.field(static=True, default="point_to_point")
    fit: Literal["quaternion", "dual_quaternion", "svd"] = eqx.field(static=True, default="quaternion")
    stop: Literal["slope", "motion"] = eqx.field(static=True, default="slope")
    border_filter: bool = eqx.field(static=True, default=False)
    clusters: int = eqx.field(static=True, default=20)
    cells: int = eqx.field(static=True, default=128)
    exact_cells: int = eqx.field(static=True, default=64)
    candidates: int = eqx.field(static=True, default=8)

    def __check_init__(self) -> None:
        if not self.strategies:
            raise ValueError("strategies must name at least one strategy")
        if len(self.strategies) > 3:
            raise ValueError(f"strategies must be at most three, not {len(self.strategies)}")
        for name in ("max_iterations", "clusters", "cells", "exact_cells", "candidates"):
            _require(getattr(self, name), name, 1)
        deepest = max(strategy.stack for strategy in self.strategies)
        if deepest > self.candidates:
            raise ValueError(f"candidates ({self.candidates}) must be at least the deepest stack ({deepest})")
        if self.max_distance is not None:
            _require(self.max_distance, "max_distance", 0.0)
        for name in ("rotation_tolerance_deg", "translation_tolerance"):
            _require(getattr(self, name), name, 0.0)

    def filters(self, strategy: Strategy) -> bool:
        """Whether Zhang's filter acts in a strategy."""
        return self.zhang is not None and strategy.statistical_filter

    @property
    def stores_pairs(self) -> bool:
        """Whether each iteration's pairs are read more than once, and so are stored rather than folded into sums."""
        return any(self.filters(strategy) or strategy.exact or strategy.stack > 1 for strategy in self.strategies)

    @property
    def needs_exact_table(self) -> bool:
        return any(strategy.exact or strategy.stack > 1 for strategy in self.strategies)

    @property
    def needs_fast_table(self) -> bool:
        return any(not (strategy.exact or strategy.stack > 1) for strategy in self.strategies)
