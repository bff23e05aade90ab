"""CARMEN logs of a robot with a 2D laser: scans, the odometry up to each, and the poses they were corrected to."""

import gzip
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxmodel.errors import InputError
from jaxmodel.scan.profile import between, compose


class LaserLog(NamedTuple):
    """Scans in order. ``ranges (n, b)`` in metre; ``corrected (n, 3)`` poses of the laser as logged with the scans, and
    ``odometry (n, 3)`` of the robot, (x, y, angle) in metre and radian; ``time (n,)`` in second.
    """

    ranges: Float[np.ndarray, "n b"]
    corrected: Float[np.ndarray, "n 3"]
    odometry: Float[np.ndarray, "n 3"]
    time: Float[np.ndarray, " n"]


def read_carmen(path: str | Path) -> LaserLog:
    """The ``FLASER`` records of a log (plain or ``.gz``), each with the odometry up to it.

    Logs that were corrected set the odometry back to each corrected pose: the ``ODOM`` record after a scan repeats the
    scan's pose. That is no motion of the robot; its own odometry is the sum of the others, and starts at the first
    record. Records of other kinds are skipped; a scan before any odometry has the robot where it started. Raises
    :class:`InputError` naming the file and line: unreadable, a record cut short, no number, other beams, no scan.
    """
    path = Path(path)
    ranges: list[list[float]] = []
    poses: list[list[float]] = []
    odometry: list[Float[np.ndarray, 3]] = []
    raw, last, scan = np.zeros(3), None, None
    for number, line in enumerate(_text(path).splitlines(), start=1):
        words = line.split()
        if not words or words[0] not in ("FLASER", "ODOM"):
            continue
        try:
            if words[0] == "ODOM":
                told = np.array(_numbers(words[1:4], 3))
                if last is None:
                    raw = told
                elif scan is None or not np.array_equal(told, scan):
                    raw = compose(raw, between(last, told))
                last, scan = told, None
                continue
            beams = int(words[1])
            ranges.append(_numbers(words[2 : 2 + beams], beams))
            rest = _numbers([*words[2 + beams : 8 + beams], words[8 + beams]], 7)
        except (ValueError, IndexError):
            raise InputError(f"{path}, line {number}: expected a whole {words[0]} record of numbers.") from None
        if len(ranges[-1]) != len(ranges[0]):
            raise InputError(f"{path}, line {number}: {beams} beams, expected {len(ranges[0])} as in the first scan.")
        poses.append([*rest[:3], rest[6]])
        odometry.append(raw)
        scan = np.array(rest[:3])
    if not ranges:
        raise InputError(f"{path}: holds no FLASER record, expected a CARMEN log with laser scans.")
    if last is None:
        raise InputError(f"{path}: holds no ODOM record, expected the robot's odometry.")
    known = np.array(poses, np.float64)
    return LaserLog(np.array(ranges, np.float64), known[:, :3], np.array(odometry, np.float64), known[:, 3])


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
        content = gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content
        return content.decode()
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text, expected a CARMEN log.") from None


def _numbers(words: list[str], count: int) -> list[float]:
    values = [float(word) for word in words]
    if len(values) != count or not np.isfinite(values).all():
        raise ValueError
    return values
