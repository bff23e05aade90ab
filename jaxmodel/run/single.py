"""``transform.json``: the motion a registration of two files found, and how far to trust it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jaxmodel.io.scans import load_scan
from jaxmodel.scan.cloud import as_cloud, resolution


def transform_of(target: Path, source: Path, case: Mapping[str, Any]) -> dict[str, Any]:
    """The content of ``transform.json`` from the summary of a sweep, which may hold a single start.

    Returns:
        ``T_target_source``; ``outcome`` and its ``sentence``; ``error``, the mean distance of the kept pairs in the
        unit of the data; ``matched_fraction``; ``overlap``, the share of the source's points closer than three point
        spacings to the target; ``confidence``, 0 to 1: of the starts that fit about as well (at most twice the
        error), the share that came to the same place; 0 where no plateau stands out; ``plateau``, the test without
        the truth. Both are null after a single start, which cannot tell.
    """
    best, several = dict(case["best"]), case["starts"] > 1
    agreement = best.pop("agreement")
    T = np.array(best["T_target_source"], dtype=np.float64)
    clouds = [as_cloud(load_scan(path)).points for path in (target, source)]
    return {
        **best,
        "overlap": overlap(clouds[0], clouds[1], T),
        "confidence": agreement if several else None,
        "starts": case["starts"],
        "plateau": case["plateau"] if several else None,
    }


def overlap(
    target: Float[np.ndarray, "n 3"], source: Float[np.ndarray, "m 3"], T_target_source: Float[np.ndarray, "4 4"]
) -> float:
    """Share of the source's points closer than three of the target's point spacings to the target."""
    moved = source @ T_target_source[:3, :3].T + T_target_source[:3, 3]
    reach = 3.0 * resolution(target)
    return float(np.isfinite(KDTree(target).query(moved, distance_upper_bound=reach)[0]).mean())
