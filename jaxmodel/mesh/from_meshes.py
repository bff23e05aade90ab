"""Ball pivoting from what is meshed already: the views' local meshes, or the border of a mesh (thesis §3.3.1)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.mesh.adjacency import adjacency, face_vectors, vertex_normals
from jaxmodel.mesh.ball_pivoting import Pivoting, Thinning, ball_pivoting
from jaxmodel.mesh.closing import close
from jaxmodel.mesh.holes import MOST_EDGES
from jaxmodel.mesh.passes import Pass, Radii, run_passes
from jaxmodel.mesh.radii import cloud_scale, thinning_distance
from jaxmodel.scan.triangle_mesh import ObjectMesh

FIT = 0.9  # share of the border's triangles that the first ball rests on


class Closed(NamedTuple):
    """``mesh`` with its border closed as far as asked, the passes of the ball, and the triangles added in all."""

    mesh: ObjectMesh
    passes: tuple[Pass, ...]
    added: int


def pivot_views(views: Sequence[ObjectMesh], radii: Radii = "auto", *, thinning: Thinning = "auto") -> Pivoting:
    """One mesh from the local meshes of registered views, all in one frame, counter-clockwise seen from the sensor.

    Their triangles give the normals and the seeds: the ball starts from those it rests on, and replaces the others.
    Rows of the result count through the views' vertices. Raises ``InputError`` as :func:`ball_pivoting` does.
    """
    if not views or not any(len(view.faces) for view in views):
        raise InputError("There is no view with triangles to start from.")
    start = np.cumsum([0] + [len(view.vertices) for view in views])
    points = np.concatenate([view.vertices for view in views])
    normals = np.concatenate([vertex_normals(view) for view in views])
    if thinning == "auto":
        single = float(np.median([cloud_scale(view.vertices).spacing for view in views if len(view.faces)]))
        thinning = thinning_distance(points, normals, view_spacing=single)
    return ball_pivoting(
        points,
        normals,
        radii,
        seeds=np.concatenate([view.faces + offset for view, offset in zip(views, start[:-1], strict=True)]),
        thinning=thinning,
    )


def close_border(mesh: ObjectMesh, radii: Radii = "auto", most_edges: int = MOST_EDGES) -> Closed:
    """``mesh`` with its holes closed from the border: by the ball, then holes of up to ``most_edges`` edges by patches.

    The vertices stay as they are. "auto" starts with the ball that rests on nine tenths of the border's triangles and
    grows while the border shrinks. Any consistently oriented mesh will do, such as one of marching cubes.
    """
    if len(mesh.faces) == 0:
        raise InputError("The mesh has no triangles: it has no border to start from.")
    radius = border_radius(mesh)
    if not radius > 0:
        return Closed(mesh, (), 0)
    normals = vertex_normals(mesh)
    faces, passes = run_passes(mesh.vertices, normals, radii, radius, mesh.faces)
    faces = close(mesh.vertices, normals, faces, most_edges)
    return Closed(ObjectMesh(mesh.vertices, faces), passes, len(faces) - len(mesh.faces))


def border_radius(mesh: ObjectMesh) -> float:
    """The radius around nine tenths of the triangles at the border, in the mesh's unit; 0 for a closed mesh."""
    shared = adjacency(mesh.faces)
    faces = mesh.faces[(shared.faces[shared.edge_of] == 1).any(axis=1)]
    corners = mesh.vertices[faces]
    sides = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    doubled = np.linalg.norm(face_vectors(mesh.vertices, faces), axis=1)
    radius = sides[doubled > 0].prod(axis=1) / (2 * doubled[doubled > 0])
    return float(np.quantile(radius, FIT)) if len(radius) else 0.0
