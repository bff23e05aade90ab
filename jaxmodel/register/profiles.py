"""Laser odometry: where a robot went, from its profiles and its odometry (thesis §5.2).

``pairs``: each profile onto the one before it, all in one batch. ``sliding``: onto the last n, which the thesis keeps
at 3. ``cumulative``: onto the map of all before. The thesis rejects a profile that does not converge; here its odometry
is kept, and said so.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxmodel.geometry.masked import size_class
from jaxmodel.lanes import Engine, run
from jaxmodel.register.profile_icp import ProfileFit, ProfileIcp, ProfileOptions, ProfileOutcome, ProfilePair
from jaxmodel.scan.profile import Profile, between, compose

Approach = Literal["pairs", "sliding", "cumulative"]
CORRIDOR = 0.02
"""Least quotient of the informations along the worst and the best direction: below, a profile slides."""
MAP_CELL = 0.05
"""Edge of the cells, metre, of which a cumulative map keeps one point each."""
AROUND = 12.0
"""How far from the robot, metre, a cumulative map is looked at."""


class Track(NamedTuple):
    """``poses (n, 3)`` in the frame of the first profile; for each but the first ``fit``, ``points (n - 1, 2)`` of the
    two that were registered, ``guess (n - 1, 3)`` odometry's pose beside ``poses``, ``kept_odometry``, ``corridor`` and
    its ``direction (n - 1,)``, radian in the frame of the first profile.
    """

    poses: Float[np.ndarray, "n 3"]
    fit: ProfileFit
    points: Int[np.ndarray, "m 2"]
    guess: Float[np.ndarray, "m 3"]
    kept_odometry: Bool[np.ndarray, " m"]
    corridor: Bool[np.ndarray, " m"]
    direction: Float[np.ndarray, " m"]


def register_pairs(
    targets: Sequence[Profile],
    sources: Sequence[Profile],
    guesses: Float[np.ndarray, "n 3"],
    options: ProfileOptions | None = None,
) -> ProfileFit:
    """Any number of pairs in one batch; ``guesses``: poses of the sources in their targets' frames."""
    items = [_item(t, s, g) for t, s, g in zip(targets, sources, guesses, strict=True)]
    stacked = ProfilePair(*(np.stack(field) for field in zip(*items, strict=True)))
    found = run(ProfileIcp(ProfileOptions() if options is None else options), stacked, Engine(chunk=1024))
    return ProfileFit(*(np.asarray(field) for field in found))


def track(
    profiles: Sequence[Profile],
    odometry: Float[np.ndarray, "n 3"],
    approach: Approach = "sliding",
    window: int = 3,
    options: ProfileOptions | None = None,
) -> Track:
    """The way of a robot; ``odometry``: its pose at each profile, in any frame. ``window``: of ``sliding``."""
    steps = between(odometry[:-1], odometry[1:])
    if approach == "pairs":
        return _batch(profiles, steps, options)
    kernel, engine = ProfileIcp(ProfileOptions() if options is None else options), Engine(chunk=1)
    poses, fits, points, guesses = [np.zeros(3)], [], [], []
    held = _Map()
    for k in range(1, len(profiles)):
        if approach == "cumulative":
            held.add(profiles[k - 1], poses[-1])
            target = held.around(poses[-1])
        else:
            target = _window(profiles[max(0, k - window) : k], poses[max(0, k - window) : k])
        item = _item(target, profiles[k], steps[k - 1])
        fit = run(kernel, ProfilePair(*(np.asarray(field)[None] for field in item)), engine)
        fit = ProfileFit(*(np.asarray(field)[0] for field in fit))
        believed = int(fit.outcome) == ProfileOutcome.CONVERGED
        fits.append(fit)
        guesses.append(compose(poses[-1], steps[k - 1]))
        points.append((int(target.lined.sum()), int(profiles[k].lined.sum())))
        poses.append(compose(poses[-1], np.asarray(fit.pose, np.float64)) if believed else guesses[-1])
    stacked = ProfileFit(*(np.stack(field) for field in zip(*fits, strict=True)))
    return _track(np.stack(poses), stacked, np.array(points), np.stack(guesses))


def _batch(profiles: Sequence[Profile], steps: Float[np.ndarray, "m 3"], options: ProfileOptions | None) -> Track:
    fit = register_pairs(profiles[:-1], profiles[1:], steps, options)
    believed = np.asarray(fit.outcome) == ProfileOutcome.CONVERGED
    used = np.where(believed[:, None], np.asarray(fit.pose, np.float64), steps)
    poses, guesses = [np.zeros(3)], []
    for step, odometry in zip(used, steps, strict=True):
        guesses.append(compose(poses[-1], odometry))
        poses.append(compose(poses[-1], step))
    count = np.array([int(p.lined.sum()) for p in profiles])
    return _track(np.stack(poses), fit, np.stack([count[:-1], count[1:]], axis=1), np.stack(guesses))


def _track(poses: np.ndarray, fit: ProfileFit, points: np.ndarray, guesses: np.ndarray) -> Track:
    quotient, direction = slides(np.asarray(fit.information, np.float64))
    kept = np.asarray(fit.outcome) != ProfileOutcome.CONVERGED
    return Track(poses, fit, points, guesses, kept, quotient < CORRIDOR, direction + poses[:-1, 2])


def slides(information: Float[np.ndarray, "m 3 3"]) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """How little a profile is held along its worst direction, beside the best; and that direction (radian).

    Of the shift alone, whatever the turn: the Schur complement of the turn.
    """
    turn = np.maximum(information[:, 2, 2], 1e-12)[:, None, None]
    cross = information[:, :2, 2]
    shift = information[:, :2, :2] - cross[:, :, None] * cross[:, None, :] / turn
    value, vector = np.linalg.eigh(shift)
    return np.maximum(value[:, 0], 0) / np.maximum(value[:, 1], 1e-12), np.arctan2(vector[:, 1, 0], vector[:, 0, 0])


def _item(target: Profile, source: Profile, guess: Float[np.ndarray, "3"]) -> ProfilePair:
    m, n = size_class(len(target.points)), size_class(len(source.points))
    t, tn, tm = _columns(target, m)
    s, sn, sm = _columns(source, n)
    return ProfilePair(t, tn, tm, s, sn, sm, np.asarray(guess, np.float32))


def _columns(of: Profile, length: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    pad = length - len(of.points)
    points, normals = (np.pad(a, ((0, pad), (0, 0))).T.astype(np.float32) for a in (of.points, of.normals))
    return points, normals, np.pad(of.lined, (0, pad))


def _window(profiles: Sequence[Profile], poses: Sequence[np.ndarray]) -> Profile:
    """Profiles in the frame of the last."""
    moved = [_seen_from(p, between(poses[-1], pose)) for p, pose in zip(profiles, poses, strict=True)]
    return Profile(*(np.concatenate(field) for field in zip(*moved, strict=True)))


def _seen_from(of: Profile, pose: Float[np.ndarray, "3"]) -> Profile:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    R = np.array([[c, -s], [s, c]])
    return of._replace(points=of.points @ R.T + pose[:2], normals=of.normals @ R.T)


class _Map:
    """All profiles so far, one point a cell, in the frame of the first."""

    def __init__(self) -> None:
        self.points, self.normals = np.zeros((0, 2)), np.zeros((0, 2))
        self.cells: set[tuple[int, int]] = set()

    def add(self, of: Profile, pose: Float[np.ndarray, "3"]) -> None:
        moved = _seen_from(of, pose)
        points, normals = moved.points[of.lined], moved.normals[of.lined]
        fresh = []
        for k, cell in enumerate(map(tuple, np.floor(points / MAP_CELL).astype(int).tolist())):
            if cell not in self.cells:
                self.cells.add(cell)
                fresh.append(k)
        self.points = np.concatenate([self.points, points[fresh]])
        self.normals = np.concatenate([self.normals, normals[fresh]])

    def around(self, pose: Float[np.ndarray, "3"]) -> Profile:
        """What lies around the robot, in its frame."""
        near = np.linalg.norm(self.points - pose[:2], axis=1) < AROUND
        c, s = np.cos(pose[2]), np.sin(pose[2])
        back = np.array([[c, s], [-s, c]])
        points, normals = (self.points[near] - pose[:2]) @ back.T, self.normals[near] @ back.T
        whole = np.ones(len(points), bool)
        return Profile(points, normals, whole, whole)
