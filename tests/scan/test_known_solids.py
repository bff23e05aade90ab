"""The solids of known edges: closed, outward, of the right volume, with the edges they promise."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.scan.known_solids import KNOWN_SOLIDS, before_a_wall, known_solid, prism, roof
from jaxmodel.scan.triangle_mesh import ObjectMesh

CLOSED = [name for name in KNOWN_SOLIDS if name != "plate"]


def volume(mesh: ObjectMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


@pytest.mark.parametrize("name", CLOSED)
def test_each_is_closed_outward_centred_and_of_size_one(name: str) -> None:
    mesh = known_solid(name)
    sides = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert len({tuple(side) for side in sides.tolist()}) == len(sides)
    assert {tuple(side) for side in sides.tolist()} == {tuple(side) for side in sides[:, ::-1].tolist()}
    assert volume(mesh) > 0
    assert mesh.size() == pytest.approx(1.0)
    np.testing.assert_allclose(mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0), 0, atol=1e-12)


def test_volumes() -> None:
    assert volume(known_solid("box")) == pytest.approx(0.35)
    steps = 0.3 * 0.62 + 0.25 * 0.45 + 0.25 * 0.25 + 0.2 * 0.12
    assert volume(known_solid("stepped_block")) == pytest.approx(0.7 * steps)
    assert volume(known_solid("cylinder")) == pytest.approx(np.pi * 0.375**2, rel=0.001)
    assert volume(prism([(0, 0), (3, 0), (0, 2)], 5)) == pytest.approx(15.0)


@pytest.mark.parametrize("bend", [10.0, 30.5, 90.0, 120.0])
def test_the_ridge_of_a_roof_bends_by_its_angle(bend: float) -> None:
    mesh = roof(bend)
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    slopes = normals[(normals[:, 2] > 1e-6) & (np.abs(normals[:, 1]) < 1e-6)]
    left, right = slopes[slopes[:, 0] < 0][0], slopes[slopes[:, 0] > 0][0]
    assert np.rad2deg(np.arccos(left @ right)) == pytest.approx(bend)


def test_a_wall_stands_behind_and_touches_nothing() -> None:
    mesh = known_solid("box")
    both = before_a_wall(mesh, gap=0.5)
    wall = both.vertices[len(mesh.vertices) :]
    assert wall[:, 2].max() == pytest.approx(mesh.vertices[:, 2].min() - 0.5)
    np.testing.assert_array_equal(both.faces[: len(mesh.faces)], mesh.faces)


def test_unknown_names_are_refused_with_those_there_are() -> None:
    with pytest.raises(InputError, match="stepped_block"):
        known_solid("teapot")
