"""The options as they stand in a configuration, and what a selection carries along."""

from collections.abc import Callable

import numpy as np
import pytest

from jaxmodel.control_points import ControlPoints, Subsample, Vertices, select
from jaxmodel.errors import InputError
from jaxmodel.scan.cloud import Cloud
from jaxmodel.scan.range_image import RangeImage, to_cloud

OPTIONS = [
    Subsample(count=80),
    Subsample(count=80, how="random"),
    Subsample(count=80, how="farthest"),
    Vertices(count=80),
    Vertices(count=80, at="centres"),
]


def dome() -> RangeImage:
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 31), np.linspace(-1.0, 1.0, 25))
    points = np.stack([x, y, 1.0 - 0.4 * (x**2 + 0.7 * y**2) + 0.02 * np.sin(9 * x)], axis=-1)
    return RangeImage(points=points, valid=np.ones(x.shape, dtype=bool), eye=np.array([0.0, 0.0, 1.0, 0.0]))


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_range_image_gives_measured_points_with_normals_and_borders(options: ControlPoints) -> None:
    whole = to_cloud(dome())
    chosen = select(dome(), options, seed=3)
    assert abs(len(chosen) - 80) <= (1 if isinstance(options, Vertices) else 0)
    row_of = {tuple(point): row for row, point in enumerate(whole.points)}
    rows = np.array([row_of[tuple(point)] for point in chosen.points])
    assert whole.normals is not None and whole.border is not None
    np.testing.assert_array_equal(chosen.normals, whole.normals[rows])
    np.testing.assert_array_equal(chosen.border, whole.border[rows])


def test_cloud_without_normals_stays_without() -> None:
    points = to_cloud(dome()).points
    chosen = select(Cloud(points=points), Subsample(count=50))
    assert chosen.normals is None and chosen.border is None
    np.testing.assert_array_equal(chosen.points, select(points, Subsample(count=50)).points)


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_asking_more_than_present_gives_all(options: ControlPoints) -> None:
    many = type(options)(**{**vars(options), "count": 100_000})
    whole = to_cloud(dome()).points
    chosen = select(dome(), many).points
    if isinstance(options, Vertices) and options.at == "centres":
        assert len(np.unique(chosen, axis=0)) == len(chosen) <= len(whole)
    else:
        np.testing.assert_array_equal(chosen, whole)


def test_seed_changes_the_random_draw_alone() -> None:
    for options in OPTIONS[:3]:
        same = np.array_equal(select(dome(), options, seed=1).points, select(dome(), options, seed=2).points)
        assert same == (options != OPTIONS[1])


@pytest.mark.parametrize("scan", [lambda: to_cloud(dome()), lambda: to_cloud(dome()).points], ids=["cloud", "array"])
def test_vertices_of_a_cloud_are_refused(scan: Callable[[], Cloud | np.ndarray]) -> None:
    with pytest.raises(InputError, match="mesh vertices need a range image or mesh"):
        select(scan(), Vertices())


@pytest.mark.parametrize("node", [Subsample, Vertices])
@pytest.mark.parametrize("count", [-1, 0, 2])
def test_counts_too_small_for_a_motion_are_refused(node: type[Subsample] | type[Vertices], count: int) -> None:
    with pytest.raises(InputError, match=f"count is {count}, expected at least 3"):
        node(count=count)


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.ones((10, 3)), np.full((10, 3), np.nan)])
def test_bad_clouds_are_refused(points: np.ndarray) -> None:
    with pytest.raises(InputError):
        select(points, Subsample(count=5))
