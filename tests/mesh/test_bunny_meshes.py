"""The bunny's ten posed scans as one mesh: near the reference, open only where unseen, at once or one by one."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial import KDTree

from jaxmodel.mesh import Quality, ball_pivoting, quality
from jaxmodel.mesh.adjacency import adjacency
from jaxmodel.mesh.distance import sample_surface, surface_distance, to_surface
from jaxmodel.mesh.incremental import GrowingMesh, add_view, first_view
from jaxmodel.mesh.radii import cloud_scale
from jaxmodel.scan.triangle_mesh import ObjectMesh

SAMPLES = 200_000
SEEN_POINTS = 3

pytestmark = [pytest.mark.data, pytest.mark.slow]


class View(NamedTuple):
    points: np.ndarray
    normals: np.ndarray
    eyes: np.ndarray


class Bunny(NamedTuple):
    """``views`` in the frame of ``reference``, metres."""

    views: list[View]
    reference: ObjectMesh

    def all(self, every: int = 1) -> View:
        return View(*(np.concatenate(of)[::every] for of in zip(*self.views, strict=True)))


@pytest.fixture(scope="module")
def bunny(data_dir: Path) -> Bunny:
    from jaxmodel.io.datasets import StanfordBunny
    from jaxmodel.io.meshes import load_mesh
    from jaxmodel.scan.range_image import to_cloud

    found = StanfordBunny(data_dir)
    views = []
    for name in found.names:
        image, T_world_scan = found.scan(name), found.T_world_scan(name)
        cloud = to_cloud(image).moved(T_world_scan)
        eyes = np.tile(T_world_scan @ image.eye, (len(cloud), 1))
        views.append(View(np.asarray(cloud.points, np.float64), np.asarray(cloud.normals, np.float64), eyes))
    return Bunny(views, load_mesh(data_dir / "stanford_bunny" / "reconstruction" / "bun_zipper.ply"))


@pytest.fixture(scope="module")
def whole(bunny: Bunny) -> ObjectMesh:
    points, normals, eyes = bunny.all()
    return ball_pivoting(points, normals, eyes=eyes).mesh


def check(mesh: ObjectMesh, reference: ObjectMesh) -> Quality:
    found, wanted = quality(mesh), quality(reference)
    assert found.largest_share >= 0.99
    assert found.area == pytest.approx(wanted.area, rel=0.01)
    assert found.border_length <= 2 * wanted.border_length
    assert (found.crowded_edges, found.turned_pairs) == (0, 0)
    assert surface_distance(mesh, reference, samples=20_000).mean <= 0.06e-3
    return found


def test_bunny_of_ten_posed_scans(bunny: Bunny, whole: ObjectMesh) -> None:
    check(whole, bunny.reference)
    points, normals, eyes = bunny.all(4)
    check(ball_pivoting(points, normals, eyes=eyes).mesh, bunny.reference)


def test_bunny_is_open_only_where_no_scan_saw_it(bunny: Bunny, whole: ObjectMesh) -> None:
    points, spacing = bunny.all().points, cloud_scale(whole.vertices).spacing
    sampled = sample_surface(bunny.reference, SAMPLES)
    away = to_surface(sampled, whole)
    shared = adjacency(whole.faces)
    ends = whole.vertices[shared.edges[shared.faces == 1]]
    border = np.concatenate([(1 - t) * ends[:, 0] + t * ends[:, 1] for t in np.linspace(0.0, 1.0, 9)])
    to_border, _ = KDTree(border).query(sampled, workers=-1)
    # of the reference, what lies in a hole: nothing of the mesh is nearer than the hole's border
    in_hole = (away > 0.5 * spacing) & (to_border < away + 0.1 * spacing)
    assert in_hole.sum() > 100  # the holes of the base
    around = np.array([len(near) for near in KDTree(points).query_ball_point(sampled[in_hole], 0.5 * spacing)])
    assert (around < SEEN_POINTS).all()


def test_grown_scan_by_scan_it_is_as_good_as_at_once(bunny: Bunny, whole: ObjectMesh) -> None:
    model: GrowingMesh | None = None
    for points, normals, eyes in bunny.views:
        if model is None:
            model = first_view(points, normals, eyes=eyes)
        else:
            model = add_view(model, points, normals, eyes=eyes).mesh
    assert model is not None
    grown = model.mesh(0.01)
    found, once = check(grown, bunny.reference), quality(whole)
    assert (found.Q_equ, found.Q_nor, found.area) == pytest.approx((once.Q_equ, once.Q_nor, once.area), rel=0.05)
    apart, apart_at_once = (surface_distance(mesh, bunny.reference) for mesh in (grown, whole))
    assert apart.there.mean <= 1.05 * apart_at_once.there.mean
    assert apart.back.mean <= 1.05 * apart_at_once.back.mean
