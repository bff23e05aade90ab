"""CARMEN logs: scans with the odometry up to them, corrected logs' set-backs left out, bad lines named."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.io.carmen import read_carmen


def _flaser(ranges: list[float], pose: tuple[float, float, float], time: float) -> str:
    told = " ".join(map(str, pose))
    return f"FLASER {len(ranges)} {' '.join(map(str, ranges))} {told} {told} {time} host {time}"


def _odom(pose: tuple[float, float, float], time: float) -> str:
    return f"ODOM {' '.join(map(str, pose))} 0 0 0 {time} host {time}"


LOG = [
    "# a comment",
    "PARAM robot_frontlaser_offset 0.0 host 0",
    _odom((0, 0, 0), 0.1),
    _odom((1, 0, 0), 0.2),
    _flaser([1, 2, 3], (5, 5, 0.5), 0.25),
    _odom((5, 5, 0.5), 0),  # set back to the corrected pose: no motion
    _odom((5, 6, 0.5), 0.3),
    _flaser([4, 5, 80], (5, 6.1, 0.6), 0.35),
]


def test_the_robots_own_odometry_is_the_sum_of_its_motions(tmp_path: Path):
    (tmp_path / "log.txt").write_text("\n".join(LOG))
    log = read_carmen(tmp_path / "log.txt")
    assert log.ranges.tolist() == [[1, 2, 3], [4, 5, 80]] and log.time.tolist() == [0.25, 0.35]
    assert log.corrected.tolist() == [[5, 5, 0.5], [5, 6.1, 0.6]]
    # a step of (0, 1) in the log's frame, seen from a robot turned by 0.5, goes on from (1, 0, 0)
    assert np.allclose(log.odometry, [[1, 0, 0], [1 + np.sin(0.5), np.cos(0.5), 0]])
    (tmp_path / "log.gz").write_bytes(gzip.compress("\n".join(LOG).encode()))
    assert np.array_equal(read_carmen(tmp_path / "log.gz").odometry, log.odometry)


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        ([*LOG, "ODOM 1 2"], "line 9: expected a whole ODOM record"),
        ([*LOG, "FLASER 3 1 2"], "line 9: expected a whole FLASER record"),
        ([*LOG, LOG[-1].replace(" 80 ", " far ")], "line 9: expected a whole FLASER record"),
        ([*LOG, LOG[-1].replace(" 80 ", " nan ")], "line 9: expected a whole FLASER record"),
        ([*LOG, _flaser([1, 2], (0, 0, 0), 1)], "line 9: 2 beams, expected 3"),
        (LOG[:4], "holds no FLASER record"),
        ([LOG[4]], "holds no ODOM record"),
    ],
)
def test_bad_lines_are_named(lines, sentence, tmp_path: Path):
    (tmp_path / "log.txt").write_text("\n".join(lines))
    with pytest.raises(InputError, match=sentence):
        read_carmen(tmp_path / "log.txt")


@pytest.mark.parametrize(
    ("content", "sentence"), [(b"\x1f\x8bbroken", "cannot be read"), (b"\xff\xfe\x00", "not text")]
)
def test_files_that_are_no_log_are_named(content, sentence, tmp_path: Path):
    (tmp_path / "log.gz").write_bytes(content)
    with pytest.raises(InputError, match=sentence):
        read_carmen(tmp_path / "log.gz")
    with pytest.raises(InputError, match="cannot be read"):
        read_carmen(tmp_path / "absent.log")


@pytest.mark.data
def test_the_intel_log(data_dir: Path):
    log = read_carmen(data_dir / "laser2d" / "intel.gfs.log.gz")
    assert log.ranges.shape == (910, 180)
    # the raw odometry goes astray by tens of metres where the corrected path comes back
    apart = np.linalg.norm(log.odometry[:, :2] - log.corrected[:, :2], axis=1)
    assert apart[:3].max() < 0.2 and apart.max() > 20
