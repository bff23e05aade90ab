"""The options as they stand in a configuration, and what a selection carries along."""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest

from jaxmodel.control_points import Contours, ControlPoints, SplitVertices, Subsample, Vertices, select
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage, to_cloud

OPTIONS = [
    Subsample(count=80),
    Subsample(count=80, how="random"),
    Subsample(count=80, how="farthest"),
    Vertices(count=80),
    Vertices(count=80, at="centres"),
    Contours(count=60),
    Contours(count=80, labels=("border", "crease")),
    SplitVertices(count=80),
    SplitVertices(count=80, contours=False),
    SplitVertices(count=80, at="centres"),
]
TOLERANCE = {"subsample": 0, "vertices": 1, "contours": 0, "split_vertices": 4}


def dome() -> RangeImage:
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 31), np.linspace(-1.0, 1.0, 25))
    points = np.stack([x, y, 1.0 - 0.4 * (x**2 + 0.7 * y**2) + 0.02 * np.sin(9 * x)], axis=-1)
    return RangeImage(points=points, valid=np.ones(x.shape, dtype=bool), eye=np.array([0.0, 0.0, 1.0, 0.0]))


def roof() -> RangeImage:
    """Two slopes, a flat top between them and a step in front: creases, a jump and borders."""
    x, y = np.meshgrid(np.arange(60.0), np.arange(50.0))
    z = np.minimum(12.0, np.minimum(0.7 * x, 0.7 * (59.0 - x))) + np.where(y > 40, -15.0, 0.0)
    return RangeImage(
        points=np.stack([x, y, z], axis=-1), valid=np.ones(x.shape, dtype=bool), eye=np.array([0.0, 0.0, 1.0, 0.0])
    )


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_range_image_gives_measured_points_with_normals_and_borders(options: ControlPoints) -> None:
    whole = to_cloud(roof())
    chosen = select(roof(), options, seed=3)
    assert abs(len(chosen) - options.count) <= TOLERANCE[options.kind]
    row_of = {tuple(point): row for row, point in enumerate(whole.points)}
    rows = np.array([row_of[tuple(point)] for point in chosen.points])
    assert whole.normals is not None and whole.border is not None
    np.testing.assert_array_equal(chosen.normals, whole.normals[rows])
    if isinstance(options, Contours) and "border" in options.labels:
        assert chosen.border is not None and not chosen.border.any() and whole.border[rows].any()
    else:
        np.testing.assert_array_equal(chosen.border, whole.border[rows])


def test_cloud_without_normals_stays_without() -> None:
    points = to_cloud(dome()).points
    chosen = select(Cloud(points=points), Subsample(count=50))
    assert chosen.normals is None and chosen.border is None
    np.testing.assert_array_equal(chosen.points, select(points, Subsample(count=50)).points)


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_asking_more_than_present_gives_all(options: ControlPoints) -> None:
    many = type(options)(**{**vars(options), "count": 100_000})
    whole = to_cloud(roof()).points
    chosen = select(roof(), many).points
    if isinstance(options, Contours) or getattr(options, "at", "") == "centres":
        assert len(np.unique(chosen, axis=0)) == len(chosen) <= len(whole)
    else:
        np.testing.assert_array_equal(chosen, whole)


def test_seed_changes_the_random_draw_alone() -> None:
    for options in OPTIONS[:3]:
        same = np.array_equal(select(dome(), options, seed=1).points, select(dome(), options, seed=2).points)
        assert same == (options != OPTIONS[1])


LABELS: tuple[tuple[Literal["crease", "depth", "border"], ...], ...] = (
    ("crease",),
    ("depth",),
    ("border",),
    ("crease", "depth", "border"),
    ("border", "depth", "crease"),
)


def test_labels_choose_the_edges_and_their_order_does_not_matter() -> None:
    chosen = {
        labels: {tuple(p) for p in select(roof(), Contours(count=100_000, labels=labels)).points} for labels in LABELS
    }
    crease, depth, border, every, turned = chosen.values()
    assert crease and depth and border
    assert not crease & border and not crease & depth and not depth & border
    assert every == turned and len(every) >= len(crease | depth | border) - 12
    assert {p[1] for p in depth} == {40.0}  # the near side of the step, not the far one


@pytest.mark.parametrize("scan", [lambda: to_cloud(dome()), lambda: to_cloud(dome()).points], ids=["cloud", "array"])
@pytest.mark.parametrize(
    ("options", "what"), [(Vertices(), "mesh vertices"), (SplitVertices(), "mesh vertices"), (Contours(), "contours")]
)
def test_what_needs_a_grid_is_refused_of_a_cloud(
    scan: Callable[[], Cloud | np.ndarray], options: ControlPoints, what: str
) -> None:
    with pytest.raises(InputError, match=f"{what} need a range image or mesh, and this cloud has no grid"):
        select(scan(), options)


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        ((), "labels is empty, expected at least one of crease, depth, border"),
        (("crease", "depth", "crease"), "labels names one kind of edge twice"),
    ],
)
def test_labels_that_make_no_sense_are_refused(labels: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Contours(labels=labels)


@pytest.mark.parametrize("node", [Subsample, Vertices, Contours, SplitVertices])
@pytest.mark.parametrize("count", [-1, 0, 2])
def test_counts_too_small_for_a_motion_are_refused(node: type[ControlPoints], count: int) -> None:
    with pytest.raises(InputError, match=f"count is {count}, expected at least 3"):
        node(count=count)


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.ones((10, 3)), np.full((10, 3), np.nan)])
def test_bad_clouds_are_refused(points: np.ndarray) -> None:
    with pytest.raises(InputError):
        select(points, Subsample(count=5))
