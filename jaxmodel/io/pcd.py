"""Point Cloud Library files (``.pcd``)."""

import re
from pathlib import Path

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud


def load_pcd(path: Path) -> Cloud:
    """The cloud in a PCD file (ascii, binary or compressed), with its normals if it has any.

    Raises :class:`InputError` naming the file when it is no PCD file or holds fewer points than its header says.
    """
    content = path.read_bytes()
    count = re.search(rb"^POINTS\s+(\d+)", content, re.MULTILINE)
    data = re.search(rb"^DATA\s+(\w+)[^\n]*\n", content, re.MULTILINE)
    if count is None or data is None:
        raise InputError(f"{path} is not a PCD file: expected POINTS and DATA lines in its header.")
    expected = int(count.group(1))
    found = _points_held(content[: data.start()], data.group(1), content[data.end() :], expected)
    if found < expected:  # Open3D fills what is missing with zeros
        raise InputError(f"{path} is truncated: expected {expected} points, found {found}.")
    import open3d

    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        cloud = open3d.io.read_point_cloud(str(path), remove_nan_points=False, remove_infinite_points=False)
    points, normals = np.asarray(cloud.points), np.asarray(cloud.normals)
    if len(points) != expected:
        raise InputError(f"{path} cannot be read: expected {expected} points, found {len(points)}.")
    return Cloud(points=points.copy(), normals=normals.copy() if len(normals) == len(points) > 0 else None)


def _points_held(header: bytes, kind: bytes, body: bytes, expected: int) -> int:
    """How many whole points the body can hold."""
    if kind == b"ascii":
        return sum(1 for line in body.splitlines() if line.strip())
    if kind == b"binary":
        sizes = re.search(rb"^SIZE\s+([\d ]+)", header, re.MULTILINE)
        counts = re.search(rb"^COUNT\s+([\d ]+)", header, re.MULTILINE)
        widths = [int(size) for size in sizes.group(1).split()] if sizes else [4, 4, 4]
        repeats = [int(count) for count in counts.group(1).split()] if counts else [1] * len(widths)
        return len(body) // max(sum(w * r for w, r in zip(widths, repeats, strict=False)), 1)
    # Compressed: the first four bytes say how many follow the eight of the two lengths; all or nothing.
    return expected if len(body) >= 8 + int.from_bytes(body[:4], "little") else 0
