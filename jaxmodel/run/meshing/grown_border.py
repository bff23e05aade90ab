"""The thesis's Fig. 3.1: the mesh that one view has already, and from its border the points of the other views."""

from typing import Any, NamedTuple

import numpy as np

from jaxmodel.io.datasets import MeshViews, StanfordBunny
from jaxmodel.mesh.adjacency import vertex_normals
from jaxmodel.mesh.incremental import GrowingMesh, add_view
from jaxmodel.mesh.lying_over import lying_over
from jaxmodel.mesh.manifold import clean
from jaxmodel.mesh.quality import quality
from jaxmodel.mesh.radii import cloud_scale
from jaxmodel.scan.objects import object_mesh
from jaxmodel.scan.range_image import RangeImage, grid_triangles, to_cloud
from jaxmodel.scan.triangle_mesh import ObjectMesh

BUNNY = ("bun000", "bun045", "bun090", "bun315")
_PER_VIEW = 1.1  # distance between vertices, in spacings of the first view


class Views(NamedTuple):
    """Four registered range images, their poses in one frame, and the files they came from."""

    images: list[RangeImage]
    poses: list[np.ndarray]
    files: list[str]


class Grown(NamedTuple):
    """``first`` the mesh of view 1, ``mesh`` the whole; ``owner`` of each triangle: the view that brought it.

    ``rows`` what is to be told, view by view.
    """

    first: ObjectMesh
    mesh: ObjectMesh
    owner: np.ndarray
    rows: list[dict[str, Any]]


def read_views(source: str, every: int) -> Views:
    """Four views of the bunny's scans, or of the built-in boulder; of their pixels ``every``-th row and column."""
    if source == "bunny":
        data = StanfordBunny()
        names, files = BUNNY, [str(data.path(name)) for name in BUNNY]
    else:
        data = MeshViews(source, object_mesh(source), [0, 45, 90, 315])
        names, files = data.names, []
    images = [_coarser(data.scan(name), every) for name in names]
    return Views(images, [data.T_world_scan(name) for name in names], files)


def grow_from_border(views: Views) -> Grown:
    """View 1's own mesh grown by the points of the others, one view after the other."""
    clouds = [to_cloud(image).moved(T) for image, T in zip(views.images, views.poses, strict=True)]
    first = ObjectMesh(clouds[0].points.astype(np.float64), grid_triangles(views.images[0]))
    normals = vertex_normals(first)
    faces = clean(first.vertices, normals, first.faces)
    used = np.unique(faces)
    place = np.searchsorted(used, faces)
    model = GrowingMesh(
        first.vertices[used], normals[used], np.ones(len(used)), place, _PER_VIEW * cloud_scale(first.vertices).spacing
    )
    start, rows = model.mesh(), []
    owner = np.zeros(len(model.faces), np.int64)
    for number, (cloud, image, T) in enumerate(zip(clouds[1:], views.images[1:], views.poses[1:], strict=True), 1):
        before = model
        grown = add_view(model, cloud.points.astype(np.float64), cloud.normals, eyes=T @ image.eye)
        model = grown.mesh
        old = _kept(before, owner, model)
        rows.append(
            {
                "view": number + 1,
                "points": len(cloud),
                "redundant": grown.redundant,
                "added": grown.added,
                "kept_triangles": int((old >= 0).sum()),
                "of_triangles": len(before.faces),
                "triangles": len(model.faces),
                "lying_over": int(lying_over(model.vertices, model.faces).sum()),
                "components": quality(model.mesh()).components,
            }
        )
        owner = np.where(old >= 0, old, number)
    return Grown(start, model.mesh(), owner, rows)


def _kept(before: GrowingMesh, owner: np.ndarray, after: GrowingMesh) -> np.ndarray:
    """Who brought each triangle of ``after``: its owner in ``before`` if it was there already, else -1.

    Vertices move a little as they are averaged, by less than their distance; the nearest one is the same one.
    """
    from scipy.spatial import KDTree

    gap, was = KDTree(before.vertices).query(after.vertices, distance_upper_bound=0.5 * before.distance)
    was = np.where(np.isfinite(gap), was, len(before.vertices))
    known = {tuple(row): owner[k] for k, row in enumerate(np.sort(before.faces, axis=1).tolist())}
    return np.array([known.get(tuple(row), -1) for row in np.sort(was[after.faces], axis=1).tolist()])


def _coarser(image: RangeImage, every: int) -> RangeImage:
    return RangeImage(image.points[::every, ::every], image.valid[::every, ::every], image.eye)
