"""Meshes that grow view by view: the whole equals the one-shot mesh, and what a view does not touch stays."""

import numpy as np
import pytest

from jaxmodel.mesh.ball_pivoting import ball_pivoting
from jaxmodel.mesh.distance import surface_distance
from jaxmodel.mesh.incremental import GrowingMesh, add_view, first_view
from jaxmodel.mesh.quality import quality
from jaxmodel.scan.triangle_mesh import icosphere

NOISE = 0.002


def view(towards: tuple[float, float, float], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Noisy points of the unit sphere seen from ``towards``, and their true normals."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(12_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals[normals @ np.array(towards) > 0.1]
    return normals * (1 + NOISE * rng.normal(size=(len(normals), 1))), normals


VIEWS = [
    view(towards, seed)
    for seed, towards in enumerate([(0, 0, 1.0), (0, 0, -1.0), (1.0, 0, 0), (-1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0)])
]


@pytest.fixture(scope="module")
def grown() -> GrowingMesh:
    model = first_view(*VIEWS[0], distance=0.05)
    for points, normals in VIEWS[1:]:
        model = add_view(model, points, normals).mesh
    return model


def test_six_views_make_the_sphere_as_good_as_at_once(grown: GrowingMesh) -> None:
    made = quality(grown.mesh(0.01))
    assert made.closed and made.euler == 2
    points, normals = (np.concatenate(both) for both in zip(*VIEWS, strict=True))
    # a thin cloud leaves wider gaps when thinned than a dense one: compared at the same number of vertices
    dense = ball_pivoting(points, normals, thinning=0.05).mesh
    once = ball_pivoting(points, normals, thinning=0.05 * np.sqrt(len(dense.vertices) / made.vertices))
    assert quality(once.mesh).vertices == pytest.approx(made.vertices, rel=0.05)
    truth, expected = icosphere(6), quality(once.mesh)
    assert (made.Q_equ, made.Q_nor, made.area) == pytest.approx(
        (expected.Q_equ, expected.Q_nor, expected.area), rel=0.05
    )
    assert (
        surface_distance(grown.mesh(0.01), truth, samples=20_000).mean
        <= 1.05 * surface_distance(once.mesh, truth, samples=20_000).mean
    )


def test_a_view_seen_already_adds_nothing_but_weight(grown: GrowingMesh) -> None:
    again = add_view(grown, *VIEWS[2])
    assert again.added == 0 and again.redundant == len(VIEWS[2][0])
    np.testing.assert_array_equal(again.mesh.faces, grown.faces)
    assert (again.mesh.weight >= grown.weight).all() and again.mesh.weight.sum() > grown.weight.sum()


def test_far_from_new_points_the_mesh_stays() -> None:
    model = first_view(*VIEWS[0], distance=0.05)
    points, normals = VIEWS[2]
    near = normals[:, 0] > 0.8
    after = add_view(model, points[near], normals[near])
    assert after.added > 0
    far = model.vertices[model.faces][(model.normals[model.faces][:, :, 0] < 0.2).all(axis=1)]
    kept = {corners.tobytes() for corners in after.mesh.vertices[after.mesh.faces]}
    assert len(far) > 500 and all(corners.tobytes() in kept for corners in far)
    found = quality(after.mesh.mesh())
    assert (found.crowded_edges, found.turned_pairs) == (0, 0)


def test_bad_normals_of_a_view_are_reported() -> None:
    points, normals = VIEWS[1]
    spoilt = normals.copy()
    spoilt[[3, 40]] = np.nan
    found = add_view(first_view(*VIEWS[0], distance=0.05), points, spoilt)
    np.testing.assert_array_equal(found.bad_normals, [3, 40])
