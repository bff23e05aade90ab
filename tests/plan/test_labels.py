import itertools

import numpy as np
from reference_march import Evidence

from jaxmodel.plan.labels import LABELS, Label, beside, derive_labels


def test_six_labels_in_the_order_that_columns_have():
    assert [label.name for label in Label] == [
        "UNKNOWN", "EMPTY", "OCCUPIED", "OCCLUDED", "OCCLUSION_PLANE", "BORDER"
    ]  # fmt: skip
    assert [int(label) for label in Label] == list(range(LABELS))


def test_labels_are_those_of_the_definitions():
    """Every combination of evidence, anywhere, also at the rim of thin maps."""
    rng = np.random.default_rng(0)
    for shape, share, outside in itertools.product([(6, 4, 5), (1, 7, 3), (1, 1, 1), (2, 2, 9)], (0.1, 0.5), (0, 1)):
        occupied, crossed, behind = (rng.random(shape) < p for p in (share, 0.4, 0.4))
        slow = Evidence(shape)
        slow.points[occupied] = 1
        slow.crossed = crossed
        for voxel in np.argwhere(behind):
            slow.eyes[tuple(int(v) for v in voxel)].append(np.zeros(3))
        found = derive_labels(occupied, crossed, behind, bool(outside))
        assert found.dtype == np.int8
        assert np.array_equal(found, slow.labels(bool(outside)))


def test_points_outweigh_rays_and_rays_outweigh_shadow():
    """All eight kinds of evidence on a voxel whose neighbours are occupied: nothing beside changes its label."""
    for seen in itertools.product((False, True), repeat=3):
        arrays = [np.zeros((3, 3, 3), bool) for _ in range(3)]
        arrays[0][:] = True
        for array, value in zip(arrays, seen, strict=True):
            array[1, 1, 1] = value
        occupied, crossed, behind = seen
        expected = (
            Label.OCCUPIED if occupied else Label.EMPTY if crossed else Label.OCCLUDED if behind else Label.UNKNOWN
        )
        assert derive_labels(arrays[0], arrays[1], arrays[2], False)[1, 1, 1] == expected


def test_only_the_six_faces_are_beside():
    mask = np.zeros((3, 3, 3), bool)
    mask[1, 1, 1] = True
    offsets = np.abs(np.argwhere(beside(mask, False)) - 1).sum(axis=1)
    assert offsets.tolist() == [1] * 6
    rim = beside(np.zeros((3, 3, 3), bool), True)
    assert not rim[1, 1, 1]
    assert rim.sum() == 26
