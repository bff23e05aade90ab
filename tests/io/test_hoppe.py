"""Hoppe's point files."""

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.hoppe import read_hoppe, read_hoppe_mesh
from jaxmodel.io.scans import load_scan

PATH = Path("cat.pts")


def test_only_points_are_read():
    text = "# a comment\nd 0.1\ng 2\ns 4 5 6\np 1 2 3\n\np -1e-3 5 .5\n"
    np.testing.assert_array_equal(read_hoppe(text, PATH), [[1, 2, 3], [-1e-3, 5, 0.5]])


@pytest.mark.parametrize("line", ["q 1 2 3", "p 1 2", "p 1 2 three", "1 2 3"])
def test_any_other_line_is_named(line):
    with pytest.raises(InputError, match=r"cat\.pts, line 2: expected 'p x y z'"):
        read_hoppe(f"p 0 0 0\n{line}\n", PATH)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "count"), [("cat10.10000", 10000), ("club71.16864", 16864), ("mechpart.4102", 4102), ("cactus.3337", 3337)]
)
def test_published_counts(data_dir, name, count):
    assert len(load_scan(data_dir / "hoppe_points" / f"{name}.pts").points) == count


def test_meshes_with_gaps_in_their_ids() -> None:
    text = (
        "Vertex 2  0 0 0 {normal=(0 0 1)}\nVertex 7 1 0 0\nVertex 9 0 1 0\nEdge 2 7 {sharp}\nFace 4  2 7 9 {matid=0}\n"
    )
    mesh = read_hoppe_mesh(text, PATH)
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


@pytest.mark.parametrize("line", ["Vertex 1 0 0", "Face 1 1 2 3", "Vertex a 0 0 0", "Corner 1 0 0 0"])
def test_a_damaged_mesh_names_file_and_line(line: str) -> None:
    with pytest.raises(InputError, match=r"line 2"):
        read_hoppe_mesh(f"Vertex 1 0 0 0\n{line}\n", PATH)
