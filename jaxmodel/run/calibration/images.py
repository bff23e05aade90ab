"""Pictures of a target in place of the camera's poses: the target's words, the pictures' order, what was not found."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from jaxmodel.errors import InputError
from jaxmodel.io.pose_files import natural
from jaxmodel.io.pose_values import PoseStream
from jaxmodel.run.calibration.config import Images
from jaxmodel.run.calibration.paired_poses import PairedPoses

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm")
FORMS = {
    "chessboard": "chessboard:9x6:0.025 (inner corners, square in metres)",
    "charuco": "charuco:5x7:0.04:0.03:DICT_4X4_50 (squares, square, marker, dictionary)",
    "apriltag": "apriltag:6x6:0.114:0.088:APRILTAG_36H11 (tags, from one to the next, side of a tag, dictionary)",
}
LARGEST_SQUARE = 1.0
"""Metres; beyond it millimetres are meant."""


def parse_target(words: str) -> Any:
    """The ``Target`` that ``words`` describe; anything else is an ``InputError`` with the expected form."""
    kind, *parts = words.split(":")
    if kind not in FORMS:
        raise InputError(f"target {words!r}: unknown kind {kind!r}, expected one of: {', '.join(FORMS.values())}")
    size = re.fullmatch(r"(\d+)x(\d+)", parts[0]) if parts else None
    lengths = [_length(part) for part in parts[1 : 2 if kind == "chessboard" else 3]]
    count = 2 if kind == "chessboard" else 4
    given = [length for length in lengths if length is not None]
    if size is None or len(parts) != count or len(given) < len(lengths):
        raise InputError(f"target {words!r}: expected {FORMS[kind]}")
    largest = max(given)
    if largest > LARGEST_SQUARE:
        raise InputError(f"target {words!r}: a length of {largest:g} m; are these millimetres? Give metres")
    from jaxmodel.calibrate.images import Target

    more = [] if kind == "chessboard" else [given[1], parts[3]]
    return Target(kind, int(size[1]), int(size[2]), given[0], *more)


def _length(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if np.isfinite(value) and value > 0 else None


def poses_of_images(hand: PoseStream, images: Images) -> PairedPoses:
    """Hand poses paired with the target's poses in the pictures; pictures without the target are left out and named.

    A picture belongs to the pose that names it (a column ``image``, or the number at the end of both names), else to
    the pose of the same place in the order of their names.
    """
    assert images.target is not None
    target = parse_target(images.target)
    files = pictures(Path(images.folder))
    chosen = matched(hand, files, Path(images.folder))
    from jaxmodel.calibrate.images import target_poses

    camera = None
    if images.camera is not None:
        from jaxmodel.io.camera import load_camera

        camera = load_camera(Path(images.camera))
    found = target_poses(chosen, target, camera)
    seen = np.flatnonzero(found.found)
    if len(seen) < 2:
        raise InputError(f"{images.folder}: the target {images.target} is found in {len(seen)} of {len(chosen)} "
                         "pictures; at least 2 are needed")  # fmt: skip
    notes = []
    lost = _named(chosen, ~found.found & ~found.misread)
    if lost:
        notes.append(f"the target is not found in {', '.join(lost)}")
    misread = _named(chosen, found.misread)
    if misread:
        notes.append(f"the corners found in {', '.join(misread)} are in an order or at places that no view of the "
                     "target has; left out")  # fmt: skip
    stray = [f"{found.dropped[k]} in {chosen[k].name}" for k in np.flatnonzero(found.dropped)]
    if stray:
        notes.append(f"corners far from where all the others put them are left out: {', '.join(stray)}")
    doubtful = _named(chosen, found.ambiguous)
    if doubtful:
        notes.append(f"the target is too small or far to tell its pose from the mirrored one in {', '.join(doubtful)}")
    pixels = float(np.sqrt(np.mean(found.reprojection_px[seen] ** 2)))
    notes.append(f"the target is found in {len(seen)} of {len(chosen)} pictures, reprojection {pixels:.3g} px (rms)")
    if camera is None:
        K = found.camera.K
        notes.append(
            f"the camera is estimated from the pictures: focal lengths {K[0, 0]:.1f}, {K[1, 1]:.1f} px, centre "
            f"{K[0, 2]:.1f}, {K[1, 2]:.1f}"
        )
    inputs = (*hand.files, *chosen, *([Path(images.camera)] if images.camera else []))
    names = tuple(file.name for file in chosen)
    whole = PairedPoses(hand.poses, found.T_camera_target, names, inputs, hand.groups, None, tuple(notes))
    return whole.rows(seen)


def _named(files: list[Path], which: np.ndarray) -> list[str]:
    return [files[k].name for k in np.flatnonzero(which)]


def pictures(folder: Path) -> list[Path]:
    """The folder's pictures, numbers in their names in order: img2 before img10."""
    if not folder.is_dir():
        raise InputError(f"There is no folder of images {folder}")
    files = sorted((f for f in folder.iterdir() if f.suffix.lower() in PICTURES), key=_by_numbers)
    if not files:
        raise InputError(f"{folder}: holds no pictures ({', '.join(PICTURES)})")
    return files


def _by_numbers(path: Path) -> list[tuple[bool, int, str]]:
    """Sorts names part by part, numbers by their value."""
    parts = re.split(r"(\d+)", path.stem)
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]


def matched(hand: PoseStream, files: list[Path], folder: Path) -> list[Path]:
    """The picture of each hand pose: the one it names, by name or by the number at the end, else that of its place."""
    if hand.images is not None:
        keys = {file.name: file for file in files} | {file.stem: file for file in files}
        ends = [natural(file)[1] for file in files]
        numbers = {end: file for end, file in zip(ends, files, strict=True) if end >= 0 and ends.count(end) == 1}
        chosen = []
        for name in hand.images:
            file = keys.get(name) or keys.get(Path(name).name) or numbers.get(natural(Path(name))[1])
            if file is None:
                raise InputError(f"{folder}: holds no picture for the pose {name!r} of {hand.path}")
            chosen.append(file)
        return chosen
    if len(files) != len(hand.poses):
        raise InputError(
            f"{hand.path} holds {len(hand.poses)} poses and {folder} {len(files)} pictures; each pose needs one, or "
            "a column 'image' that names it"
        )
    return files
