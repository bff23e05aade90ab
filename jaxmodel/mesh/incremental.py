"""A mesh that grows view by view, each view touching only the zone where it brings something (thesis §3.3.7)."""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from jaxmodel.mesh.adjacency import adjacency, face_components
from jaxmodel.mesh.ball_pivoting import ball_pivoting
from jaxmodel.mesh.closing import close, near_points
from jaxmodel.mesh.growth import grow, open_vertices
from jaxmodel.mesh.manifold import used_vertices, without_small_parts
from jaxmodel.mesh.prepare import Eyes, Prepared, prepare
from jaxmodel.mesh.projection import project
from jaxmodel.mesh.radii import GROWTH, PER_VIEW, cloud_scale, widest_gap
from jaxmodel.mesh.thinning import REACH, thin
from jaxmodel.scan.triangle_mesh import ObjectMesh

OPENED = 2.0
ZONE = 5.0
CANDIDATES = 8
CRUMB = 100
BESIDE = 4.0
IN_REACH = 32  # points of one view within reach: about 24


class GrowingMesh(eqx.Module):
    """A mesh and what growing it needs, in the unit of its points.

    ``normals`` unit at each vertex; ``weight`` of the measured points its place is the mean of; ``distance`` that
    vertices keep along the surface.
    """

    vertices: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    weight: Float[np.ndarray, " n"]
    faces: Int[np.ndarray, "m 3"]
    distance: float

    def mesh(self, smallest_part: float = 0.0) -> ObjectMesh:
        """The triangles and the vertices they use, without components below a share ``smallest_part`` of the area."""
        faces = without_small_parts(self.vertices, self.faces, smallest_part)
        kept = _without_idle(eqx.tree_at(lambda model: model.faces, self, faces))
        return ObjectMesh(kept.vertices, kept.faces)


class Growth(NamedTuple):
    """``mesh`` with one more view; of its points, ``redundant`` lay on the mesh and ``added`` became vertices.

    ``bad_normals`` rows of the view left out because of their normal.
    """

    mesh: GrowingMesh
    redundant: int
    added: int
    bad_normals: Int[np.ndarray, " b"]


def first_view(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "m 3"] | None = None,
    *,
    eyes: Eyes | None = None,
    distance: float | None = None,
) -> GrowingMesh:
    """The mesh of one view. ``distance`` between vertices is 1.1 of the view's own spacing unless given.

    Raises ``InputError`` as :func:`jaxmodel.mesh.ball_pivoting.ball_pivoting` does.
    """
    distance = PER_VIEW * cloud_scale(points).spacing if distance is None else distance
    made = ball_pivoting(points, normals, eyes=eyes, thinning=distance)
    return GrowingMesh(made.mesh.vertices, made.normals, made.weight, made.mesh.faces, distance)


def add_view(
    model: GrowingMesh,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "m 3"] | None = None,
    *,
    eyes: Eyes | None = None,
) -> Growth:
    """``model`` grown by a view in the same frame.

    Vertices that the view saw again move to the mean of all that was measured of them. Points of the view that lie on
    the mesh are redundant; of the others those the thinning keeps become vertices, the border near them is opened,
    and only there the ball rolls, holes are closed where points lie, and the new part is welded to the old.
    """
    view = prepare(points, normals, eyes)
    vertices, vertex_normals, weight = _averaged(model, view)
    fresh = ~_covered(view, vertices, vertex_normals, model.distance)
    fresh[fresh] = ~_on_triangles(view.points[fresh], vertices, model.faces, model.distance)
    added = _new_vertices(view, fresh, model.distance)
    grown = GrowingMesh(
        vertices=np.concatenate([vertices, added.vertices]),
        normals=np.concatenate([vertex_normals, added.normals]),
        weight=np.concatenate([weight, added.weight]),
        faces=model.faces,
        distance=model.distance,
    )
    new = np.arange(len(grown.vertices)) >= len(vertices)
    again = np.append(weight > model.weight, new[len(vertices) :]) & open_vertices(grown.faces, len(new))
    grown = _without_idle(_rolled(grown, new, again, view))
    return Growth(grown, int((~fresh).sum()), len(added.vertices), view.oriented.bad)


def _averaged(
    model: GrowingMesh, view: Prepared
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Places, normals and weights of the vertices after the view's points have been averaged in."""
    reach = REACH * model.distance
    gap, _ = view.tree.query(model.vertices, distance_upper_bound=reach, workers=-1)
    rows = np.flatnonzero(np.isfinite(gap))
    seen = project(model.vertices[rows], model.normals[rows], view.points, view.normals, reach, view.tree, IN_REACH)
    vertices, normals, weight = model.vertices.copy(), model.normals.copy(), model.weight.copy()
    weight[rows] += seen.weight
    share = (seen.weight / weight[rows])[:, None]
    vertices[rows] += share * (seen.points - vertices[rows])
    normals[rows] += share * (seen.normals - normals[rows])
    normals[rows] /= np.linalg.norm(normals[rows], axis=1, keepdims=True)
    return vertices, normals, weight


def _covered(view: Prepared, vertices: np.ndarray, normals: np.ndarray, distance: float) -> Bool[np.ndarray, " g"]:
    """Points of the view that belong to the group of a vertex, as in the thinning."""
    gap, index = KDTree(vertices).query(
        view.points, k=min(CANDIDATES, len(vertices)), distance_upper_bound=np.sqrt(2) * distance, workers=-1
    )
    gap, index = gap.reshape(len(view.points), -1), index.reshape(len(view.points), -1)
    found = np.isfinite(gap)
    index = np.where(found, index, 0)
    both = normals[index] + view.normals[:, None]
    square = np.einsum("gka,gka->gk", both, both)
    chord = vertices[index] - view.points[:, None]
    height = np.einsum("gka,gka->gk", chord, both) / np.sqrt(np.where(square > 0, square, 1.0))
    along = np.where(found, gap, np.inf) ** 2 - height**2
    return (found & (square > 2.0) & (np.abs(height) < distance) & (along < distance**2)).any(axis=1)


def _on_triangles(
    points: Float[np.ndarray, "f 3"], vertices: np.ndarray, faces: np.ndarray, distance: float
) -> Bool[np.ndarray, " f"]:
    """Points over a triangle rather than beyond the border: within the distance across, half of it along."""
    import open3d as o3d

    if len(points) == 0:
        return np.zeros(0, bool)
    gap, _ = KDTree(points).query(vertices, distance_upper_bound=BESIDE * distance, workers=-1)
    faces = faces[np.isfinite(gap)[faces].any(axis=1)]
    if len(faces) == 0:
        return np.zeros(len(points), bool)
    centre = points.mean(axis=0)
    scene = o3d.t.geometry.RaycastingScene()
    corners = o3d.core.Tensor(np.ascontiguousarray((vertices - centre) / distance, np.float32))
    scene.add_triangles(corners, o3d.core.Tensor(np.ascontiguousarray(faces, np.uint32)))
    place = np.ascontiguousarray((points - centre) / distance, np.float32)
    found = scene.compute_closest_points(o3d.core.Tensor(place))
    chord = place - found["points"].numpy()
    normals = found["primitive_normals"].numpy()
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    height = np.einsum("fa,fa->f", chord, normals)
    along = np.linalg.norm(chord - height[:, None] * normals, axis=1)
    return (along < 0.5) & (np.abs(height) < 1.0)


def _new_vertices(view: Prepared, fresh: np.ndarray, distance: float) -> GrowingMesh:
    """The fresh points thinned, on the mean surface of the whole view."""
    points, normals = view.points[fresh], view.normals[fresh]
    toward = None if view.toward is None else view.toward[fresh]
    kept = thin(points, normals, distance, toward).source if len(points) > 1 else np.arange(len(points))
    onto = project(points[kept], normals[kept], view.points, view.normals, REACH * distance, view.tree, IN_REACH)
    return GrowingMesh(onto.points, onto.normals, onto.weight, np.zeros((0, 3), np.int64), distance)


def _rolled(
    model: GrowingMesh, new: Bool[np.ndarray, " n"], again: Bool[np.ndarray, " n"], view: Prepared
) -> GrowingMesh:
    """``model`` with the triangles its ``new`` vertices and the open ones seen ``again`` allow, all else as it was."""
    if not again.any():
        return model
    gap, _ = KDTree(model.vertices[again]).query(model.vertices, distance_upper_bound=ZONE * model.distance, workers=-1)
    touched = np.isfinite(gap)[model.faces].any(axis=1)
    zone = np.isfinite(gap)
    zone[model.faces[touched]] = True
    rows = np.flatnonzero(zone)
    beyond = np.zeros(len(zone), bool)
    beyond[model.faces[~touched]] = True
    vertices, normals, fixed = model.vertices[rows], model.normals[rows], beyond[rows]
    faces = _opened(vertices, (np.cumsum(zone) - 1)[model.faces[touched]], new[rows], fixed, OPENED * model.distance)
    spacing = cloud_scale(vertices).spacing
    for radius in (spacing, GROWTH * spacing):
        faces = grow(vertices, normals, faces, radius, fixed)
    faces = _without_crumbs(faces, fixed)
    reach = max(spacing, widest_gap(cloud_scale(view.points, view.tree).spacing, len(view.points)))
    near = near_points(KDTree(np.concatenate([view.points, vertices])), reach, vertices)
    faces = close(vertices, normals, faces, accept=near, fixed=fixed)
    return eqx.tree_at(lambda grown: grown.faces, model, np.concatenate([model.faces[~touched], rows[faces]]))


def _without_idle(model: GrowingMesh) -> GrowingMesh:
    """``model`` without the vertices no triangle uses."""
    used, faces = used_vertices(model.faces, len(model.vertices))
    return GrowingMesh(model.vertices[used], model.normals[used], model.weight[used], faces, model.distance)


def _opened(
    vertices: np.ndarray, faces: np.ndarray, new: np.ndarray, fixed: np.ndarray, distance: float
) -> Int[np.ndarray, "k 3"]:
    """``faces`` without the ragged ones: at the border, within ``distance`` of a new vertex."""
    if not new.any():
        return faces
    gap, _ = KDTree(vertices[new]).query(vertices, distance_upper_bound=distance)
    ragged = open_vertices(faces, len(vertices)) & ~fixed & np.isfinite(gap)
    return faces[~ragged[faces].any(axis=1) | fixed[faces].any(axis=1)]


def _without_crumbs(faces: Int[np.ndarray, "m 3"], fixed: Bool[np.ndarray, " n"]) -> Int[np.ndarray, "k 3"]:
    """``faces`` without the components of a few triangles that nothing beyond the zone holds."""
    count, part = face_components(len(faces), adjacency(faces).pairs)
    size = np.bincount(part, minlength=count)
    held = np.bincount(part, fixed[faces].any(axis=1), count) > 0
    return faces[(held | (size >= CRUMB))[part]]
