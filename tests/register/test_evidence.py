"""What speaks for and against a pose: all for the true one, free space against those that cross it."""

import numpy as np
import pytest

from jaxmodel.io.datasets import ObjectViews
from jaxmodel.lanes import Engine, run
from jaxmodel.register.candidates import Candidates, PairOfViews, distinct
from jaxmodel.register.evidence import Examine
from jaxmodel.register.icp import Pose
from jaxmodel.register.search import views_of
from jaxmodel.register.verdict import probability_of
from jaxmodel.scan.cloud import as_cloud
from jaxmodel.scan.sensor import Sensor


@pytest.fixture(scope="module")
def pair() -> tuple[PairOfViews, np.ndarray]:
    views = ObjectViews("gourd", (0, 40), Sensor(width=120, height=120))
    ready, length = views_of({name: views.scan(name) for name in views.names})
    both = PairOfViews(ready[views.names[0]], ready[views.names[1]], length)
    return both, views.T_target_source(*views.names)


def _shifted(T: np.ndarray, by: np.ndarray) -> np.ndarray:
    out = T.copy()
    out[:3, 3] += by
    return out


def test_the_true_pose_has_everything_for_it(pair):
    both, T = pair
    found = both.examined(T[None], 0.008)
    assert found.evidence.source.near[0] > 0.3 and found.evidence.target.near[0] > 0.3
    assert found.evidence.source.front[0] + found.evidence.target.front[0] == 0
    assert found.evidence.source.empty[0] + found.evidence.target.empty[0] < 0.002
    assert probability_of(found.evidence)[0] > 0.9


def test_towards_the_sensor_is_into_free_space_and_behind_is_not(pair):
    both, T = pair
    way = -both.target.centre / np.linalg.norm(both.target.centre)  # from the object to the target's pinhole
    towards, behind = (both.examined(_shifted(T, s * 0.1 * both.length * way)[None], 0.008) for s in (1, -1))
    assert towards.evidence.source.front[0] > 0.3 and behind.evidence.source.front[0] < 0.05
    assert towards.score[0] < -0.5
    assert probability_of(towards.evidence)[0] < 0.01


def test_the_halves_change_places_with_the_scans(pair):
    both, T = pair
    wrong = _shifted(T, np.array([0.03, 0.01, -0.02]))
    turned = PairOfViews(both.source, both.target, both.length)
    there, back = both.examined(wrong[None], 0.01), turned.examined(np.linalg.inv(wrong)[None], 0.01)
    for name in ("near", "opposed", "front", "empty"):
        assert np.allclose(getattr(there.evidence.source, name), getattr(back.evidence.target, name), atol=2e-3)


def test_executors_and_company_change_nothing(pair):
    both, T = pair
    poses = np.stack([_shifted(T, 0.01 * k * np.array([1.0, -1.0, 0.5])) for k in range(7)])
    kernel = Examine(both.target.side, both.source.side, *[np.asarray(0.01, np.float32)] * 2)
    items = Pose(*both.frames.to_centred(poses))
    cores, lanes = (run(kernel, items, Engine(name, lanes=3, chunk=8)) for name in ("cores", "lanes"))
    for a, b in zip(cores.source.__dict__.values(), lanes.source.__dict__.values(), strict=True):
        assert np.allclose(a, b, atol=2e-3)


def test_a_small_cloud_is_padded_without_a_trace():
    views = ObjectViews("gourd", (0, 40), Sensor(width=60, height=60))
    whole = as_cloud(views.scan(views.names[0]))
    few = whole.take(np.arange(0, len(whole), 4))
    ready, length = views_of({"a": few.points, "b": few.points + 0.0})
    found = PairOfViews(ready["a"], ready["b"], length).examined(np.eye(4)[None], 0.01)
    assert found.evidence.source.near[0] == found.evidence.target.near[0] == 1.0


def test_distinct_keeps_the_best_of_each_place(pair):
    both, T = pair
    poses = np.stack([T, _shifted(T, np.array([1e-3, 0, 0])), _shifted(T, np.array([0.5, 0, 0]))])
    found = both.examined(poses, 0.01)
    told = Candidates(poses, found.evidence, np.array([0.2, 0.9, 0.1]))
    assert distinct(told, 5, both.source.centre, 5.0, 0.05).tolist() == [1, 2]
