"""A mesh in the report: as it is when small, coarser and labelled so when large."""

import json

import numpy as np

from jaxmodel.scan.triangle_mesh import icosphere
from jaxmodel.view.mesh_view import MeshView, coarser, mesh_plot

BALL = icosphere(5)


def test_a_small_mesh_is_drawn_as_it_is() -> None:
    colours = np.zeros((len(BALL.faces), 3), np.uint8)
    colours[7] = (255, 128, 1)
    plot = mesh_plot(MeshView("ball", BALL.vertices, BALL.faces, colours))
    (trace,) = plot["data"]
    np.testing.assert_array_equal(np.stack([trace[k] for k in "ijk"], axis=1), BALL.faces)
    np.testing.assert_allclose(np.stack([trace[k] for k in "xyz"], axis=1), BALL.vertices, atol=1e-5)
    assert trace["facecolor"][7] == "#ff8001" and set(trace["facecolor"][:7]) == {"#000000"}
    assert f"{len(BALL.faces)} triangles" in plot["layout"]["title"]["text"]
    json.dumps(plot, allow_nan=False)


def test_a_large_mesh_keeps_its_shape_and_the_colours_of_its_triangles() -> None:
    vertices, faces, kept = coarser(BALL.vertices, BALL.faces, 4000)
    assert 1000 < len(faces) <= 4000 and len(kept) == len(faces)
    cell = np.sqrt(4 * np.pi / 1000)
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < cell**2
    middle, was = vertices[faces].mean(axis=1), BALL.vertices[BALL.faces[kept]].mean(axis=1)
    assert np.linalg.norm(middle - was, axis=1).max() < 2 * cell
    assert all(len(set(face)) == 3 for face in faces.tolist())


def test_a_drawing_says_that_it_is_coarser() -> None:
    plot = mesh_plot(MeshView("ball", BALL.vertices, BALL.faces, most=500))
    drawn = len(plot["data"][0]["i"])
    assert drawn <= 500
    assert f"drawn with {drawn} of its {len(BALL.faces)} triangles" in plot["layout"]["title"]["text"]
