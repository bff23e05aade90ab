"""The ball by itself: a cloud made one sheet, then single radii against each other, and passes with their times."""

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import adjacency, border_length
from jaxmodel.mesh.passes import run_passes
from jaxmodel.mesh.prepare import prepare
from jaxmodel.mesh.quality import quality
from jaxmodel.mesh.radii import LARGEST, cloud_scale, first_radius, thinning_distance
from jaxmodel.mesh.thinning import thin
from jaxmodel.run.meshing.clouds import Measured
from jaxmodel.scan.triangle_mesh import ObjectMesh

_ROUNDS = 8


class Sheet(NamedTuple):
    """What the ball rolls on. ``distance`` of the thinning, 0 without; ``first`` the smallest ball worth rolling."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    distance: float
    spacing: float
    first: float


def sheet_of(measured: Measured, thinned: bool = True) -> Sheet:
    """The points with good normals, made one sheet where layers overlap (if ``thinned``), none twice."""
    ready = prepare(measured.points, measured.normals, measured.eyes)
    points, normals, distance = ready.points, ready.normals, 0.0
    if thinned:
        distance = thinning_distance(points, normals, ready.tree)
    if distance > 0:
        sheet = thin(points, normals, distance, ready.toward, ready.tree)
        points, normals = sheet.points, sheet.normals
    else:
        _, first = np.unique(points, axis=0, return_index=True)
        points, normals = points[np.sort(first)], normals[np.sort(first)]
    scale = cloud_scale(points)
    return Sheet(points, normals, distance, scale.spacing, first_radius(scale))


def thinning_for(measured: Measured, count: int) -> float:
    """The distance of a thinning that leaves about ``count`` points, 0 if there are no more than that."""
    ready = prepare(measured.points, measured.normals, measured.eyes)
    if len(ready.points) <= count:
        return 0.0
    distance = cloud_scale(ready.points, ready.tree).spacing * float(np.sqrt(len(ready.points) / count))
    for _ in range(_ROUNDS):
        left = len(thin(ready.points, ready.normals, distance, ready.toward, ready.tree).points)
        if abs(left - count) <= 0.005 * count:
            break
        distance *= float(np.sqrt(left / count))
    return distance


def radius_sweep(sheet: Sheet, radii: Sequence[float]) -> list[dict[str, Any]]:
    """One pass of each ball alone, no hole closed; ``radii`` in spacings of the sheet."""
    rows = []
    for share in radii:
        row: dict[str, Any] = {"radius": share, "triangles": 0, "used": 0.0, "Q_equ": np.nan, "Q_nor": np.nan}
        row |= {"holes": 0, "border_length": np.nan, "components": 0, "seconds": 0.0}
        begun = time.process_time()
        faces = _one_pass(sheet, share * sheet.spacing, None)
        row["seconds"] = time.process_time() - begun
        if len(faces):
            measures = quality(ObjectMesh(sheet.points, faces))
            row |= {
                "triangles": measures.triangles,
                "used": 1 - measures.unused_vertices / len(sheet.points),
                "Q_equ": measures.Q_equ,
                "Q_nor": measures.Q_nor,
                "holes": measures.border_loops,
                "border_length": measures.border_length / sheet.spacing,
                "components": measures.components,
            }
        rows.append(row)
    return rows


def timed_passes(sheet: Sheet, growth: Sequence[float]) -> list[dict[str, Any]]:
    """Passes of the ball, each on what the one before left open: radii ``growth`` times the first ball's."""
    rows, faces = [], np.zeros((0, 3), np.int64)
    for factor in growth:
        radius = min(factor * sheet.first, LARGEST * sheet.spacing)
        begun, before = time.process_time(), len(faces)
        faces = _one_pass(sheet, radius, faces)
        seconds = time.process_time() - begun
        rows.append(
            {
                "radius": radius / sheet.spacing,
                "seconds": seconds,
                "triangles": len(faces) - before,
                "border_length": border_length(sheet.points, adjacency(faces)) / sheet.spacing,
                "used": len(np.unique(faces)) / len(sheet.points),
            }
        )
    return rows


def _one_pass(sheet: Sheet, radius: float, faces: Int[np.ndarray, "m 3"] | None) -> Int[np.ndarray, "k 3"]:
    """The triangles after a pass: those there were where a ball finds no place to begin."""
    try:
        return run_passes(sheet.points, sheet.normals, [radius], sheet.spacing, faces)[0]
    except InputError:
        return np.zeros((0, 3), np.int64) if faces is None else faces
