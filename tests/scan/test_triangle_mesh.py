"""The solids the test objects are made of: closed, outward, of the right volume."""

import numpy as np
import pytest

from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join, lathe, placed, ring, unit_sized, upright


def volume(mesh: ObjectMesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


@pytest.mark.parametrize("cells", [1, 3, 8])
def test_box(cells):
    mesh = box((1, 2, 3), (2, 4, 6), cells)
    assert volume(mesh) == pytest.approx(6.0)
    assert len(mesh.faces) == 12 * cells**2 and len(mesh.vertices) == 6 * cells**2 + 2


def test_lathe_of_a_cylinder_and_ring():
    assert volume(lathe([(0, 0), (2, 0), (2, 5), (0, 5)], 200)) == pytest.approx(20 * np.pi, rel=2e-3)
    assert volume(ring(3.0, 1.0, 200, 200)) == pytest.approx(6 * np.pi**2, rel=2e-3)


@pytest.mark.parametrize("subdivisions", [0, 1, 4])
def test_icosphere(subdivisions):
    mesh = icosphere(subdivisions)
    assert len(mesh.faces) == 20 * 4**subdivisions and len(mesh.vertices) == 10 * 4**subdivisions + 2
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1.0, atol=1e-14)
    assert volume(mesh) < 4 * np.pi / 3
    assert volume(mesh) == pytest.approx(4 * np.pi / 3, rel=0.56 / 4**subdivisions)


def test_placing_keeps_volume_and_turns_the_axis():
    mesh = placed(lathe([(0, 0), (1, 0), (1, 5), (0, 5)]), (1.0, -2.0, 0.5), (7, 8, 9))
    direction = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    height = (mesh.vertices - [7, 8, 9]) @ direction
    assert height.min() == pytest.approx(0.0, abs=1e-12) and height.max() == pytest.approx(5.0)
    assert volume(mesh) == pytest.approx(volume(lathe([(0, 0), (1, 0), (1, 5), (0, 5)])))


def test_joined_parts_add_up_and_unit_size_is_one():
    mesh = join(box((0, 0, 0), (1, 1, 1)), box((4, 0, 0), (6, 1, 1)))
    assert volume(mesh) == pytest.approx(3.0)
    small = unit_sized(mesh)
    assert small.size() == 1.0
    np.testing.assert_allclose(small.vertices.min(axis=0), -small.vertices.max(axis=0))


@pytest.mark.parametrize(("up", "heights"), [("x", (1, 2)), ("y", (2, 4)), ("z", (3, 6))])
def test_upright_brings_the_named_axis_to_z_by_a_rotation(up, heights):
    mesh = upright(box((1, 2, 3), (2, 4, 6)), up)
    assert (mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()) == heights
    assert volume(mesh) == pytest.approx(6.0)  # a mirror image would have the sign turned
