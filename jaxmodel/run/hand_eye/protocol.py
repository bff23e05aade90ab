"""The report's experimental protocol (RR-3507 §3.6, 4.3) on simulated robots: realisations, and their reference.

The report knows no true X: its reference is the robust mean of many calibrations, each from k images drawn out of the
first trajectory's. Here the truth is known too, and the reference's own error is reported.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from jaxmodel.calibrate import simulated_robot as robot
from jaxmodel.calibrate import simulation, solve_many
from jaxmodel.calibrate.averaging import average
from jaxmodel.calibrate.errors import quaternion_error
from jaxmodel.calibrate.rigid import checked_motions
from jaxmodel.geometry import se3

MOST = 64
"""Motions of a run at most."""
SMALLEST = 16
"""Motions of a problem that is padded to fewer: two lengths in all, so that few programs are compiled."""
_DRAWS = 4000  # standard normals of one realisation


@dataclass(frozen=True)
class Bench:
    """The simulated robot and camera; lengths in metres, angles in degrees, image quantities in pixels.

    ``hand_deg`` and ``hand_length``: errors of the robot's own poses. ``offset``: standard deviation of X's
    coordinates. ``reference_draws`` calibrations from ``reference_images`` images each make the reference.
    """

    focal: float = 800.0
    pixel_noise: float = 0.3
    hand_deg: float = 0.02
    hand_length: float = 0.0002
    offset: float = 0.06
    pan_deg: float = 60.0
    tilt_deg: float = 40.0
    positions: int = 33
    reference_draws: int = 100
    reference_images: int = 10

    def __post_init__(self) -> None:
        for name in ("focal", "pixel_noise", "offset", "pan_deg", "tilt_deg"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, expected above 0")
        for name in ("hand_deg", "hand_length"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 0 or above")
        if not 4 <= self.positions <= MOST or self.reference_draws < 2:
            raise ValueError(f"expected 4 to {MOST} positions and at least 2 reference_draws")
        most = min(SMALLEST + 1, self.positions)
        if not 4 <= self.reference_images <= most:
            raise ValueError(f"reference_images is {self.reference_images}, expected 4 to {most}")

    @property
    def sentence(self) -> str:
        """The choices in words."""
        return (
            f"simulated five-axis Cartesian robot, target 0.5 m away, |t_X| of {self.offset:g} m a coordinate, focal "
            f"length {self.focal:g} px, points measured to {self.pixel_noise:g} px, robot's poses to "
            f"{self.hand_deg:g}° and {1000 * self.hand_length:g} mm, reference: {self.reference_draws} draws "
            f"of {self.reference_images} of {self.positions} images, linear method, roll-pitch-yaw by Huber's weights"
        )


class Motions(NamedTuple):
    """Motions of a batch padded to one length: camera, hand, which are there."""

    A: Float[np.ndarray, "b n 4 4"]
    B: Float[np.ndarray, "b n 4 4"]
    mask: Float[np.ndarray, "b n"]


class Realisation:
    """One robot with its X and everything drawn for it; ``X`` is AX = XB's, T_camera_hand."""

    def __init__(self, bench: Bench, seed: int, draw: int) -> None:
        self.bench, self.image = bench, robot.Image(bench.focal, bench.pixel_noise)
        self._drawn = simulation.normals(seed, 7, draw, 1, _DRAWS)[0]
        self._next = 0
        self.T_hand_camera = simulation.rigid(self.normals(6), 1.0, bench.offset)
        self.X = se3.inverse(self.T_hand_camera)

    def normals(self, count: int) -> Float[np.ndarray, " count"]:
        """The next so many of the realisation's normals."""
        self._next += count
        assert self._next <= _DRAWS
        return self._drawn[self._next - count : self._next]

    def uniforms(self, rows: int) -> Float[np.ndarray, "rows 3"]:
        return ndtr(self.normals(3 * rows).reshape(rows, 3))

    def far(self, count: int) -> Float[np.ndarray, "c 4 4"]:
        reach = np.radians(self.bench.pan_deg), np.radians(self.bench.tilt_deg)
        return robot.far_positions(self.uniforms(4 * count), count, self.T_hand_camera, reach)

    def measured_hand(self, hand: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n 4 4"]:
        """The robot's poses as it reports them."""
        error = self.normals(6 * len(hand)).reshape(-1, 6)
        wrong = simulation.rigid(error, np.radians(self.bench.hand_deg), 1.0)
        wrong[:, :3, 3] *= self.bench.hand_length
        return hand @ wrong

    def by_target(self, hand: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n 4 4"]:
        """Camera poses from images of the target, its model known."""
        camera = robot.camera_poses(hand, self.T_hand_camera)
        return robot.seen(camera, robot.board(camera), self.image, self.normals(6 * len(hand)), True)

    def by_reconstruction(
        self, hand: Float[np.ndarray, "n 4 4"], points: Float[np.ndarray, "m 3"] | None = None
    ) -> Float[np.ndarray, "n 4 4"]:
        """Camera poses by reconstruction of a scene of unknown points (the target's where none are given)."""
        camera = robot.camera_poses(hand, self.T_hand_camera)
        points = robot.board(camera) if points is None else points
        return robot.seen(camera, points, self.image, self.normals(6 * len(hand)), False)


def padded_length(motions: int) -> int:
    """To how many motions problems of at most ``motions`` are padded: one of two lengths."""
    return SMALLEST if motions <= SMALLEST else MOST


def padded(runs: list[tuple[np.ndarray, np.ndarray]], most: int) -> Motions:
    """Motions between neighbours of each (hand, camera) run, padded with identities to ``most`` of them."""
    A, B = np.tile(np.eye(4), (2, len(runs), most, 1, 1))
    mask = np.zeros((len(runs), most), bool)
    for row, (hand, camera) in enumerate(runs):
        n = len(hand) - 1
        A[row, :n], B[row, :n] = robot.consecutive(camera, True), robot.consecutive(hand, False)
        mask[row, :n] = True
    return Motions(A, B, mask)


def references(
    bench: Bench, runs: list[tuple[np.ndarray, np.ndarray]], seed: int, first: int
) -> Float[np.ndarray, "b 4 4"]:
    """The robust mean of many calibrations from k of each run's images (§3.3, 3.6.1)."""
    found = []
    for row, (hand, camera) in enumerate(runs):
        chooser = np.random.default_rng([seed, first + row])
        picks = [
            np.sort(chooser.permutation(len(hand))[: bench.reference_images]) for _ in range(bench.reference_draws)
        ]
        motions = padded([(hand[pick], camera[pick]) for pick in picks], SMALLEST)
        X = solve_many(*motions, "linear", verdict=False).X
        found.append(average(checked_motions(X, "X"), "roll_pitch_yaw", "huber_weights"))
    return np.stack(found)


def deviations(
    motions: Motions, X: Float[np.ndarray, "b 4 4"]
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, " b"]]:
    """Mean over a run's motions of how far AX is from XB, by the measures of §3.4 (Figs 3.8 to 3.11)."""
    left, right = motions.A @ X[:, None], X[:, None] @ motions.B
    angle = se3.rotation_angle_deg(left[..., :3, :3] @ np.swapaxes(right[..., :3, :3], -1, -2))
    shift = np.linalg.norm(left[..., :3, 3] - right[..., :3, 3], axis=-1) / np.linalg.norm(right[..., :3, 3], axis=-1)
    count = motions.mask.sum(axis=1)
    rotation = np.where(motions.mask, quaternion_error(angle), 0.0)
    return rotation.sum(axis=1) / count, np.where(motions.mask, shift, 0.0).sum(axis=1) / count


def spread(values: Float[np.ndarray, " n"]) -> dict[str, Any]:
    """Median, and the range that holds 90 % of the realisations."""
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {"value": float(middle), "low": float(low), "high": float(high)}


def shown(of: dict[str, Any]) -> str:
    """``1.2e-05 (3e-06 to 5e-05)``."""
    return f"{of['value']:.2g} ({of['low']:.2g} to {of['high']:.2g})"


def agreement(published: float | None, of: dict[str, Any]) -> tuple[str, str, str]:
    """A published value, ours, and whether the published one lies in the range of 90 % of our realisations."""
    if published is None:
        return "none", shown(of), ""
    where = "below ours" if published < of["low"] else "above ours" if published > of["high"] else "in our 90 %"
    return f"{published:.3g}", shown(of), where
