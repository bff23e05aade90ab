"""The six labels of a voxel (thesis §4.3.1), derived from what rays have told about it.

Labels are a function of evidence that only ever grows (points counted, crossed by a ray, lying behind a reading), so
that no order of views changes them.
"""

from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Int


class Label(IntEnum):
    """What is known of a voxel."""

    UNKNOWN = 0
    EMPTY = 1
    OCCUPIED = 2
    OCCLUDED = 3
    OCCLUSION_PLANE = 4
    BORDER = 5


LABELS = len(Label)
FACES = ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1))
"""Axis and direction of the six faces of a voxel."""


def neighbour(array: np.ndarray, axis: int, direction: int, outside: bool) -> np.ndarray:
    """For each voxel the value of its neighbour across one face; ``outside`` where the map ends."""
    result = np.full_like(array, outside)
    here, there = [slice(None)] * 3, [slice(None)] * 3
    here[axis] = slice(None, -1) if direction > 0 else slice(1, None)
    there[axis] = slice(1, None) if direction > 0 else slice(None, -1)
    result[tuple(here)] = array[tuple(there)]
    return result


def beside(mask: Bool[np.ndarray, "x y z"], outside: bool) -> Bool[np.ndarray, "x y z"]:
    """Voxels with a face neighbour in ``mask``; what lies beyond the map counts as ``outside``."""
    found = np.zeros_like(mask)
    for axis, direction in FACES:
        found |= neighbour(mask, axis, direction, outside)
    return found


def derive_labels(
    occupied: Bool[np.ndarray, "x y z"],
    crossed: Bool[np.ndarray, "x y z"],
    behind: Bool[np.ndarray, "x y z"],
    open_outside: bool,
) -> Int[np.ndarray, "x y z"]:
    """Labels (int8) of voxels that hold points, that a ray crossed, that lie behind a reading.

    ``open_outside``: the space beyond the map is empty, so that an occluded voxel at its rim is an occlusion plane.
    """
    empty = crossed & ~occupied
    occluded = behind & ~occupied & ~empty
    labels = np.full(occupied.shape, Label.UNKNOWN, np.int8)
    labels[empty] = Label.EMPTY
    labels[occluded] = Label.OCCLUDED
    labels[occluded & beside(empty, open_outside)] = Label.OCCLUSION_PLANE
    labels[occupied] = Label.OCCUPIED
    labels[occupied & beside(labels == Label.UNKNOWN, False)] = Label.BORDER
    return labels
