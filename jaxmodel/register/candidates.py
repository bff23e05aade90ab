"""Poses of one pair of scans on their way through a search: examined, told apart, registered further."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from jaxmodel.geometry.se3 import quaternion_to_rotation, rotation_angle_deg, rotation_to_quaternion
from jaxmodel.lanes import Engine, run
from jaxmodel.register.evidence import Evidence, Examine
from jaxmodel.register.icp import Icp, Pose
from jaxmodel.register.method import IcpMethod
from jaxmodel.register.problem import Frames, Problem
from jaxmodel.register.view_of_scan import ViewOfScan

AGAINST = 2.0
"""Points that must lie on the other's surface to make up for one that contradicts what the other's sensor read."""
ENGINE = Engine(chunk=512)


class Candidates(NamedTuple):
    """Poses with what speaks for them.

    ``score``: share of each scan near the other, both added, less ``AGAINST`` times the shares that contradict what
    the other's sensor read.
    """

    T_target_source: Float[np.ndarray, "n 4 4"]
    evidence: Evidence
    score: Float[np.ndarray, " n"]

    def take(self, rows: Int[np.ndarray, " k"]) -> "Candidates":
        """Some of them, in the order of ``rows``."""
        return Candidates(self.T_target_source[rows], jax.tree.map(lambda a: a[rows], self.evidence), self.score[rows])

    def joined(self, other: "Candidates") -> "Candidates":
        """These and those of another list."""
        return jax.tree.map(lambda a, b: np.concatenate([a, b]), self, other)


class PairOfViews(NamedTuple):
    """What all candidates of one pair share; ``length``: what distances of a search are measured in, unit of the
    data.
    """

    target: ViewOfScan
    source: ViewOfScan
    length: float

    @property
    def frames(self) -> Frames:
        return Frames(self.target.centre, self.source.centre)

    def examined(self, T: Float[np.ndarray, "n 4 4"], reach: float) -> Candidates:
        """Poses with their evidence; surfaces within ``reach`` lengths may be the same."""
        apart = np.asarray(reach * self.length, np.float32)
        kernel = Examine(self.target.side, self.source.side, apart, apart)
        found = run(kernel, Pose(*self.frames.to_centred(T)), ENGINE)
        near = found.source.near + found.target.near
        broken = found.source.front + found.target.front + found.source.empty + found.target.empty
        return Candidates(T, found, np.asarray(near - AGAINST * broken, np.float64))

    def best(self, found: Candidates, count: int, turn_deg: float, shift: float) -> Candidates:
        """The best ``count``, none of which differs from a better one by less than ``turn_deg`` and ``shift``
        lengths at the source's centre.
        """
        return found.take(distinct(found, count, self.source.centre, turn_deg, shift * self.length))

    def registered(self, T: Float[np.ndarray, "n 4 4"], method: IcpMethod) -> Float[np.ndarray, "n 4 4"]:
        """Where ICP goes from each pose, the source's sample against the target's thinned surface."""
        found = run(Icp(self._problem(), method), Pose(*self.frames.to_centred(T)), ENGINE)
        R, t = np.asarray(found.pose.rotation, np.float64), np.asarray(found.pose.translation)
        finite = np.asarray(np.isfinite(R).all(axis=(1, 2)) & np.isfinite(t).all(axis=1))
        R = quaternion_to_rotation(rotation_to_quaternion(np.where(finite[:, None, None], R, np.eye(3))))
        return np.where(finite[:, None, None], self.frames.from_centred(R, np.where(finite[:, None], t, 0.0)), T)

    def _problem(self) -> Problem:
        side, asked = self.target.side, self.source.side
        box = np.stack([side.points.min(axis=1), side.points.max(axis=1)])
        return Problem(
            source=asked.sample,
            mask=asked.mask,
            count=np.asarray(asked.mask.sum(), np.float32),
            target=side.points,
            target_mask=np.arange(side.points.shape[1]) < len(self.target.thin),
            normals=side.normals,
            border=np.zeros(side.points.shape[1], bool),
            box=box,
            resolution=np.asarray(0.01 * self.length, np.float32),
            size=np.asarray(self.length, np.float32),
            reach=np.stack([np.abs(asked.sample).max(), np.abs(box).max()]),
            fast_table=side.table,
            exact_table=None,
        )


def distinct(
    found: Candidates, count: int, centre: Float[np.ndarray, "3"], turn_deg: float, shift: float
) -> Int[np.ndarray, " k"]:
    """Rows of the best ``count`` poses none of which is a better one over again.

    Two are the same when they differ by less than ``turn_deg`` and put ``centre`` less than ``shift`` apart.
    """
    T, left = found.T_target_source, np.argsort(-found.score, kind="stable")
    placed = T[:, :3, :3] @ centre + T[:, :3, 3]
    chosen: list[int] = []
    while len(left) and len(chosen) < count:
        first, left = int(left[0]), left[1:]
        chosen.append(first)
        turned = rotation_angle_deg(np.swapaxes(T[left, :3, :3], 1, 2) @ T[first, :3, :3])
        same = (turned < turn_deg) & (np.linalg.norm(placed[left] - placed[first], axis=1) < shift)
        left = left[~same]
    return np.asarray(chosen, dtype=np.int64)
