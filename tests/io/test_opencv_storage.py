"""OpenCV's FileStorage without OpenCV."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.opencv_storage import read_opencv_storage


def test_matrices_numbers_and_text(tmp_path):
    path = tmp_path / "all.yml"
    path.write_text(
        '%YAML:1.0\n---\ncount: 3\ncost: 8.25e-07\nname: "left"\n'
        "K: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   data: [ 1., 2.5e+00, .Nan,\n       4. ]\n"
        'pixels: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: "2f"\n   data: [ 1., 2., 3., 4. ]\n'
    )
    read = read_opencv_storage(path)
    assert read["count"] == 3 and read["name"] == "left"
    assert read["cost"] == 8.25e-07
    K = read["K"]
    assert isinstance(K, np.ndarray)
    np.testing.assert_array_equal(K, [[1, 2.5], [np.nan, 4]])
    pixels = read["pixels"]
    assert isinstance(pixels, np.ndarray) and pixels.shape == (1, 2, 2) and pixels.dtype == np.float32


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("%YAML:1.0\n---\n- 1\n", "expected named nodes"),
        ("K: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   data: [ 1. ]\n", "is not an OpenCV FileStorage"),
        ("K: !!python/object:os.system\n   a: 1\n", "is not an OpenCV FileStorage"),
        ("a: [1\n", "is not an OpenCV FileStorage"),
    ],
)
def test_bad_files_are_named(tmp_path, text, message):
    path = tmp_path / "bad.yml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"bad\.yml.*{message}"):
        read_opencv_storage(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"There is no file .*none\.yml"):
        read_opencv_storage(tmp_path / "none.yml")
