"""Poses from points that look alike: exact where pairs are, found among many wrong ones, none twice."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.geometry.se3 import rotation_angle_deg
from jaxmodel.register.proposals import Pairs, alike, propose

COUNT = 256


def _pairs(right: int, noise: float, seed: int) -> tuple[Pairs, np.ndarray]:
    draw = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(draw.normal(size=4)).as_matrix(), draw.normal(size=3) * 5
    source = draw.normal(size=(COUNT, 3))
    normals = draw.normal(size=(COUNT, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    target = source @ T[:3, :3].T + T[:3, 3] + noise * draw.normal(size=(COUNT, 3))
    turned = normals @ T[:3, :3].T
    target[right:] = draw.normal(size=(COUNT - right, 3)) + T[:3, 3]
    turned[right:] = draw.permutation(turned[right:])
    return Pairs(source, normals, target, turned), T


@pytest.mark.parametrize(("right", "noise", "turn", "shift"), [(COUNT, 0.0, 1e-3, 1e-4), (20, 0.002, 1.5, 0.03)])
def test_right_pairs_are_found_among_wrong_ones(right, noise, turn, shift):
    pairs, T = _pairs(right, noise, 3)
    found = propose(pairs, 0.02)
    assert found.shape == (COUNT, 4, 4)
    turned = rotation_angle_deg(np.swapaxes(found[:, :3, :3], 1, 2) @ T[:3, :3])
    moved = np.linalg.norm(found[:, :3, 3] - T[:3, 3], axis=1)
    good = (turned < turn) & (moved < shift)
    assert good[:right].mean() > 0.9
    assert np.allclose(np.linalg.det(found[:, :3, :3]), 1, atol=1e-5)


def test_the_unit_does_not_matter():
    pairs, _ = _pairs(40, 0.0, 5)
    metres, millimetres = (
        propose(Pairs(s * pairs.source, pairs.source_normals, s * pairs.target, pairs.target_normals), 0.02 * s)
        for s in (1.0, 1000.0)
    )
    assert np.allclose(metres[:40, :3, :3], millimetres[:40, :3, :3], atol=1e-3)


def test_alike_pairs_are_the_nearest_both_ways_first():
    draw = np.random.default_rng(0)
    features = draw.normal(size=(60, 20))
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    order = draw.permutation(60)
    rows, columns = alike(features, features[order], 60)
    assert len(rows) == 60 and (order[columns] == rows).mean() > 0.95
    key = rows * 60 + columns
    assert len(np.unique(key)) == len(key)


def test_what_is_common_is_no_mark():
    """Half of all points look the same: the pairs of the rest are not crowded out by these."""
    draw = np.random.default_rng(1)
    rare = draw.normal(size=(30, 20)) + 0.0
    plain = np.tile(draw.normal(size=20), (30, 1))
    target = np.concatenate([plain, rare])
    source = np.concatenate([plain, rare + 0.1 * draw.normal(size=rare.shape)])
    target, source = (a / np.linalg.norm(a, axis=1, keepdims=True) for a in (target, source))
    rows, columns = alike(target, source, 40)
    assert ((rows == columns) & (rows >= 30)).sum() >= 15
