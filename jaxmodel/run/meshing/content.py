"""What ``jaxmodel mesh`` writes beside the mesh, as plain trees."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jaxmodel.mesh.distance import SurfaceDistance
from jaxmodel.mesh.quality import Quality
from jaxmodel.mesh.segmentation import Segmentation
from jaxmodel.run.meshing.clouds import Measured
from jaxmodel.run.meshing.making import Made
from jaxmodel.run.meshing.options import Options
from jaxmodel.run.provenance import hash_files, versions


class Result(NamedTuple):
    """A finished mesh. ``distance`` to ``reference``, None without one; ``segments`` None unless asked for."""

    measured: Measured
    options: Options
    made: Made
    quality: Quality
    segments: Segmentation | None
    reference: Path | None
    distance: SurfaceDistance | None
    seconds: Mapping[str, float]


def quality_tree(result: Result, line: str) -> dict[str, Any]:
    """The content of ``MESH.quality.json``."""
    files = [*result.measured.files, *([] if result.reference is None else [result.reference])]
    return {
        "command": line,
        "method": result.options.method,
        "options": result.options.own(),
        "outcome": outcome(result),
        "notes": list(result.measured.notes),
        "quality": quality_fields(result.quality),
        "passes": list(result.made.passes),
        "points": result.made.points,
        "reference": None if result.distance is None else _distances(result),
        "segments": None if result.segments is None else segment_counts(result.segments),
        "seconds": dict(result.seconds),
        "inputs": hash_files(files),
        "versions": versions(),
    }


def outcome(result: Result) -> str:
    """How the mesh came out, in words."""
    measures = result.quality
    if measures.closed:
        kind = "a closed surface"
    elif measures.border_edges == 0:
        kind = "a surface without border"
    else:
        loops = measures.border_loops
        kind = f"an open surface with {loops} border{'s' if loops != 1 else ''}"
    parts = f" in {measures.components} parts" if measures.components > 1 else ""
    faults = [
        text
        for count, text in (
            (measures.crowded_edges, f"{measures.crowded_edges} edges have more than two triangles"),
            (measures.turned_pairs, f"{measures.turned_pairs} pairs of neighbours are turned against each other"),
        )
        if count
    ]
    return "; ".join([f"{kind}{parts}, {result.made.sentence}", *faults])


def quality_fields(measures: Quality) -> dict[str, Any]:
    """All of :class:`Quality` by name, histograms as edges and counts."""
    return {
        **measures._asdict(),
        "Q_equ_histogram": measures.Q_equ_histogram._asdict(),
        "Q_nor_histogram": measures.Q_nor_histogram._asdict(),
        "closed": measures.closed,
    }


def segments_tree(found: Segmentation, snapped: bool) -> dict[str, Any]:
    """The content of ``MESH.segments.json``; ``labels`` in the order of the mesh's triangles."""
    return {
        "outcome": found.outcome.value,
        "noise": found.noise,
        "snapped": snapped,
        "snap_bound": found.snap_bound if snapped else 0.0,
        "primitives": [
            {
                "kind": one.kind,
                "point": one.point,
                "direction": one.direction,
                "radius": one.radius,
                "area": one.area,
                "rms": one.rms,
                "largest": one.largest,
                "triangles": len(one.faces),
            }
            for one in found.primitives
        ],
        "labels": found.labels,
        "parts": found.parts,
    }


def segment_counts(found: Segmentation) -> dict[str, int]:
    """How many segments of each kind, kinds without any left out."""
    kinds = [one.kind for one in found.primitives]
    return {kind: kinds.count(kind) for kind in ("plane", "cylinder", "sphere", "free-form") if kind in kinds}


def _distances(result: Result) -> dict[str, Any]:
    assert result.distance is not None
    return {
        "file": str(result.reference),
        "there": result.distance.there._asdict(),
        "back": result.distance.back._asdict(),
        "mean": result.distance.mean,
        "hausdorff": result.distance.hausdorff,
    }
