"""Triangles over one another: none on one sheet, all of a doubled one, and thin walls are no layers."""

import numpy as np
import pytest

from jaxmodel.mesh.lying_over import lying_over
from jaxmodel.scan.triangle_mesh import ObjectMesh, box, icosphere, join, ring


def over(mesh: ObjectMesh) -> np.ndarray:
    return lying_over(mesh.vertices, mesh.faces)


@pytest.mark.parametrize("mesh", [icosphere(3), ring(1, 0.3), box((0, 0, 0), (1, 1, 1), 8)])
def test_a_single_sheet_has_none(mesh: ObjectMesh) -> None:
    assert not over(mesh).any()


def test_two_layers_lie_over_one_another_whatever_their_cut() -> None:
    inner, outer = icosphere(3), icosphere(3)
    turned = ObjectMesh(
        1.02 * outer.vertices @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0], outer.faces
    )
    if np.linalg.det(turned.vertices[turned.faces[0]]) < 0:
        turned = ObjectMesh(turned.vertices, turned.faces[:, ::-1])
    assert over(join(inner, turned)).mean() > 0.95


def test_the_sides_of_a_thin_wall_and_far_layers_are_no_such() -> None:
    wall = box((0, 0, 0), (1, 1, 0.01), 8)
    assert not over(
        ObjectMesh(wall.vertices, wall.faces[np.ptp(wall.vertices[wall.faces][:, :, 2], axis=1) == 0])
    ).any()
    assert not over(join(icosphere(3), ObjectMesh(1.5 * icosphere(3).vertices, icosphere(3).faces))).any()


def test_degenerate_and_few_triangles_are_none() -> None:
    assert over(ObjectMesh(np.eye(3), np.array([[0, 1, 2]]))).tolist() == [False]
    assert over(ObjectMesh(np.zeros((3, 3)), np.array([[0, 1, 2], [0, 0, 1]]))).tolist() == [False, False]
