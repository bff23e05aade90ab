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


def searched_transform(target: Path, source: Path, pair: Mapping[str, Any]) -> dict[str, Any]:
    """The content of ``transform.json`` from the one pair of a search without a first guess.

    Returns:
        ``T_target_source``; ``outcome`` and its ``sentence``; ``error``, the root mean square distance to tangent
        planes where the scans meet, unit of the data; ``overlap`` as of :func:`transform_of`; ``confidence``, the
        probability that the pose is right, up to the object's symmetries; ``shared``, the shares of target and source
        that lie on each other; ``contradicted``, the shares of both, added, that stand where the other's sensor saw
        through; ``rival``, how close the next different pose comes, 0 to 1; ``equivalents``, the poses as good;
        ``free``, which motions the shared surface does not feel, with their axis in the target's frame.
    """
    T = np.array(pair["T_target_source"], dtype=np.float64)
    clouds = [as_cloud(load_scan(path)).points for path in (target, source)]
    return {
        "T_target_source": pair["T_target_source"],
        "outcome": pair["outcome"],
        "sentence": pair["sentence"],
        "error": pair["scatter"],
        "overlap": overlap(clouds[0], clouds[1], T),
        "confidence": pair["probability"],
        "shared": [pair["overlap_target"], pair["overlap_source"]],
        "contradicted": pair["contradicted"],
        "rival": pair["rival"],
        "equivalents": pair["equivalents"],
        "free": pair["free"],
    }


def overlap(
    target: Float[np.ndarray, "n 3"], source: Float[np.ndarray, "m 3"], T_target_source: Float[np.ndarray, "4 4"]
) -> float:
    """Share of the source's points closer than three of the target's point spacings to the target."""
    moved = source @ T_target_source[:3, :3].T + T_target_source[:3, 3]
    reach = 3.0 * resolution(target)
    return float(np.isfinite(KDTree(target).query(moved, distance_upper_bound=reach)[0]).mean())
