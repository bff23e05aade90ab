"""Range grids: written here, read back; each kind of damage named."""

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.datasets import StanfordBunny
from jaxmodel.io.scans import load_scan
from jaxmodel.scan.range_image import RangeImage

HEADER = """ply
format ascii 1.0
obj_info num_cols 3
obj_info num_rows 2
element vertex 4
property float x
property float y
property float z
element range_grid 6
property list uchar int vertex_indices
end_header
"""
VERTICES = ["0 0 1 ", "1 0 1.5 ", "0 1 2 ", "2 1 2.5"]
CELLS = ["1 0 ", "1 1", "0 ", "1 2", "0", "1 3"]


def grid_file(folder: Path, header: str = HEADER, vertices=VERTICES, cells=CELLS) -> Path:
    path = folder / "scan.ply"
    path.write_text(header + "\n".join([*vertices, *cells]) + "\n")
    return path


def test_cells_are_row_major_and_zero_means_no_reading(tmp_path):
    image = load_scan(grid_file(tmp_path))
    assert isinstance(image, RangeImage)
    assert image.valid.tolist() == [[True, True, False], [True, False, True]]
    np.testing.assert_array_equal(image.points[image.valid], [[0, 0, 1], [1, 0, 1.5], [0, 1, 2], [2, 1, 2.5]])
    assert np.isnan(image.points[~image.valid]).all()
    assert image.eye.tolist() == [0, 0, 1, 0]


def test_further_vertex_properties_and_windows_lines_are_read_over(tmp_path):
    header = HEADER.replace("property float x", "property float confidence\nproperty float x")
    path = grid_file(tmp_path, header, ["9 " + v for v in VERTICES])
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    image = load_scan(path)
    np.testing.assert_array_equal(image.points[1, 2], [2, 1, 2.5])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cells": CELLS[:4]}, "truncated: expected 4 vertices and 6 grid cells, found 4 and 4"),
        ({"cells": [], "vertices": VERTICES[:2]}, "truncated: expected 4 vertices and 6 grid cells, found 2 and 0"),
        ({"cells": [*CELLS[:5], "1 4"]}, "grid cell 5, found b'1 4'"),
        ({"cells": [*CELLS[:5], "2 1 0"]}, "grid cell 5"),
        ({"cells": [*CELLS[:5], "1"]}, "grid cell 5"),
        ({"vertices": ["0 0", *VERTICES[1:]]}, "3 numbers for vertex 0"),
        ({"vertices": ["0 0 zero", *VERTICES[1:]]}, "not made of numbers"),
        ({"vertices": [*VERTICES[:3], "nan 1 1"]}, "vertex 3 .*not finite"),
        ({"vertices": [*VERTICES[:3], "1 inf 1"]}, "vertex 3 .*not finite"),
        ({"header": HEADER.replace("num_rows 2", "num_rows 3")}, "3 x 3 = 9 range_grid cells, found 6"),
        ({"header": HEADER.replace("obj_info num_cols 3\n", "")}, "obj_info num_cols COUNT"),
        ({"header": HEADER.replace("ascii", "binary_little_endian")}, "expected 'ascii'"),
        ({"header": HEADER.replace("property float z\n", "")}, "properties x, y, z"),
        ({"header": HEADER.replace("vertex 4", "vertex four")}, "line 5: expected a PLY header line"),
        ({"header": HEADER.replace("end_header", "")}, "no 'end_header'"),
        ({"header": HEADER.replace("ply", "plx", 1)}, "not a PLY file"),
    ],
)
def test_each_damage_is_named_with_the_file(tmp_path, changes, message):
    with pytest.raises(InputError, match=rf"scan\.ply.*{message}"):
        load_scan(grid_file(tmp_path, **changes))


def test_a_cut_real_file_is_named_as_truncated(tmp_path):
    path = grid_file(tmp_path)
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(InputError, match="is truncated"):
        load_scan(path)


@pytest.mark.data
def test_the_bunny_scans_hold_their_published_counts(data_dir):
    bunny = StanfordBunny(data_dir)
    counts = {"bun000": 40256, "bun090": 30379, "ear_back": 32193}
    for name, count in counts.items():
        image = bunny.scan(name)
        assert image.points.shape == (400, 512, 3) and image.valid.sum() == count
