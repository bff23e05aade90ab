"""The figures of a calibration show what they were given."""

import io

import numpy as np
from matplotlib.image import imread

from jaxmodel.view.axis_sphere import AxisSphere, sphere_plot, sphere_png
from jaxmodel.view.chart_drawing import chart_png
from jaxmodel.view.hand_eye_figures import disagreement_png, influence_chart, motion_chart, residual_chart


def pixels(png: bytes) -> np.ndarray:
    return imread(io.BytesIO(png), format="png")[..., :3]


def orange(image: np.ndarray) -> int:
    return int(np.sum((image[..., 0] > 0.7) & (image[..., 2] < 0.25) & (image[..., 1] < 0.5)))


def axes_of(count: int = 80) -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(0)
    axes = draw.normal(size=(count, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True), draw.uniform(5, 90, count)


def test_outliers_have_a_colour_of_their_own():
    draw = np.random.default_rng(1)
    pose, turn, shift = np.arange(20), draw.random(20), draw.random(20)
    wrong = np.arange(20) == 7
    images = [pixels(chart_png(residual_chart("joint", pose, turn, shift, which))) for which in (wrong, ~wrong & wrong)]
    assert orange(images[0]) > 20 and orange(images[1]) == 0
    series = residual_chart("joint", pose, turn, shift, wrong).panels[1].series
    assert list(series[1].x) == [7] and list(series[1].y) == [shift[7]]


def test_what_is_not_known_leaves_a_gap():
    gap = np.array([0.1, np.nan, 0.3])
    for chart in (influence_chart(np.arange(3), gap, gap), motion_chart("linear", np.array([1.0, 2.0, 3.0]), gap, gap)):
        assert pixels(chart_png(chart)).std() > 0


def test_the_undetermined_direction_is_marked_on_both_discs():
    axes, angle = axes_of()
    plain = pixels(sphere_png(AxisSphere("axes", "the hand's frame", axes, angle)))
    marked = pixels(sphere_png(AxisSphere("axes", "the hand's frame", axes, angle, np.array([0.0, 0.6, 0.8]))))
    half = marked.shape[1] // 2
    assert orange(plain) == 0
    assert orange(marked[:, :half]) > 50 and orange(marked[:, half:]) > 50


def test_the_sphere_to_turn_has_each_axis_and_its_opposite():
    axes, angle = axes_of(30)
    plot = sphere_plot(AxisSphere("axes", "the base's frame", axes, angle, np.array([0.0, 0.0, 1.0])))
    trace = next(one for one in plot["data"] if one["name"] == "rotation axes")
    places = np.stack([trace[letter] for letter in "xyz"], axis=1)
    assert len(places) == 60
    order = np.argsort(angle)
    np.testing.assert_allclose(places[:30], axes[order], rtol=1e-4)
    np.testing.assert_allclose(places[30:], -axes[order], rtol=1e-4)
    line = next(one for one in plot["data"] if one["name"] == "undetermined direction")
    assert line["z"] == [-1.3, 1.3]


def test_no_motion_is_an_empty_sphere():
    nothing = AxisSphere("axes", "the hand's frame", np.zeros((0, 3)), np.zeros(0))
    assert pixels(sphere_png(nothing)).std() > 0 and sphere_plot(nothing)["data"]


def test_one_method_and_many_fit_their_picture():
    draw = np.random.default_rng(2)
    sizes = []
    for count in (1, 10):
        values = np.abs(draw.normal(size=(count, count)))
        image = pixels(disagreement_png([f"method_{k}" for k in range(count)], values, 10 * values))
        sizes.append(image.shape[1])
        assert np.mean(image < 0.9) > 0.003
    assert sizes[1] > sizes[0]


def test_same_input_is_the_same_picture():
    axes, angle = axes_of()
    one, other = (sphere_png(AxisSphere("axes", "the hand's frame", axes, angle)) for _ in range(2))
    assert one == other
