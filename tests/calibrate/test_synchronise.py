"""The offset of two clocks is found from the angles alone, before anything is calibrated."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate.synchronise import Stream, interpolate, ordered, synchronise
from jaxmodel.errors import InputError


def wandering(times: np.ndarray) -> np.ndarray:
    """A smooth motion of the hand, exact at every instant."""
    angles = np.stack([np.sin(0.7 * times), 0.8 * np.cos(0.9 * times + 1), 0.6 * np.sin(0.5 * times + 2)], axis=1)
    T = np.tile(np.eye(4), (len(times), 1, 1))
    T[:, :3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    T[:, :3, 3] = np.stack([np.cos(times), np.sin(0.4 * times), 0.1 * times], axis=1)
    return T


def both(offset: float, rate: float = 100.0) -> tuple[Stream, Stream, np.ndarray]:
    hand_times = np.arange(0, 20, 1 / rate)
    camera_times = np.arange(3.0, 16.0, 1 / 30)
    X = np.eye(4)
    X[:3, :3] = Rotation.from_rotvec([0.3, 1.0, -2.0]).as_matrix()
    X[:3, 3] = [0.1, 0.2, 0.3]
    hand = Stream(hand_times, wandering(hand_times))
    return hand, Stream(camera_times, wandering(camera_times + offset) @ X), X


@pytest.mark.parametrize("offset", [-0.73, -0.06, 0.0, 0.021, 0.5])
def test_the_offset_is_found(offset):
    hand, camera, X = both(offset)
    found = synchronise(hand, camera)
    assert abs(found.offset_s - offset) < 1e-3
    assert found.sharpness > 10
    np.testing.assert_allclose(found.hand @ X, found.camera, atol=5e-3)


def test_noise_moves_it_little():
    hand, camera, _ = both(0.25)
    rng = np.random.default_rng(0)
    poses = camera.poses.copy()
    poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(0.01 * rng.normal(size=(len(poses), 3))).as_matrix()
    found = synchronise(hand, Stream(camera.times, poses))
    assert abs(found.offset_s - 0.25) < 0.01
    assert 0.3 < found.angle_error_deg < 2.0


def test_a_given_offset_is_taken():
    hand, camera, _ = both(0.25)
    given = synchronise(hand, camera, offset_s=0.25)
    assert given.offset_s == 0.25
    assert given.angle_error_deg < 0.01


def test_a_still_recording_says_that_it_tells_nothing():
    times = np.arange(0, 10, 0.01)
    rng = np.random.default_rng(1)

    def still(instants: np.ndarray) -> Stream:
        poses = np.tile(np.eye(4), (len(instants), 1, 1))
        poses[:, :3, :3] = Rotation.from_rotvec(1e-3 * rng.normal(size=(len(instants), 3))).as_matrix()
        return Stream(instants, poses)

    assert synchronise(still(times), still(times[300:600:3])).sharpness < 1.5


def test_interpolation_and_order():
    times = np.arange(0, 10, 0.01)
    stream = Stream(times, wandering(times))
    np.testing.assert_allclose(interpolate(stream, times[5:9]), stream.poses[5:9], atol=1e-12)
    between = np.array([1.005, 3.337])
    np.testing.assert_allclose(interpolate(stream, between), wandering(between), atol=1e-4)
    shuffled = np.random.default_rng(2).permutation(np.repeat(np.arange(len(times)), 2))
    tidy = ordered(times[shuffled], stream.poses[shuffled])
    np.testing.assert_array_equal(tidy.times, times)
    np.testing.assert_array_equal(tidy.poses, stream.poses)


def test_streams_that_do_not_meet_are_refused():
    hand, camera, _ = both(0.0)
    with pytest.raises(InputError, match=r"overlap in 0 camera poses: the hand covers 0\.000 to"):
        synchronise(hand, Stream(camera.times + 100, camera.poses))
