"""What ``jaxmodel mesh`` shows: the mesh in numbers, the passes of the ball, the segments."""

from jaxmodel.run.meshing.content import Result, segment_counts
from jaxmodel.view.table import Table

_LARGEST = 12
"""Segments shown; the file has all."""


def tables(result: Result) -> list[Table]:
    """The tables of a finished mesh, in order."""
    shown = [_measures(result)]
    if result.made.passes:
        shown.append(_passes(result))
    if result.segments is not None:
        shown.append(_segments(result))
    return shown


def _measures(result: Result) -> Table:
    measures, points = result.quality, result.made.points
    rows = [
        ("points read", f"{points['read']}"),
        *((label, f"{points[key]}") for key, label in _POINTS.items() if points.get(key)),
        ("vertices, triangles", f"{measures.vertices}, {measures.triangles}"),
        ("area", f"{measures.area:.6g}"),
        ("Q_equ, Q_nor", f"{measures.Q_equ:.4f}, {measures.Q_nor:.4f}"),
        ("parts", f"{measures.components}, the largest with {100 * measures.largest_share:.2f} % of the area"),
        (
            "border",
            f"{measures.border_loops} loops, {measures.border_edges} edges, length {measures.border_length:.6g}",
        ),
        ("Euler number", f"{measures.euler}"),
        ("faults", f"{measures.crowded_edges} crowded edges, {measures.turned_pairs} turned pairs"),
    ]
    if result.distance is not None:
        for way, label in (("there", "to the reference"), ("back", "from the reference")):
            one = getattr(result.distance, way)
            text = f"mean {one.mean:.4g}, rms {one.rms:.4g}, 95 % {one.percentile_95:.4g}, largest {one.largest:.4g}"
            rows.append((label, text))
    return Table(f"Mesh by {result.options.method}", ("measure", "value"), rows)


_POINTS = {
    "thinning_distance": "thinned to",
    "unused": "unused points",
    "bad_normals": "bad normals",
    "turned_normals": "turned normals",
    "closing_triangles": "triangles that close holes",
    "dropped_triangles": "triangles of the ball dropped",
}


def _passes(result: Result) -> Table:
    rows = [
        (f"{one['radius']:.4g}", f"{one['triangles']}", f"{one['border_edges']}", f"{one['border_length']:.4g}")
        for one in result.made.passes
    ]
    return Table("Passes of the ball", ("radius", "triangles found", "border edges left", "border length left"), rows)


def _segments(result: Result) -> Table:
    assert result.segments is not None
    found = result.segments
    rows = [
        (
            f"{number}",
            one.kind,
            f"{one.area:.4g}",
            f"{len(one.faces)}",
            "" if one.radius != one.radius else f"{one.radius:.4g}",
            "" if one.rms != one.rms else f"{one.rms:.3g}",
        )
        for number, one in enumerate(found.primitives[:_LARGEST])
    ]
    counts = ", ".join(f"{count} {kind}" for kind, count in segment_counts(found).items())
    cut = f", the largest {_LARGEST}" if len(found.primitives) > _LARGEST else ""
    return Table(f"Segments: {counts}{cut}", ("number", "kind", "area", "triangles", "radius", "rms"), rows)
