"""The OSU/MSU text format: round trip, accepted headers, damage."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.osu import looks_like_osu, read_osu, write_osu
from jaxmodel.io.scans import load_scan
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage


def image(h: int = 4, w: int = 5) -> RangeImage:
    rng = np.random.default_rng(0)
    valid = rng.random((h, w)) < 0.8
    points = np.where(valid[..., None], rng.normal(size=(h, w, 3)), np.nan)
    return RangeImage(points, valid, np.array([0.0, 0.0, 1.0, 0.0]))


@pytest.mark.parametrize("suffix", [".osu", ".rif", ".dat", ".txt"])
def test_what_is_written_is_read_back_to_the_last_bit(tmp_path, suffix):
    path = tmp_path / f"view{suffix}"
    write_osu(path, image())
    back = load_scan(path)
    assert isinstance(back, RangeImage)
    np.testing.assert_array_equal(back.points, image().points)
    np.testing.assert_array_equal(back.valid, image().valid)
    np.testing.assert_array_equal(back.eye, image().eye)


@pytest.mark.parametrize(
    "header",
    [
        "4 rows\n5 columns\npixels (flag, x, y, z)",
        "4 rows 5 columns\nany words\nmore",
        "rows 4\ncols 5\n# range image 7",
        "rows: 4\ncolumns: 5\n-",
        "Rows = 4, Cols = 5\nscanner 100X\nMSU",
        "width 5\nheight 4\nunit mm",
        "object: part 12b, 1994\n5 cols\n4 rows",
        "4 5\nscanned in 1994\npixels (flag, x, y, z)",
    ],
)
def test_accepted_headers(tmp_path, header):
    path = tmp_path / "view.txt"
    write_osu(path, image())
    body = path.read_text().split("\n", 3)[3]
    path.write_text(header + "\n" + body)
    back = load_scan(path)
    assert isinstance(back, RangeImage) and back.valid.shape == (4, 5)
    np.testing.assert_array_equal(back.points, image().points)


def test_line_breaks_in_the_images_are_free(tmp_path):
    path = tmp_path / "view.osu"
    write_osu(path, image())
    head, body = path.read_text().split("(flag, x, y, z)\n")
    path.write_text(head + "(flag, x, y, z)\n" + "\n".join(body.split()))
    np.testing.assert_array_equal(load_scan(path).points, image().points)


@pytest.mark.parametrize(
    "text", ["1 2 3\n4 5 6\n7 8 9\n1 1 1\n", "1 2\n3 4\n5 6\n7 8\n", "# x y z columns\n1 2 3\n4 5 6\n"]
)
def test_plain_columns_of_numbers_are_not_taken_for_a_range_image(text):
    assert not looks_like_osu(text)


def test_a_text_file_of_points_is_a_cloud(tmp_path):
    path = tmp_path / "cloud.txt"
    path.write_text("1 2 3\n4 5 6\n7 8 9\n10 11 13\n")
    scan = load_scan(path)
    assert isinstance(scan, Cloud) and len(scan) == 4


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda t: t[: len(t) // 2], "is truncated: expected 4 images of 4 x 5 = 80 numbers"),
        (lambda t: t + " 1", "is too long: .*found 81"),
        (lambda t: t.replace("4 rows", "0 rows"), "three header lines"),
        (lambda t: t.rsplit(" ", 1)[0] + " word", "not a number"),
        (lambda t: "nothing here", "three header lines"),
    ],
)
def test_each_damage_is_named_with_the_file(tmp_path, damage, message):
    path = tmp_path / "view.osu"
    write_osu(path, image())
    path.write_text(damage(path.read_text()))
    with pytest.raises(InputError, match=rf"view\.osu.*{message}"):
        load_scan(path)


def test_a_valid_pixel_that_is_not_finite_is_named(tmp_path):
    text = "2 rows\n2 columns\n-\n1 1 1 1\n0 1 0 1\n0 0 1 1\n5 5 nan 5\n"
    with pytest.raises(InputError, match="row 1, column 0"):
        read_osu(text, tmp_path / "view.osu")
