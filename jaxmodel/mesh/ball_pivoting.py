"""Ball pivoting of a cloud: checked normals, one sheet, radii from the cloud, and an account of what was done."""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.errors import InputError
from jaxmodel.mesh.closing import along_points, close, near_points
from jaxmodel.mesh.crossings import crossing_sheets
from jaxmodel.mesh.growth import rests
from jaxmodel.mesh.manifold import clean, used_vertices, without_small_parts
from jaxmodel.mesh.passes import Pass, Radii, run_passes
from jaxmodel.mesh.prepare import Eyes, prepare
from jaxmodel.mesh.radii import cloud_scale, first_radius, thinning_distance, widest_gap
from jaxmodel.mesh.thinning import thin
from jaxmodel.scan.triangle_mesh import ObjectMesh

Thinning = float | Literal["auto"] | None


class Pivoting(eqx.Module):
    """A mesh by ball pivoting and how it came about; lengths in the unit of the points.

    ``source`` the row of the input each vertex of ``mesh`` was, ``normals`` the sheet's there, ``weight`` of
    the points around it that it is the mean of (1 without thinning). ``thinned`` the distance
    of the thinning, 0 without. ``closing`` triangles that closed holes, ``dropped`` of the ball's that did not fit one
    surface or made way for these. Rows of the input: ``unused`` points the
    ball never reached, ``bad_normals`` left out because of their normal, ``turned`` taken with the normal reversed.
    ``estimated`` whether the normals were made here.
    """

    mesh: ObjectMesh
    normals: Float[np.ndarray, "k 3"]
    weight: Float[np.ndarray, " k"]
    source: Int[np.ndarray, " k"]
    passes: tuple[Pass, ...]
    closing: int
    dropped: int
    thinned: float
    unused: Int[np.ndarray, " u"]
    bad_normals: Int[np.ndarray, " b"]
    turned: Int[np.ndarray, " t"]
    estimated: bool


def ball_pivot(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "m 3"] | None = None,
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
    normals: Float[np.ndarray, "m 3"] | None = None,
    radii: Radii = "auto",
    *,
    eyes: Eyes | None = None,
    seeds: Int[np.ndarray, "s 3"] | None = None,
    thinning: Thinning = "auto",
    smallest_part: float = 0.0,
    closing: bool = True,
) -> Pivoting:
    """A triangle mesh over a cloud: one sheet where views overlap, oriented, every edge with one or two triangles.

    Prefer it to volumetric methods when measured points are to stay vertices and what no scan saw is to stay open.
    ``radii`` grow from the cloud's own spacing until the border stops shrinking, or are passes as given, ascending.
    ``eyes`` homogeneous sensor position of each point (direction, if at infinity), or one for all: decides the
    normals' side and which point of an overlap is best. ``seeds`` triangles of rows, such as the views' own meshes:
    those on which the ball rests are where it starts.
    Sheets that pass through one another are meshed one by one. ``thinning`` the distance that stays between points,
    "auto" only where layers overlap, None for never (points that coincide are always merged). ``smallest_part`` the
    share of the area below which a component is dropped. ``closing`` closes the holes along which points lie.
    Raises ``InputError``: bad points (see :func:`check_points`), a line of points, normals or radii unfit.
    """
    kept, kept_normals, toward, good, tree, oriented = prepare(points, normals, eyes)
    distance = thinning_distance(kept, kept_normals, tree) if thinning == "auto" else float(thinning or 0.0)
    if distance > 0:
        sheet = thin(kept, kept_normals, distance, toward, tree)
        vertices, vertex_normals, weight, source = sheet.points, sheet.normals, sheet.weight, good[sheet.source]
    else:
        _, first = np.unique(kept, axis=0, return_index=True)
        first = np.sort(first)
        kept, kept_normals, good = kept[first], kept_normals[first], good[first]
        tree = KDTree(kept)
        vertices, vertex_normals, weight, source = kept, kept_normals, np.ones(len(kept)), good
    scale = cloud_scale(vertices)
    spacing = scale.spacing
    reach = max(spacing, widest_gap(cloud_scale(kept, tree).spacing, len(kept)))

    def seen(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, " f"]:
        return along_points(tree, reach, vertices, faces)

    sheet = crossing_sheets(vertices, vertex_normals, spacing)
    start = None if seeds is None else _seeds(vertices, vertex_normals, source, seeds, len(points), spacing)
    faces, passes = run_passes(vertices, vertex_normals, radii, spacing, start, first_radius(scale), seen, sheet)
    pivoted = faces
    accept = near_points(tree, reach, vertices)
    faces = close(vertices, vertex_normals, faces, accept=accept if closing else lambda patch: False)
    faces = without_small_parts(vertices, faces, smallest_part)
    rolled = int(_among(faces, pivoted, len(vertices)).sum())
    used, renumbered = used_vertices(faces, len(vertices))
    return Pivoting(
        mesh=ObjectMesh(vertices[used], renumbered),
        normals=vertex_normals[used],
        weight=weight[used],
        source=source[used],
        passes=passes,
        closing=len(faces) - rolled,
        dropped=len(pivoted) - rolled,
        thinned=distance,
        unused=np.delete(source, used),
        bad_normals=oriented.bad,
        turned=oriented.turned,
        estimated=oriented.estimated,
    )


def _among(faces: Int[np.ndarray, "m 3"], others: Int[np.ndarray, "k 3"], count: int) -> Bool[np.ndarray, " m"]:
    """Which of ``faces`` have the corners of one of ``others``, in any order."""
    first, second = (np.sort(of, axis=1) for of in (faces, others))
    edges, opposite = np.concatenate([first, second])[:, :2] @ [count, 1], np.concatenate([first, second])[:, 2]
    _, edge = np.unique(edges, return_inverse=True)
    key = edge.reshape(-1) * np.int64(count) + opposite
    return np.isin(key[: len(faces)], key[len(faces) :])


def _seeds(
    vertices: Float[np.ndarray, "k 3"],
    normals: Float[np.ndarray, "k 3"],
    source: Int[np.ndarray, " k"],
    seeds: Int[np.ndarray, "s 3"],
    count: int,
    spacing: float,
) -> Int[np.ndarray, "j 3"]:
    """Those of ``seeds`` whose corners all became vertices and on which the first ball rests, as vertices."""
    vertex_of = np.full(count, -1)
    vertex_of[source] = np.arange(len(source))
    faces = vertex_of[seeds]
    faces = faces[(faces >= 0).all(axis=1)]
    return clean(vertices, normals, faces[rests(vertices, normals, faces, spacing)])
