"""Segmentation against solids whose surfaces are known, without noise and with noise of 0.1 % of the size."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.mesh import Outcome, Segmentation, segment
from jaxmodel.mesh.adjacency import adjacency, face_normals
from jaxmodel.scan.known_solids import known_solid
from jaxmodel.scan.polyhedron import nine_facets, subdivided
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join, lathe, ring

NOISE = 1e-3
CUBE = box((0, 0, 0), (1, 1, 1), 30)


def noisy(mesh: ObjectMesh, seed: int, noise: float = NOISE) -> ObjectMesh:
    """``mesh`` with every coordinate off by ``noise`` of its size."""
    scatter = noise * mesh.size() * np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return ObjectMesh(mesh.vertices + scatter, mesh.faces)


def can(rings: int = 40, segments: int = 96) -> ObjectMesh:
    """A closed cylinder of radius 3/8 and length 1 in small triangles."""
    radius = np.linspace(0, 0.375, 7)
    wall = [(0.375, float(z)) for z in np.linspace(0, 1, rings)]
    return lathe([(float(r), 0) for r in radius[:-1]] + wall + [(float(r), 1) for r in radius[-2::-1]], segments)


def two_slopes(dihedral_deg: float, cells: int = 60) -> tuple[ObjectMesh, np.ndarray]:
    """Two half squares that meet at an angle along a grid line, and the half of each triangle."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    z = -np.abs(x) * np.tan(np.deg2rad(dihedral_deg) / 2)
    i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    a = (i * (cells + 1) + j).reshape(-1)
    b = a + cells + 1
    faces = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    mesh = ObjectMesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces)
    return mesh, (mesh.vertices[faces].mean(axis=1)[:, 0] > 0).astype(int)


def kinds(found: Segmentation) -> dict[str, int]:
    return {kind: found.count(kind) for kind in ("plane", "cylinder", "sphere", "free-form") if found.count(kind)}


def same_division(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two labellings put the same triangles together."""
    pairs = np.unique(np.stack([one, other]), axis=1)
    return pairs.shape[1] == len(np.unique(one)) == len(np.unique(other))


def by_normal(mesh: ObjectMesh) -> np.ndarray:
    """The side of an axis-aligned cube each triangle faces."""
    normal = face_normals(mesh.vertices, mesh.faces)
    axis = np.abs(normal).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] > 0)


@pytest.mark.parametrize("cells", [1, 4, 30])
def test_a_flat_cube_is_six_exact_planes(cells: int) -> None:
    cube = box((0, 0, 0), (1, 1, 1), cells)
    found = segment(cube)
    assert kinds(found) == {"plane": 6} and found.outcome is Outcome.PRIMITIVES
    assert same_division(found.labels, by_normal(cube))
    for plane in found.primitives:
        assert plane.area == pytest.approx(1) and plane.largest < 1e-12
        assert np.abs(plane.direction).max() == pytest.approx(1, abs=1e-12)
    assert np.abs(found.mesh.vertices - cube.vertices).max() < 1e-12


@pytest.mark.parametrize("seed", range(6))
def test_a_noisy_cube_is_six_planes(seed: int) -> None:
    found = segment(noisy(CUBE, seed))
    assert kinds(found) == {"plane": 6}
    truth = by_normal(CUBE)
    for plane in found.primitives:
        side = np.bincount(truth[plane.faces]).argmax()
        wrong = plane.faces[truth[plane.faces] != side]
        # only triangles that touch another side may change sides
        corners = CUBE.vertices[CUBE.faces[wrong]]
        assert ((np.isclose(corners, 0) | np.isclose(corners, 1)).sum(axis=2) >= 2).any(axis=1).all()
        assert np.rad2deg(np.arccos(np.abs(plane.direction).max())) < 0.1
        assert plane.rms == pytest.approx(NOISE, rel=0.2)
    assert found.noise == pytest.approx(NOISE, rel=0.2)


def test_areas_of_one_plane_that_do_not_touch_stay_apart() -> None:
    top = box((0, 0, 0), (1, 1, 1), 10)
    table = ObjectMesh(top.vertices, top.faces[by_normal(top) == 5])
    tables = join(table, ObjectMesh(table.vertices + np.array([1.5, 0, 0]), table.faces))
    for mesh in (tables, noisy(tables, 0)):
        found = segment(mesh)
        assert kinds(found) == {"plane": 2}
        assert same_division(found.labels, np.repeat([0, 1], len(table.faces)))


@pytest.mark.parametrize("seed", [None, 0, 1, 2, 3, 4])
def test_a_stepped_block_is_its_twelve_sides(seed: int | None) -> None:
    block = known_solid("stepped_block")
    corners = subdivided(block, 5)
    mesh = corners if seed is None else noisy(corners, seed)
    assert kinds(segment(mesh)) == {"plane": 12}
    if seed is None:
        assert kinds(segment(block)) == {"plane": 12}


@pytest.mark.parametrize("seed", [None, 0, 1, 2, 3, 4])
def test_nine_facets_are_nine_planes(seed: int | None) -> None:
    mesh, facet = nine_facets(0 if seed is None else 5)
    found = segment(mesh if seed is None else noisy(mesh, seed))
    assert kinds(found) == {"plane": 9}
    right = sum(np.bincount(facet[plane.faces]).max() for plane in found.primitives)
    assert right >= 0.99 * len(facet)


@pytest.mark.parametrize("seed", [None, 0, 1, 2, 3, 4])
def test_two_slopes_of_fifteen_degrees_are_two_planes(seed: int | None) -> None:
    mesh, half = two_slopes(15.0)
    found = segment(mesh if seed is None else noisy(mesh, seed))
    assert kinds(found) == {"plane": 2}
    angle = np.rad2deg(np.arccos(abs(found.primitives[0].direction @ found.primitives[1].direction)))
    assert angle == pytest.approx(15, abs=1e-9 if seed is None else 0.3)
    assert max((found.labels == half).mean(), (found.labels != half).mean()) > (0.999 if seed is None else 0.98)


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_a_sphere_is_one_sphere(seed: int | None) -> None:
    sphere = icosphere(5)
    found = segment(sphere if seed is None else noisy(sphere, seed))
    assert kinds(found) == {"sphere": 1}
    ball = found.primitives[0]
    limit = 1e-9 if seed is None else 2 * NOISE / 10
    assert abs(ball.radius - 1) < limit and np.abs(ball.point).max() < limit
    assert ball.rms < (1e-9 if seed is None else 1.1 * 2 * NOISE)


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_a_closed_cylinder_is_one_cylinder_and_two_planes(seed: int | None) -> None:
    found = segment(can() if seed is None else noisy(can(), seed))
    assert kinds(found) == {"plane": 2, "cylinder": 1}
    wall = found.primitives[0]
    assert wall.kind == "cylinder"
    limit = 1e-9 if seed is None else NOISE / 5
    assert abs(wall.radius - 0.375) < limit and np.abs(wall.point[:2]).max() < limit
    assert np.rad2deg(np.arccos(min(1.0, abs(wall.direction[2])))) < (1e-5 if seed is None else 0.1)


def test_a_coarse_cylinder_is_not_its_strips() -> None:
    assert kinds(segment(known_solid("cylinder"))) == {"plane": 2, "cylinder": 1}
    assert kinds(segment(lathe([(0, 0), (0.05, 0), (0.05, 0.22), (0, 0.22)], 24))) == {"plane": 2, "cylinder": 1}


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize(
    "mesh", [ring(1, 0.4, 200, 80), known_solid("ball"), icosphere(5)], ids=["torus", "ellipsoid", "egg"]
)
def test_free_form_is_not_called_flat(mesh: ObjectMesh, noise: float) -> None:
    stretched = mesh.vertices * (1.0 if len(mesh.faces) == 32000 else np.array([1.0, 0.8, 0.6]))
    if len(mesh.faces) == 20480:
        stretched = stretched * (1 + 0.2 * stretched[:, :1])
    found = segment(noisy(ObjectMesh(stretched, mesh.faces), 0, noise))
    assert found.outcome in (Outcome.FREE_FORM, Outcome.MIXED)
    total = sum(primitive.area for primitive in found.primitives)
    assert sum(p.area for p in found.primitives if p.kind == "plane") < 0.02 * total
    assert sum(p.area for p in found.primitives if p.kind == "free-form") > 0.9 * total
    assert all(np.isnan(p.rms) for p in found.primitives if p.kind == "free-form")


@pytest.mark.parametrize(
    ("scale", "shift"), [(1000.0, 0.0), (1e-3, 0.0), (1.0, 1e6)], ids=["millimetre", "kilometre", "far"]
)
def test_unit_and_origin_do_not_matter(scale: float, shift: float) -> None:
    mesh = noisy(join(CUBE, ObjectMesh(can().vertices + 2.0, can().faces)), 3)
    moved = ObjectMesh(scale * mesh.vertices + shift, mesh.faces)
    here, there = segment(mesh), segment(moved)
    np.testing.assert_array_equal(here.labels, there.labels)
    assert there.noise == pytest.approx(scale * here.noise, rel=1e-5)
    for one, other in zip(here.primitives, there.primitives, strict=True):
        assert one.kind == other.kind and other.area == pytest.approx(scale**2 * one.area, rel=1e-6)


def test_the_order_of_triangles_and_their_turning_do_not_matter() -> None:
    mesh = noisy(can(20, 48), 1)
    random = np.random.default_rng(0)
    order = random.permutation(len(mesh.faces))
    shuffled = ObjectMesh(mesh.vertices, np.array([np.roll(face, random.integers(3)) for face in mesh.faces[order]]))
    flip = random.random(len(order)) < 0.3
    turned = ObjectMesh(mesh.vertices, np.where(flip[:, None], shuffled.faces[:, ::-1], shuffled.faces))
    here = segment(mesh)
    for other in (shuffled, turned):
        assert same_division(segment(other).labels, here.labels[order])
    again = segment(mesh)
    np.testing.assert_array_equal(here.labels, again.labels)
    np.testing.assert_array_equal(here.mesh.vertices, again.mesh.vertices)


def test_loose_triangles_are_welded_and_sheets_go_on_through_others() -> None:
    loose = ObjectMesh(CUBE.vertices[CUBE.faces].reshape(-1, 3), np.arange(3 * len(CUBE.faces)).reshape(-1, 3))
    assert kinds(segment(loose)) == {"plane": 6}
    flat, _ = two_slopes(0.0, 20)
    across = ObjectMesh(flat.vertices[:, [2, 1, 0]], flat.faces)
    both = join(flat, across)
    _, same = np.unique(np.round(both.vertices, 12), axis=0, return_inverse=True)
    vertices = np.zeros((same.max() + 1, 3))
    vertices[same.reshape(-1)] = both.vertices
    crossing = ObjectMesh(vertices, same.reshape(-1)[both.faces])
    assert (adjacency(crossing.faces).faces == 4).sum() == 20
    found = segment(crossing)
    assert kinds(found) == {"plane": 2}
    assert same_division(found.labels, np.repeat([0, 1], len(flat.faces)))


def test_degenerate_triangles_join_their_neighbours() -> None:
    faces = np.concatenate([CUBE.faces, [[0, 0, 1], [5, 5, 5]]])
    middle = CUBE.vertices[CUBE.faces[0, :2]].mean(axis=0)
    vertices = np.concatenate([CUBE.vertices, [middle]])
    split = CUBE.faces[0]
    needle = [[split[0], split[1], len(CUBE.vertices)]]
    found = segment(ObjectMesh(vertices, np.concatenate([faces, needle])))
    assert found.count("plane") == 6
    large = [primitive for primitive in found.primitives if primitive.area > 0]
    assert len(large) == 6 and len(found.labels) == len(faces) + 1


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (np.zeros((3, 3)), np.zeros((0, 3), np.int64), "no triangles"),
        (np.eye(3), np.array([[0, 1, 3]]), "Triangle 0 has corners"),
        (np.eye(3), np.array([[0, 1, -1]]), "Triangle 0 has corners"),
        (np.array([[0, 0, 0], [1, 0, 0], [np.nan, 1, 0]]), np.array([[0, 1, 2]]), "Vertex 2 of the mesh"),
        (np.array([[0, 0, 0], [1, 0, 0], [np.inf, 1, 0]]), np.array([[0, 1, 2]]), "Vertex 2 of the mesh"),
        (np.array([[0, 0, 0], [1, 0, 0], [2.0, 0, 0]]), np.array([[0, 1, 2]]), "degenerate"),
        (np.zeros((3, 3)), np.array([[0, 1, 2]]), "degenerate"),
    ],
)
def test_bad_meshes_are_refused_in_one_sentence(vertices: np.ndarray, faces: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        segment(ObjectMesh(vertices, faces))


@pytest.mark.parametrize("noise", [-1.0, np.nan, np.inf])
def test_a_noise_that_is_no_length_is_refused(noise: float) -> None:
    with pytest.raises(InputError, match="noise"):
        segment(CUBE, noise=noise)


def test_a_vertex_that_no_triangle_uses_may_be_anything() -> None:
    mesh = ObjectMesh(np.concatenate([CUBE.vertices, [[np.nan] * 3]]), CUBE.faces)
    assert kinds(segment(mesh)) == {"plane": 6}
