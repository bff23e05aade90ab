"""The draws of ``hand_eye_self_calibration``: what each of its questions measures on simulated robots and motions."""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from jaxmodel.calibrate import Outcome, Scales, self_calibrate, simulation, solve
from jaxmodel.calibrate import simulated_robot as robot
from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.methods import PUBLISHED, all_solved, solved
from jaxmodel.run.hand_eye.protocol import MOST, Bench, Realisation, padded, padded_length, references
from jaxmodel.run.hand_eye.study import Measured

SELF, OWN = "self-calibration", "self-calibration on the target's points"
METHODS = (*PUBLISHED, SELF)
"""Methods 1 to 5 of the report; before an unknown scene the fifth sees that scene, else the target's points."""
FAR = "trajectory 1"
RUNS = {FAR: "4.1", "4 positions": "4.4", "9 positions": "4.4"}
COMPARED = {run: METHODS if run == FAR else (*METHODS, OWN) for run in RUNS}
_UNKNOWN = 2.7
"""The factor by which every reconstruction is too small; the answer does not depend on it."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """The YAML of the experiment.

    ``near_deg``: between the 9 near positions. ``scene``: unknown points, ``scene_size``: standard deviation of their
    coordinates. ``angles_deg``: range of the 30 motions that
    the scale is found from, at relative noise ``noise``. ``pure``: sets of pure rotations, exact and noisy.
    """

    experiment: Literal["hand_eye_self_calibration"] = "hand_eye_self_calibration"
    seed: int = 0
    draws: int = 100
    chunk: int = 50
    bench: Bench = field(default_factory=Bench)
    near_deg: float = 6.0
    scene: int = 60
    scene_size: float = 0.12
    scales: tuple[float, ...] = (0.5, 0.8, 1.0, 1.25, 2.0)
    angles_deg: tuple[tuple[float, float], ...] = ((15.0, 30.0), (1.5, 3.0))
    motions: int = 30
    noise: float = 0.01
    pure: int = 20
    resamples: int = 2000

    def __post_init__(self) -> None:
        least = {"seed": 0, "draws": 2, "chunk": 1, "scene": 8, "motions": 2, "pure": 1, "resamples": 100}
        for name, smallest in least.items():
            if getattr(self, name) < smallest:
                raise ValueError(f"{name} is {getattr(self, name)}, expected {smallest} or more")
        if not self.scene_size > 0:
            raise ValueError(f"scene_size is {self.scene_size}, expected above 0")
        if self.motions > MOST or not self.scales or min(self.scales) <= 0 or not self.angles_deg:
            raise ValueError(f"expected at most {MOST} motions, scales above 0, and at least one range of angles_deg")

    @property
    def length(self) -> int:
        """Motions of a padded problem, the same in all cells."""
        return padded_length(max(self.bench.positions - 1, self.motions))


def protocol(config: Config, first: int, count: int) -> Measured:
    """Errors to the reference of methods 1 to 4 with the target, and of self-calibration without it."""
    target, scene, own = ({run: [] for run in RUNS} for _ in range(3))
    X = []
    for draw in range(first, first + count):
        one = Realisation(config.bench, config.seed, draw)
        X.append(one.X)
        near = robot.near_positions(one.uniforms(9), np.radians(config.near_deg), one.T_hand_camera)
        ways = {FAR: one.far(config.bench.positions), "4 positions": one.far(4), "9 positions": near}
        for run, hand in ways.items():
            measured, camera = one.measured_hand(hand), one.by_target(hand)
            target[run].append((measured, camera))
            own[run].append((measured, one.by_reconstruction(hand)))
            if run != FAR:  # the same way driven once more
                points = config.scene_size * one.normals(3 * config.scene).reshape(-1, 3).clip(-2, 2)
                scene[run].append((one.measured_hand(hand), one.by_reconstruction(hand, points)))
    reference = references(config.bench, target[FAR], config.seed, first)
    errors = {"reference, truth": simulation.errors(reference, np.stack(X))}
    for run in RUNS:
        for method, found in all_solved(PUBLISHED, *padded(target[run], config.length)).items():
            errors[f"{run}, {method}"] = simulation.errors(found, reference)
        for method in COMPARED[run][len(PUBLISHED) :]:
            seen = scene[run] if method == SELF and run != FAR else own[run]
            A, B, mask = padded(seen, config.length)
            A[:, :, :3, 3] /= _UNKNOWN
            found, _ = solved("linear", A, B, mask, unknown_scale=True)
            errors[f"{run}, {method}"] = simulation.errors(found, reference)
    return Measured(claims.error_columns(errors))


class _Drawn(NamedTuple):
    """X and motions of a batch, padded with identities, and normals for their noise."""

    X: Float[np.ndarray, "b 4 4"]
    A: Float[np.ndarray, "b n 4 4"]
    B: Float[np.ndarray, "b n 4 4"]
    mask: Bool[np.ndarray, "b n"]
    noise: Float[np.ndarray, "b n 6"]


def _motions(config: Config, stream: int, first: int, count: int, angles_deg: tuple[float, float]) -> _Drawn:
    """Random motions whose angles fill a range."""
    n = config.length
    drawn = simulation.normals(config.seed, stream, first, count, 6 + 13 * n)
    X, rest = simulation.rigid(drawn[:, :6], 1.0, 1.0), drawn[:, 6:].reshape(count, n, 13)
    axis = rest[..., :3] / np.linalg.norm(rest[..., :3], axis=-1, keepdims=True)
    low, high = np.radians(angles_deg)
    share = np.mod(rest[..., 6:7], 1.0)
    turn = Rotation.from_rotvec(((low + (high - low) * share) * axis).reshape(-1, 3)).as_matrix()
    B = np.tile(np.eye(4), (count, n, 1, 1))
    B[..., :3, :3], B[..., :3, 3] = turn.reshape(count, n, 3, 3), rest[..., 3:6]
    B[:, config.motions :] = np.eye(4)
    mask = np.broadcast_to(np.arange(n) < config.motions, (count, n))
    return _Drawn(X, simulation.conjugate(X, B), B, mask, rest[..., 7:])


def bias(config: Config, scale: float, first: int, count: int) -> Measured:
    """Exact motions whose camera translations are too small by ``scale``: the classic linear answer and §4.1's bias."""
    X, A, B, mask, _ = _motions(config, 20, first, count, config.angles_deg[0])
    given = A.copy()
    given[..., :3, 3] /= scale
    classic, _ = solved("linear", given, B, mask)
    own, found = solved("linear", given, B, mask, unknown_scale=True)
    left = (A[..., :3, :3] - np.eye(3)).reshape(count, -1, 3)
    wrong = ((1 - 1 / scale) * A[..., :3, 3]).reshape(count, -1)
    predicted = np.stack([np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(left, wrong, strict=True)])
    off = classic[:, :3, 3] - X[:, :3, 3]
    size = np.linalg.norm(X[:, :3, 3], axis=1)
    return Measured(
        {
            "bias": np.linalg.norm(off, axis=1) / size,
            "unpredicted": np.linalg.norm(off - predicted, axis=1) / size,
            "classic rotation (deg)": simulation.errors(classic, X)[0],
            "self translation": simulation.errors(own, X)[1],
            "scale error": np.abs(found / scale - 1),
        }
    )


def scale_error(config: Config, angles_deg: tuple[float, float], number: int, first: int, count: int) -> Measured:
    """Scale and X from ``motions`` motions at the report's noise: the linear method, and refined."""
    X, A, B, mask, drawn = _motions(config, 30 + number, first, count, angles_deg)
    A = simulation.with_report_noise(A, config.noise, drawn)
    A[..., :3, 3] /= _UNKNOWN
    n = config.motions
    refined = [self_calibrate(a[:n], b[:n], Scales.COMMON) for a, b in zip(A, B, strict=True)]
    found = {
        "linear": solved("linear", A, B, mask, unknown_scale=True),
        "refined": (np.stack([one.X for one in refined]), np.array([one.scale[0] for one in refined])),
    }
    columns = {}
    for method, (found_X, scale) in found.items():
        angle, shift = simulation.errors(found_X, X)
        columns |= {f"{method} scale error": np.abs(scale / _UNKNOWN - 1), f"{method} translation": shift,
                    f"{method} rotation (deg)": angle}  # fmt: skip
    return Measured(columns)


def pure_rotations(config: Config, noise: float, first: int, count: int) -> Measured:
    """Pure rotations of the robot: told by self-calibration, enough for calibration with the target."""
    X, _, B, _, drawn = _motions(config, 40, first, count, config.angles_deg[0])
    B[..., :3, 3] = 0.0
    A = simulation.with_report_noise(simulation.conjugate(X, B), noise, drawn)
    tied, whole = [], []
    for a, b in zip(A[:, : config.motions], B[:, : config.motions], strict=True):
        whole.append(solve(a, b).outcome is Outcome.SOLVED)
        small = a.copy()
        small[:, :3, 3] /= _UNKNOWN
        tied.append(self_calibrate(small, b, Scales.COMMON).outcome is Outcome.SCALE_TIED)
    return Measured({"tied": np.array(tied, float), "solved with the target": np.array(whole, float)})
