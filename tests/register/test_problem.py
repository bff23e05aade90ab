"""Preparing a pair: nothing is lost by centring and padding, and bad clouds are refused with a sentence."""

from typing import Any

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.register.method import IcpMethod, Strategy
from jaxmodel.register.problem import prepare
from jaxmodel.scan.cloud import Cloud, resolution
from jaxmodel.scan.estimate import estimate_borders

FAST = IcpMethod(cells=8)
BOTH = IcpMethod(strategies=(Strategy(), Strategy(stack=3)), cells=8, exact_cells=4)
PLANE = IcpMethod(cells=8, objective="point_to_plane")
BORDER = IcpMethod(cells=8, border_filter=True)


def rows(columns: Any, count: int) -> np.ndarray:
    return np.asarray(columns).T[:count]


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(np.round(points, 5).T)]


@pytest.mark.parametrize("offset", [0.0, 1e5])
def test_points_are_centred_padded_and_kept(exact_pair, offset: float) -> None:
    """Centring happens before rounding to float32, so that clouds far from the origin keep their shape."""
    target, source = exact_pair.target + offset, exact_pair.source - offset
    problem, frames = prepare(target, source, FAST)
    assert problem.source.shape == problem.target.shape == (3, 256)
    assert problem.source.dtype == problem.target.dtype == np.float32
    assert problem.mask.sum() == problem.target_mask.sum() == problem.count == 250
    np.testing.assert_allclose(frames.target_centre, target.mean(axis=0))
    centred = source - frames.source_centre
    np.testing.assert_allclose(rows(problem.target, 250), target - frames.target_centre, rtol=0, atol=1e-7)
    np.testing.assert_allclose(in_order(rows(problem.source, 250)), in_order(centred), rtol=0, atol=2e-5)
    distance = np.abs(rows(problem.source, 250)[:, None] - centred[None]).max(axis=2)
    assert sorted(np.argmin(distance, axis=1)) == list(range(250))
    assert distance.min(axis=1).max() < 1e-7
    assert not problem.source[:, 250:].any()
    np.testing.assert_allclose(problem.resolution, resolution(exact_pair.target), rtol=1e-5)
    box = np.stack([exact_pair.target.min(axis=0), exact_pair.target.max(axis=0)])
    np.testing.assert_allclose(problem.box[1] - problem.box[0], box[1] - box[0], rtol=1e-6)
    np.testing.assert_allclose(problem.size, np.linalg.norm(box[1] - box[0]), rtol=1e-6)


def test_poses_go_to_the_centred_frames_and_back(exact_pair) -> None:
    _, frames = prepare(exact_pair.target + 100.0, exact_pair.source, FAST)
    poses = np.stack([exact_pair.T_target_source, exact_pair.near, np.eye(4)])
    R, t = frames.to_centred(poses)
    assert R.dtype == t.dtype == np.float32
    np.testing.assert_allclose(frames.from_centred(R.astype(float), t), poses, rtol=0, atol=1e-5)
    # the same point through either frame
    p = exact_pair.source[7]
    direct = poses[:, :3, :3] @ p + poses[:, :3, 3]
    centred = R @ (p - frames.source_centre) + t + frames.target_centre
    np.testing.assert_allclose(centred, direct, rtol=0, atol=1e-5)


def test_neighbours_in_space_are_neighbours_in_memory(exact_pair) -> None:
    problem, _ = prepare(exact_pair.target, exact_pair.source, FAST)
    step = np.linalg.norm(np.diff(rows(problem.source, 250), axis=0), axis=1).mean()
    shuffled = np.linalg.norm(np.diff(exact_pair.source, axis=0), axis=1).mean()
    assert step < 0.5 * shuffled


def test_only_the_tables_needed_are_built(exact_pair) -> None:
    fast, _ = prepare(exact_pair.target, exact_pair.source, FAST)
    assert fast.exact_table is None and fast.fast_table is not None
    assert fast.fast_table.index.shape == (8**3, 1)
    both, _ = prepare(exact_pair.target, exact_pair.source, BOTH)
    assert both.fast_table is not None and both.exact_table is not None
    assert both.exact_table.index.shape == (4**3, 8)


def test_normals_are_taken_from_the_cloud_or_estimated(exact_pair) -> None:
    sphere = exact_pair.target / np.linalg.norm(exact_pair.target, axis=1, keepdims=True)
    assert prepare(sphere, exact_pair.source, FAST)[0].normals is None
    given = np.roll(sphere, 1, axis=1)  # no surface's normals: they are taken as they come
    normals = prepare(Cloud(sphere, normals=given), exact_pair.source, PLANE)[0].normals
    np.testing.assert_allclose(rows(normals, 250), given, atol=1e-6)
    estimated = rows(prepare(sphere, exact_pair.source, PLANE)[0].normals, 250)
    np.testing.assert_allclose(np.linalg.norm(estimated, axis=1), 1.0, atol=1e-6)
    assert np.sum(estimated * sphere, axis=1).min() > 0.95


def test_borders_are_taken_from_the_cloud_or_estimated_or_ignored(exact_pair, resampled_pair) -> None:
    target = resampled_pair.target
    given = target[:, 1] > 0.2
    with_border = Cloud(target, border=given)
    for method, expected in ((BORDER, given), (FAST, np.zeros_like(given))):
        border = np.asarray(prepare(with_border, exact_pair.source, method)[0].border)
        np.testing.assert_array_equal(border[: len(target)], expected)
        assert not border[len(target) :].any()
    border = np.asarray(prepare(target, exact_pair.source, BORDER)[0].border)[: len(target)]
    np.testing.assert_array_equal(border, estimate_borders(target - target.mean(axis=0)))
    assert 5 < border.sum() < 0.4 * len(target)


BAD = {
    "empty": (np.zeros((0, 3)), "is empty"),
    "two points": (np.eye(3)[:2], "only 2 points"),
    "all equal": (np.full((20, 3), 3.5), "all 20 points are equal"),
    "nan": (np.where(np.arange(30).reshape(10, 3) == 13, np.nan, 1.0), r"point 4 .*finite"),
    "infinite": (np.where(np.arange(30).reshape(10, 3) == 29, np.inf, 1.0), r"point 9 .*finite"),
    "two columns": (np.zeros((10, 2)), r"shape \(n, 3\)"),
    "words": (np.full((5, 3), "x"), r"expected numbers"),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("which", ["target", "source"])
def test_bad_clouds_are_refused(exact_pair, name: str, which: str) -> None:
    cloud, sentence = BAD[name]
    clouds = (cloud, exact_pair.source) if which == "target" else (exact_pair.target, cloud)
    with pytest.raises(InputError, match=rf"^the {which}.*{sentence}"):
        prepare(*clouds, FAST)
