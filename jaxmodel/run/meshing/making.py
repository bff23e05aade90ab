"""A cloud made a mesh by one of the methods, with an account of what was done."""

from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError, RunError
from jaxmodel.mesh.adjacency import vertex_normals
from jaxmodel.mesh.ball_pivoting import Pivoting, ball_pivoting
from jaxmodel.mesh.manifold import used_vertices, without_small_parts
from jaxmodel.run.meshing.clouds import Measured
from jaxmodel.run.meshing.options import Options
from jaxmodel.scan.triangle_mesh import ObjectMesh


class Made(NamedTuple):
    """``normals`` of the vertices; ``passes`` of the ball, empty for other methods; ``points``: what became of them.

    ``sentence`` says how the method ended.
    """

    mesh: ObjectMesh
    normals: Float[np.ndarray, "n 3"]
    passes: tuple[dict[str, Any], ...]
    points: dict[str, Any]
    sentence: str


def make_mesh(measured: Measured, options: Options) -> Made:
    """The mesh. Raises :class:`InputError` naming the file, :class:`RunError` when not a triangle came out."""
    try:
        made = _METHODS[options.method](measured, options)
    except InputError as error:
        raise InputError(f"{measured.name}: {error}") from error
    if len(made.mesh.faces) == 0:
        raise RunError(f"{measured.name}: {options.method} left no triangle")
    return made


def _ball_pivoting(measured: Measured, options: Options) -> Made:
    result = ball_pivoting(
        measured.points,
        measured.normals,
        cast(Any, options.radii),
        eyes=measured.eyes,
        thinning=cast(Any, options.thinning),
        smallest_part=options.smallest_part,
        closing=options.closing,
    )
    points = _read(measured) | {
        "thinning_distance": result.thinned,
        "vertices": len(result.mesh.vertices),
        "unused": len(result.unused),
        "bad_normals": len(result.bad_normals),
        "turned_normals": len(result.turned),
        "estimated_normals": result.estimated,
        "closing_triangles": result.closing,
        "dropped_triangles": result.dropped,
    }
    return Made(result.mesh, result.normals, tuple(p._asdict() for p in result.passes), points, _ball_sentence(result))


def _ball_sentence(result: Pivoting) -> str:
    passes = f"after {len(result.passes)} pass{'es' if len(result.passes) > 1 else ''} of the ball"
    return f"{passes} and {result.closing} triangles that close holes" if result.closing > 0 else passes


def _deformable(measured: Measured, options: Options) -> Made:
    from jaxmodel.mesh.deformable import deform

    surface = deform(measured.points, options.order, cast(Any, options.start))
    points = _read(measured) | {"mean_distance": surface.error, "steps": surface.steps}
    sentence = f"{surface.outcome.sentence}, after {surface.steps} steps"
    return Made(surface.mesh, vertex_normals(surface.mesh), (), points, sentence)


def _marching_cubes(measured: Measured, options: Options) -> Made:
    from jaxmodel.mesh.marching_cubes import marching_cubes

    mesh = marching_cubes(measured.points, measured.normals, cast(Any, options.cell))
    return _volumetric(mesh, measured, options, "the surface of distance zero was cut out of the grid")


def _poisson(measured: Measured, options: Options) -> Made:
    from jaxmodel.mesh.poisson import poisson

    mesh = poisson(measured.points, measured.normals, options.depth)
    return _volumetric(mesh, measured, options, "the indicator function was solved and cut at its level")


def _volumetric(mesh: ObjectMesh, measured: Measured, options: Options, sentence: str) -> Made:
    if options.smallest_part > 0:
        kept = without_small_parts(mesh.vertices, mesh.faces, options.smallest_part)
        used, faces = used_vertices(kept, len(mesh.vertices))
        mesh = ObjectMesh(mesh.vertices[used], faces)
    points = _read(measured) | {"estimated_normals": measured.normals is None}
    return Made(mesh, vertex_normals(mesh), (), points, sentence)


def _read(measured: Measured) -> dict[str, Any]:
    return {
        "read": len(measured.points),
        "given_normals": measured.normals is not None,
        "sensor_positions": measured.eyes is not None,
    }


_METHODS = {
    "ball-pivoting": _ball_pivoting,
    "deformable": _deformable,
    "marching-cubes": _marching_cubes,
    "poisson": _poisson,
}
