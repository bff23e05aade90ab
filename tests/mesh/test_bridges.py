"""Strips that bridge a crease go to the primitives beside it, roundings of several rows stay."""

import numpy as np
import pytest

from jaxmodel.mesh import Outcome, ball_pivoting, segment
from jaxmodel.mesh.adjacency import adjacency, face_normals
from jaxmodel.mesh.bridges import bridging, take_in_bridges
from jaxmodel.mesh.primitives import Surface
from jaxmodel.scan.polyhedron import nine_facets
from jaxmodel.scan.triangle_mesh import ObjectMesh, box

RADIUS = 0.1


def pivoted(solid: ObjectMesh, noise: float) -> ObjectMesh:
    """A mesh of points on the solid's faces, none of them on an edge, off by ``noise`` of its size."""
    points, normals = solid.vertices[solid.faces].mean(axis=1), face_normals(solid.vertices, solid.faces)
    scatter = noise * solid.size() * np.random.default_rng(0).normal(size=points.shape)
    return ball_pivoting(points + scatter, normals).mesh


def rounded_box(cells: int = 40) -> tuple[ObjectMesh, np.ndarray]:
    """A box with all its edges rounded, and which of its 6 planes, 12 cylinders and 8 spheres each triangle is on."""
    mesh, half = box((-0.5, -0.4, -0.3), (0.5, 0.4, 0.3), cells), np.array([0.5, 0.4, 0.3]) - RADIUS
    inner = np.clip(mesh.vertices, -half, half)
    out = mesh.vertices - inner
    vertices = inner + RADIUS * out / np.linalg.norm(out, axis=1, keepdims=True)
    middle = vertices[mesh.faces].mean(axis=1)
    return ObjectMesh(vertices, mesh.faces), (np.sign(middle) * (np.abs(middle) > half)).astype(int) @ (1, 3, 9)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize(
    ("solid", "planes"), [(box((0, 0, 0), (1, 1, 1), 40), 6), (nine_facets(5)[0], 9)], ids=["cube", "nine"]
)
def test_points_off_the_edges_give_the_facets_and_nothing_else(solid: ObjectMesh, planes: int, noise: float) -> None:
    mesh = pivoted(solid, noise)
    found = segment(mesh)
    assert found.count("plane") == len(found.primitives) == planes and found.outcome is Outcome.PRIMITIVES
    normals = face_normals(solid.vertices, solid.faces)
    truth = normals[np.unique(np.round(normals, 6), axis=0, return_index=True)[1]]
    across = np.abs(np.array([plane.direction for plane in found.primitives]) @ truth.T)
    assert across.max(axis=1).min() > (1 - 1e-12 if noise == 0 else np.cos(np.deg2rad(0.5)))
    if noise == 0:
        # triangles across an edge do not count against the plane they went to
        assert max(plane.largest for plane in found.primitives) < 1e-9


@pytest.mark.parametrize("noise", [5e-4, 1e-3])
def test_roundings_of_several_rows_stay(noise: float) -> None:
    mesh, truth = rounded_box()
    scatter = noise * mesh.size() * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    found = segment(ObjectMesh(mesh.vertices + scatter, mesh.faces))
    assert found.count("plane") == 6 and found.count("cylinder") == 12
    for one in found.primitives:
        own = np.unique(truth[one.faces], return_counts=True)[1]
        assert own.max() > 0.75 * own.sum()
        if one.kind == "cylinder":
            assert one.radius == pytest.approx(RADIUS, rel=0.1)


def strip(rows: int, rise: float) -> tuple[ObjectMesh, np.ndarray, list[Surface]]:
    """Two half planes at right angles, each three rows of triangles wide, with ``rows`` rows between whose inner
    vertices lie ``rise`` off both; the names of the triangles (-1 between), and the planes.
    """
    x = [-4.0, -3.0, -2.0, -1.0, *[-rise] * (rows - 1), *[0.0] * 4]
    z = [*[0.0] * 4, *[-rise] * (rows - 1), -1.0, -2.0, -3.0, -4.0]
    columns = 12
    i, j = np.meshgrid(np.arange(len(x) - 1), np.arange(columns), indexing="ij")
    a = (i * (columns + 1) + j).reshape(-1)
    lower, upper = np.stack([a, a + columns + 1, a + columns + 2], 1), np.stack([a, a + columns + 2, a + 1], 1)
    y = np.arange(columns + 1.0)
    vertices = np.stack([np.repeat(x, columns + 1), np.tile(y, len(x)), np.repeat(z, columns + 1)], axis=1)
    row = i.reshape(-1)
    name = np.where(row < 3, 0, np.where(row >= 3 + rows, 1, -1))
    top = Surface("plane", np.zeros(3), np.array([0.0, 0.0, 1.0]), float("nan"))
    side = Surface("plane", np.zeros(3), np.array([1.0, 0.0, 0.0]), float("nan"))
    return ObjectMesh(vertices, np.concatenate([lower, upper])), np.tile(name, 2), [top, side]


@pytest.mark.parametrize(
    ("rows", "rise", "close", "absorbed"),
    [(1, 0.0, 0.0, True), (2, 0.25, 0.5, True), (2, 0.25, 0.1, False), (2, 0.75, 0.5, False), (5, 0.25, 0.5, False)],
)
def test_what_bridges(rows: int, rise: float, close: float, absorbed: bool) -> None:
    mesh, name, planes = strip(rows, rise)
    pairs, areas = adjacency(mesh.faces).pairs, np.ones(len(mesh.faces))
    bridge = bridging(mesh.vertices, mesh.faces, pairs, planes, name, areas, close)
    np.testing.assert_array_equal(bridge, (name < 0) & absorbed)
    taken = take_in_bridges(mesh.vertices, mesh.faces, pairs, planes, name, bridge, 1.0)
    assert (taken[name >= 0] == name[name >= 0]).all() and ((taken >= 0) == (absorbed | (name >= 0))).all()
    if absorbed:
        assert set(taken[name < 0]) <= {0, 1}
        far = take_in_bridges(mesh.vertices, mesh.faces, pairs, planes, name, bridge, 0.01)
        np.testing.assert_array_equal(far, name)


def test_a_gap_inside_one_plane_bridges_nothing() -> None:
    mesh, name, planes = strip(1, 0.0)
    hole = np.where(name == 0, 0, 1)
    hole[5] = -1
    bridge = bridging(mesh.vertices, mesh.faces, adjacency(mesh.faces).pairs, planes, hole, np.ones(len(hole)), 0.5)
    assert not bridge.any()
