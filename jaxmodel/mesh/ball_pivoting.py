"""Ball pivoting of a cloud: checked normals, one sheet, radii from the cloud, and an account of what was done."""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.mesh.closing import close, near_points
from jaxmodel.mesh.manifold import without_small_parts
from jaxmodel.mesh.orientation import orient
from jaxmodel.mesh.passes import Pass, Radii, run_passes
from jaxmodel.mesh.radii import cloud_scale, thinning_distance
from jaxmodel.mesh.thinning import thin
from jaxmodel.scan.cloud import check_points
from jaxmodel.scan.triangle_mesh import ObjectMesh

Thinning = float | Literal["auto"] | None
Eyes = Float[np.ndarray, "n 4"] | Float[np.ndarray, "4"]


class Pivoting(eqx.Module):
    """A mesh by ball pivoting and how it came about; lengths in the unit of the points.

    ``source`` the row of the input each vertex of ``mesh`` was, ``normals`` the sheet's there. ``thinned`` the distance
    of the thinning, 0 without. ``closing`` triangles that closed holes. Rows of the input: ``unused`` points the
    ball never reached, ``bad_normals`` left out because of their normal, ``turned`` taken with the normal reversed.
    ``estimated`` whether the normals were made here.
    """

    mesh: ObjectMesh
    normals: Float[np.ndarray, "k 3"]
    source: Int[np.ndarray, " k"]
    passes: tuple[Pass, ...]
    closing: int
    thinned: float
    unused: Int[np.ndarray, " u"]
    bad_normals: Int[np.ndarray, " b"]
    turned: Int[np.ndarray, " t"]
    estimated: bool


def ball_pivot(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"] | None = None,
    radii: Radii = "auto",
    *,
    eyes: Eyes | None = None,
    thinning: Thinning = "auto",
) -> ObjectMesh:
    """The mesh of :func:`ball_pivoting` alone.

    It cannot report, so it refuses (``InputError``) normals of which some are bad or inconsistently signed.
    """
    made = ball_pivoting(points, normals, radii, eyes=eyes, thinning=thinning)
    for rows, fault in ((made.bad_normals, "zero, not finite or stray"), (made.turned, "on the other side")):
        if len(rows):
            raise InputError(
                f"{len(rows)} of {len(points)} normals are {fault} (the first is row {rows[0]}, counted from 0): "
                "ball_pivoting repairs and lists them; or give none, and they are estimated."
            )
    return made.mesh


def ball_pivoting(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"] | None = None,
    radii: Radii = "auto",
    *,
    eyes: Eyes | None = None,
    thinning: Thinning = "auto",
    smallest_part: float = 0.0,
    closing: bool = True,
) -> Pivoting:
    """A triangle mesh over a cloud: one sheet where views overlap, oriented, every edge with one or two triangles.

    Prefer it to volumetric methods when measured points are to stay vertices and what no scan saw is to stay open.
    ``radii`` grow from the cloud's own spacing until the border stops shrinking, or are passes as given, ascending.
    ``eyes`` homogeneous sensor position of each point (direction, if at infinity), or one for all: decides the
    normals' side and which point of an overlap is best. ``thinning`` the distance that stays between points,
    "auto" only where layers overlap, None for never (points that coincide are always merged). ``smallest_part`` the
    share of the area below which a component is dropped. ``closing`` closes the holes along which points lie.
    Raises ``InputError``: bad points (see :func:`check_points`), a line of points, normals or radii unfit.
    """
    points = check_points(points).astype(np.float64)
    _check_extent(points)
    toward = None if eyes is None else _toward(points, eyes)
    tree = KDTree(points)
    oriented = orient(points, normals, toward, tree)
    good = np.setdiff1d(np.arange(len(points)), oriented.bad)
    if len(oriented.bad):
        tree = KDTree(points[good])
    kept, kept_normals = points[good], oriented.normals[good]
    distance = thinning_distance(kept, tree) if thinning == "auto" else float(thinning or 0.0)
    if distance > 0:
        sheet = thin(kept, kept_normals, distance, None if toward is None else toward[good])
        vertices, vertex_normals, source = sheet.points, sheet.normals, good[sheet.source]
    else:
        _, first = np.unique(kept, axis=0, return_index=True)
        first = np.sort(first)
        vertices, vertex_normals, source = kept[first], kept_normals[first], good[first]
    spacing = cloud_scale(vertices).spacing
    faces, passes = run_passes(vertices, vertex_normals, radii, spacing)
    pivoted = len(faces)
    accept = near_points(tree, spacing, vertices)
    faces = close(vertices, vertex_normals, faces, accept=accept if closing else lambda patch: False)
    faces = without_small_parts(vertices, faces, smallest_part)
    used, faces = np.unique(faces, return_inverse=True)
    idle = np.ones(len(vertices), bool)
    idle[used] = False
    return Pivoting(
        mesh=ObjectMesh(vertices[used], faces.reshape(-1, 3)),
        normals=vertex_normals[used],
        source=source[used],
        passes=passes,
        closing=len(faces) - pivoted,
        thinned=distance,
        unused=source[idle],
        bad_normals=oriented.bad,
        turned=oriented.turned,
        estimated=oriented.estimated,
    )


def _check_extent(points: Float[np.ndarray, "n 3"]) -> None:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < 1e-6 * spread[0]:
        raise InputError(f"All {len(points)} points lie on one line: there is no surface through them.")


def _toward(points: Float[np.ndarray, "n 3"], eyes: Eyes) -> Float[np.ndarray, "n 3"]:
    direction = eyes[..., :3] - eyes[..., 3:] * points
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return direction / np.where(length > 0, length, 1.0)
