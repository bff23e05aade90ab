"""Where the base is moved: the best of the candidates by a count made one by one, and what cannot be reached."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.errors import InputError
from jaxmodel.geometry import se3
from jaxmodel.plan.arm_models import gt6a_like
from jaxmodel.plan.arm_reposition import base_poses, bases_around, reach_matrix, reposition
from jaxmodel.plan.inverse_kinematics import reachable
from jaxmodel.plan.viewpoints import ObservationSphere

TILTED = se3.compose(Rotation.from_euler("zyx", [0.4, 0.02, -0.01]).as_matrix(), np.array([-0.6, 0.1, 0.5]))
ARM = gt6a_like(1.0, T_world_base=TILTED)
CENTRE = np.array([0.0, 0.0, 0.8])
SPHERE = ObservationSphere(CENTRE, 0.3)
VIEWS = SPHERE.poses(SPHERE.spread(150))


def test_candidates_stand_around_and_face_the_middle() -> None:
    places = bases_around(
        CENTRE, np.array([0.5, 0.8]), np.linspace(0, 2 * np.pi, 6, endpoint=False), np.array([0.0, 0.2])
    )
    assert places.shape == (24, 3)
    away = np.linalg.norm(places[:, :2] - CENTRE[:2], axis=1)
    np.testing.assert_allclose(away, np.repeat([0.5, 0.8], 12))
    straight = places[::2]
    ahead = np.stack([np.cos(straight[:, 2]), np.sin(straight[:, 2])], axis=1)
    to_middle = (CENTRE[:2] - straight[:, :2]) / np.linalg.norm(CENTRE[:2] - straight[:, :2], axis=1, keepdims=True)
    np.testing.assert_allclose(ahead, to_middle, atol=1e-12)


def test_the_base_keeps_its_height_and_its_tilt() -> None:
    moved = base_poses(TILTED, np.array([[1.0, 2.0, -2.0], [-0.6, 0.1, 0.9]]))
    np.testing.assert_allclose(moved[:, 2, 3], 0.5)
    np.testing.assert_allclose(moved[:, 2, :3], np.tile(TILTED[2, :3], (2, 1)), atol=1e-12)
    assert np.arctan2(moved[0, 1, 0], moved[0, 0, 0]) == pytest.approx(-2.0)
    yaw = np.arctan2(TILTED[1, 0], TILTED[0, 0])
    np.testing.assert_allclose(base_poses(TILTED, np.array([[-0.6, 0.1, yaw]]))[0], TILTED, atol=1e-12)
    with pytest.raises(InputError, match="finite candidates"):
        base_poses(TILTED, np.array([[np.nan, 0, 0]]))


def test_all_pairs_at_once_are_pairs_one_by_one() -> None:
    bases = base_poses(TILTED, bases_around(CENTRE, np.array([0.5, 1.0, 3.0]), np.array([0.0, 2.0])))
    matrix = reach_matrix(ARM, VIEWS, bases)
    for base, row in zip(bases, matrix, strict=True):
        np.testing.assert_array_equal(row, reachable(ARM.at(base), VIEWS))
    assert not matrix[4:].any() and matrix[:4].any()


def test_the_base_goes_where_most_is_reached() -> None:
    there = reachable(ARM, VIEWS)
    rest = VIEWS[~there]
    places = bases_around(CENTRE, np.array([0.45, 0.6]), np.linspace(0, 2 * np.pi, 8, endpoint=False))
    found = reposition(ARM, rest, places)
    counts = [reachable(ARM.at(base), rest).sum() for base in base_poses(TILTED, places)]
    np.testing.assert_array_equal(found.counts, counts)
    assert found.counts[found.candidate] == max(counts) == found.reached.sum() > 0
    np.testing.assert_array_equal(found.reached, reachable(ARM.at(found.T_world_base), rest))
    assert str(found.candidate) in found.sentence and str(max(counts)) in found.sentence


def test_among_equals_the_nearest_place() -> None:
    places = np.array([[4.0, 4.0, 0.0], [0.5, 0.0, np.pi], [0.5, 0.0, np.pi]])
    assert reposition(ARM, VIEWS, places).candidate == 1


def test_nothing_in_reach_leaves_the_arm_where_it_is() -> None:
    found = reposition(ARM, VIEWS, np.array([[50.0, 0.0, 0.0]]))
    assert found.candidate == -1 and not found.reached.any() and "no candidate" in found.sentence
    np.testing.assert_array_equal(found.T_world_base, TILTED)


def test_bad_arguments() -> None:
    with pytest.raises(InputError, match="at least one candidate and one wanted view"):
        reposition(ARM, VIEWS[:0], np.zeros((1, 3)))
    with pytest.raises(InputError, match="candidate 1 is not a rigid motion"):
        reach_matrix(ARM, VIEWS, np.stack([np.eye(4), 2 * np.eye(4)]))
