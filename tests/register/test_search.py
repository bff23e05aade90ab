"""Search with no first guess: right where scans share enough, refused where not, equals listed, units noticed."""

import numpy as np
import pytest

from jaxmodel.errors import InputError
from jaxmodel.geometry.se3 import rotation_angle_deg
from jaxmodel.io.datasets import MeshViews, ObjectViews, StanfordBunny
from jaxmodel.register.search import SearchOptions, search, views_of
from jaxmodel.register.verdict import SearchOutcome
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.known_solids import known_solid
from jaxmodel.scan.noise import Laser
from jaxmodel.scan.range_image import RangeImage
from jaxmodel.scan.sensor import Sensor

SENSOR = Sensor(width=120, height=120)


@pytest.fixture(scope="module")
def views() -> ObjectViews:
    return ObjectViews("gourd", (0, 50, 180), SENSOR, Laser(sigma=0.001), seed=4)


def _right(found: np.ndarray, true: np.ndarray, centre: np.ndarray, size: float) -> bool:
    turn = rotation_angle_deg(found[:3, :3].T @ true[:3, :3])
    shift = np.linalg.norm((found - true)[:3] @ np.append(centre, 1))
    return bool(turn < 1.0 and shift < 0.01 * size)


def test_two_views_are_put_together_and_the_verdict_knows(views):
    target, source = (views.scan(name) for name in views.names[:2])
    found = search(target, source)
    assert found.outcome is SearchOutcome.FOUND and found.probability > 0.8 and len(found.equivalents) == 0
    centre = as_cloud(source).points.mean(axis=0)
    assert _right(found.T_target_source, views.T_target_source(*views.names[:2]), centre, 1.0)
    again = search(target, source)
    assert np.array_equal(found.T_target_source, again.T_target_source) and found.probability == again.probability


def test_millimetres_are_as_good_as_metres(views):
    images = [views.scan(name) for name in views.names[:2]]
    target, source = (RangeImage(1000 * i.points, i.valid, i.eye) for i in images)
    found = search(target, source)
    true = views.T_target_source(*views.names[:2]).copy()
    true[:3, 3] *= 1000
    assert _right(found.T_target_source, true, as_cloud(source).points.mean(axis=0), 1000)


def test_bare_points_will_do(views):
    target, source = (as_cloud(views.scan(name)).points for name in views.names[:2])
    found = search(target, source)
    assert _right(found.T_target_source, views.T_target_source(*views.names[:2]), source.mean(axis=0), 1.0)


def test_scans_from_opposite_sides_are_refused(views):
    found = search(views.scan(views.names[0]), views.scan(views.names[2]))
    assert found.outcome is SearchOutcome.REFUSED and found.probability < 0.5 and len(found.equivalents) == 0


def test_a_ball_has_many_poses_and_all_are_listed():
    ball = MeshViews("ball", known_solid("ball"), (0, 60), SENSOR, Laser(sigma=0.001))
    target, source = (ball.scan(name) for name in ball.names)
    found = search(target, source)
    assert found.outcome is SearchOutcome.SEVERAL and len(found.equivalents) >= 3
    assert "several poses" in found.outcome.sentence
    true = ball.T_target_source(*ball.names)
    middle = np.linalg.inv(ball.T_world_scan(ball.names[1]))[:3, 3]  # of the ball, in the source's frame
    for T in [found.T_target_source, *found.equivalents]:
        assert np.linalg.norm((T - true)[:3] @ np.append(middle, 1)) < 0.005


def test_the_same_scan_twice_is_said(views):
    scan = views.scan(views.names[0])
    found = search(scan, scan)
    assert found.outcome is SearchOutcome.SAME_SCAN and np.array_equal(found.T_target_source, np.eye(4))


def test_a_factor_of_a_thousand_is_said(views):
    metre = as_cloud(views.scan(views.names[0])).points
    with pytest.raises(InputError, match=r"the source is .* metres and millimetres \(a factor of 1000\)"):
        search(metre, metre / 1000)
    with pytest.raises(InputError, match="expected scans of one unit") as other:
        search(metre, 100 * metre)
    assert "1000" not in str(other.value)


@pytest.mark.parametrize(
    ("points", "sentence"),
    [(np.zeros((0, 3)), "is empty"), (np.full((5, 3), np.nan), "finite"), (np.ones((9, 3)), "equal")],
)
def test_scans_that_cannot_be_searched_are_named(points, sentence):
    good = np.random.default_rng(0).normal(size=(100, 3))
    with pytest.raises(InputError, match=f"the target.*{sentence}"):
        views_of({"the target": points, "the source": good})


def test_options_must_be_positive():
    with pytest.raises(ValueError, match="grid must be greater than 0"):
        SearchOptions(grid=0)


@pytest.mark.data
@pytest.mark.parametrize(
    ("target", "source"), [("bun000", "bun090"), ("bun045", "bun270"), ("bun090", "bun315"), ("top2", "top3")]
)
def test_bunny_scans_that_share_little(data_dir, target, source):
    """Overlaps of 11 to 40 %: within half a degree and a millimetre."""
    bunny = StanfordBunny(data_dir)
    found = search(bunny.scan(target), bunny.scan(source))
    true, centre = bunny.T_target_source(target, source), as_cloud(bunny.scan(source)).points.mean(axis=0)
    assert rotation_angle_deg(found.T_target_source[:3, :3].T @ true[:3, :3]) < 0.7
    assert np.linalg.norm((found.T_target_source - true)[:3] @ np.append(centre, 1)) < 1.2e-3
    assert found.probability > 0.5


@pytest.mark.data
def test_bunny_scans_that_share_nothing_are_refused(data_dir):
    bunny = StanfordBunny(data_dir)
    assert search(bunny.scan("bun000"), bunny.scan("bun180")).outcome is SearchOutcome.REFUSED
