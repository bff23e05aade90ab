"""The figures are pictures with something on them, whatever the sweep gave."""

import io

import numpy as np
import pytest
from matplotlib.image import imread

from jaxmodel.view.figures import (
    IterationCurve,
    SweepCurve,
    error_beside_truth,
    iterations,
    sorted_error,
    start_sphere,
    switches,
)


def curve(good: float, label: str = "subsample", count: int = 60) -> SweepCurve:
    draw = np.random.default_rng(0)
    right = draw.random(count) < good
    return SweepCurve(label, np.where(right, 0.1, draw.random(count) + 0.2), right, np.where(right, 1.0, 90.0))


def picture(content: bytes) -> np.ndarray:
    image = imread(io.BytesIO(content), format="png")[..., :3]
    assert image.shape[0] > 200 and image.shape[1] > 400
    return image


def blue(image: np.ndarray) -> int:
    return int(np.sum((image[..., 2] > 0.5) & (image[..., 0] < 0.3)))


@pytest.mark.parametrize("good", [0.0, 0.4, 1.0])
def test_sweep_figures_show_what_converged(good: float) -> None:
    curves = [curve(good), curve(good, "vertices")]
    directions = np.random.default_rng(1).normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for content in (
        sorted_error("boulder", curves),
        error_beside_truth("boulder", curves),
        start_sphere("boulder", directions, curves),
    ):
        image = picture(content)
        assert np.mean(image < 0.9) > 0.003
        assert (blue(image) > 150) == (good > 0)


def test_not_finite_errors_go_last_and_do_not_stop_the_picture() -> None:
    bad = curve(0.5)
    bad.error[:5] = np.nan
    bad.error[5] = np.inf
    assert picture(sorted_error("boulder", [bad])).shape == picture(sorted_error("boulder", [curve(0.5)])).shape


def test_iterations_show_both_curves_and_the_switches() -> None:
    trace = IterationCurve(
        "subsample", np.linspace(1, 0.1, 30), np.linspace(0.2, 0.9, 30), np.repeat([0, 1, 2], 10).astype(np.int32)
    )
    image = picture(iterations("boulder", [trace]))
    orange = (image[..., 0] > 0.6) & (image[..., 2] < 0.3)
    assert blue(image) > 300 and orange.sum() > 300


def test_switches_are_counted_from_one() -> None:
    assert switches(np.array([0, 0, 1, 1, 2])) == [3, 5]
    assert switches(np.array([0])) == []


def test_same_input_is_the_same_picture() -> None:
    assert sorted_error("boulder", [curve(0.5)]) == sorted_error("boulder", [curve(0.5)])
