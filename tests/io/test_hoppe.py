"""Hoppe's point files."""

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.hoppe import read_hoppe
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
