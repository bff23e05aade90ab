"""Laser odometry: exact in simulated rooms, odometry where profiles do not tell, the Intel log."""

import csv
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.io.carmen import read_carmen
from jaxmodel.register.profile_icp import ProfileOptions, ProfileOutcome
from jaxmodel.register.profiles import register_pairs, slides, track
from jaxmodel.scan.profile import Profile, between, compose, profile

ROOM = np.array([(-4, -3), (5, -3), (5, 0), (3, 0), (3, 4), (-1, 4), (-1, 3), (-4, 3.5)], float)
CORRIDOR = np.array([(-200, -1), (200, -1), (200, 1), (-200, 1)], float)


def _scan(walls: np.ndarray, pose: np.ndarray, noise: float = 0.0, seed: int = 0) -> Profile:
    """What a laser of 180 beams reads in a room of straight walls (a closed polygon)."""
    angle = pose[2] + np.deg2rad(-90 + np.arange(180))
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    a, b = walls, np.roll(walls, -1, axis=0)
    along, from_eye = b - a, a - pose[:2]
    cross = ray[:, None, 0] * along[None, :, 1] - ray[:, None, 1] * along[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (from_eye[None, :, 0] * along[None, :, 1] - from_eye[None, :, 1] * along[None, :, 0]) / cross
        u = (from_eye[None, :, 0] * ray[:, None, 1] - from_eye[None, :, 1] * ray[:, None, 0]) / cross
    ranges = np.where((t > 0) & (u >= 0) & (u <= 1), t, np.inf).min(axis=1)
    return profile(ranges + noise * np.random.default_rng(seed).normal(size=180), 80.0)


def _way(count: int = 8) -> np.ndarray:
    poses = [np.array([0.5, 0.0, 0.3])]
    for k in range(count - 1):
        poses.append(compose(poses[-1], np.array([0.12, 0.02 * (-1) ** k, 0.15])))
    return np.stack(poses)


def _odometry(way: np.ndarray, seed: int, shift: float = 0.04, turn: float = 0.04) -> np.ndarray:
    draw = np.random.default_rng(seed)
    steps = between(way[:-1], way[1:]) + np.array([shift, shift, turn]) * draw.normal(size=(len(way) - 1, 3))
    out = [np.array([3.0, -2.0, 1.0])]
    for step in steps:
        out.append(compose(out[-1], step))
    return np.stack(out)


def _error(poses: np.ndarray, way: np.ndarray) -> np.ndarray:
    return np.abs(between(between(np.tile(way[0], (len(way), 1)), way), poses)).max(axis=0)


@pytest.mark.parametrize("approach", ["pairs", "sliding", "cumulative"])
def test_without_noise_the_way_is_found(approach):
    way = _way()
    found = track([_scan(ROOM, pose) for pose in way], _odometry(way, 1), approach)
    assert not found.kept_odometry.any() and not found.corridor.any()
    error = _error(found.poses, way)
    assert error[:2].max() < 0.02 and error[2] < 0.005
    assert (_error(found.guess - 0, way[1:])[:2] > 0).all()
    assert found.points.shape == (len(way) - 1, 2) and (found.points > 100).all()


def test_noise_is_averaged_and_the_frame_of_the_odometry_does_not_matter():
    way = _way()
    profiles = [_scan(ROOM, pose, 0.01, k) for k, pose in enumerate(way)]
    odometry = _odometry(way, 2)
    found = track(profiles, odometry)
    assert _error(found.poses, way)[:2].max() < 0.05 and _error(found.poses, way)[2] < 0.02
    moved = compose(np.tile([5.0, 1.0, -2.0], (len(way), 1)), odometry)
    assert np.allclose(track(profiles, moved).poses, found.poses, atol=1e-4)


def test_a_pair_is_the_same_alone_in_company_and_padded():
    way = _way(6)
    profiles = [_scan(ROOM, pose, 0.01, k) for k, pose in enumerate(way)]
    guesses = between(_odometry(way, 3)[:-1], _odometry(way, 3)[1:])
    together = register_pairs(profiles[:-1], profiles[1:], guesses)
    alone = register_pairs(profiles[2:3], profiles[3:4], guesses[2:3])
    assert np.array_equal(together.pose[2], alone.pose[0])
    blind = Profile(*(np.concatenate([field, np.zeros_like(field[:40])]) for field in profiles[2]))
    padded = register_pairs([blind], profiles[3:4], guesses[2:3])
    assert np.allclose(padded.pose[0], alone.pose[0], atol=1e-6)


def test_along_a_corridor_odometry_decides_and_it_is_flagged():
    way = np.column_stack([np.linspace(0, 1.4, 8), np.zeros(8), np.zeros(8)])
    odometry = way.copy()
    odometry[:, 0] *= 1.3  # slips along the corridor: nothing tells
    found = track([_scan(CORRIDOR, pose, 0.005, k) for k, pose in enumerate(way)], odometry)
    assert found.corridor.all()
    assert np.abs(np.sin(found.direction)).max() < 0.05
    assert np.allclose(found.poses[:, 0], odometry[:, 0], atol=0.05) and np.abs(found.poses[:, 1:]).max() < 0.02


def test_profiles_that_do_not_meet_keep_the_odometry_and_say_so():
    way = _way(3)
    profiles = [_scan(ROOM, pose) for pose in way]
    few = profiles[1]._replace(lined=np.zeros(180, bool))
    odometry = _odometry(way, 4)
    found = track([profiles[0], few, profiles[2]], odometry, "pairs")
    assert found.kept_odometry.all() and np.allclose(found.poses, between(np.tile(odometry[0], (3, 1)), odometry))
    assert "odometry is kept" in ProfileOutcome(int(found.fit.outcome[0])).sentence
    far = register_pairs(profiles[:1], profiles[1:2], np.zeros((1, 3)), ProfileOptions(most=1e-3))
    assert far.outcome[0] == ProfileOutcome.TOO_FAR


def test_what_slides_is_told_by_the_shift_alone():
    walls = np.diag([0.0, 4.0, 2.0])
    quotient, direction = slides(np.stack([walls, np.diag([4.0, 4.0, 2.0])]))
    assert quotient[0] == 0 and np.isclose(np.abs(np.cos(direction[0])), 1) and quotient[1] == 1


@pytest.mark.data
def test_the_intel_log_in_one_batch(data_dir: Path):
    """All 909 successive pairs in one call: over 50 steps an order of magnitude better than the raw odometry."""
    log = read_carmen(data_dir / "laser2d" / "intel.gfs.log.gz")
    profiles = [profile(ranges, 80.0) for ranges in log.ranges]
    found = track(profiles, log.odometry, "pairs")
    assert len(found.fit.outcome) == 909 and found.kept_odometry.sum() < 10

    def apart(poses: np.ndarray, a: np.ndarray, b: np.ndarray, true: np.ndarray) -> tuple[float, float]:
        off = between(true, between(poses[a], poses[b]))
        return float(np.linalg.norm(off[:, :2], axis=1).mean()), float(np.abs(off[:, 2]).mean())

    relations = (data_dir / "laser2d" / "intel_relations_matched.csv").read_text()
    rows = list(csv.reader(relations.splitlines()))[1:]
    told = np.array(rows, float)
    a, b = told[:, 0].astype(int), told[:, 1].astype(int)
    raw, ours = (apart(poses, a, b, told[:, 2:]) for poses in (log.odometry, found.poses))
    assert ours[0] < raw[0] / 5 and ours[1] < raw[1] / 5
    start = np.arange(len(profiles) - 50)
    true = between(log.corrected[start], log.corrected[start + 50])
    raw, ours = (apart(poses, start, start + 50, true) for poses in (log.odometry, found.poses))
    assert ours[0] < raw[0] / 10 and ours[1] < raw[1] / 10
