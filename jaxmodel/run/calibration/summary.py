"""What a calibration found as plain trees: ``summary.json`` and ``calibration.json``."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from jaxmodel.calibrate.errors import expected_error
from jaxmodel.calibrate.motions import excitation
from jaxmodel.calibrate.observability import Observability
from jaxmodel.calibrate.resampling import differences
from jaxmodel.geometry import se3
from jaxmodel.run.calibration.answers import Answer, Answers
from jaxmodel.run.calibration.config import Config
from jaxmodel.run.calibration.paired_poses import PairedPoses
from jaxmodel.run.calibration.remarks import remarks

CONFIDENCE = 0.95


def summarise(config: Config, poses: PairedPoses, found: Answers) -> dict[str, Any]:
    """The content of ``summary.json``: all methods, their disagreement, the verdict and the recommended answer."""
    name = found.setup.x_name
    reference = found.recommended.transforms[name]
    X = np.stack([answer.transforms[name] for answer in found.answers])
    angle, distance = disagreement(X)
    position = [answer.method for answer in found.answers].index(found.recommended.method)
    hand_motions = excitation(found.motions.B)
    return {
        "experiment": "calibration",
        "setup": found.setup.value,
        "setup_sentence": found.setup.sentence,
        "transform": name,
        "poses": len(poses.hand),
        "motions": len(found.motions.A),
        "scales": config.scales,
        "noise": found.noise,
        "loss": config.loss,
        "methods": [
            _method(answer, name, angle[position, k], distance[position, k]) for k, answer in enumerate(found.answers)
        ],
        "disagreement": {
            "methods": [answer.method for answer in found.answers],
            "angle_deg": angle,
            "distance_m": distance,
        },
        "observability": _verdict(found.recommended, reference),
        "excitation": {
            "angle_deg": hand_motions.angles_deg,
            "length_m": hand_motions.lengths,
            "axis_spread": hand_motions.axis_spread,
        },
        "recommended": calibration(config, poses, found),
        "outliers": _outliers(poses, found),
        "influence": _influence(poses, found),
        "synchronisation": _synchronisation(poses),
        "notes": [*poses.notes, *remarks(found)],
    }


def calibration(config: Config, poses: PairedPoses, found: Answers) -> dict[str, Any]:
    """The content of ``calibration.json``: the recommended answer, its frames, uncertainty and reason."""
    answer, name = found.recommended, found.setup.x_name
    distance = config.working_distance
    if distance is None:
        distance = float(
            np.nan_to_num(answer.scale[0], nan=1.0) * np.median(np.linalg.norm(poses.camera[:, :3, 3], axis=1))
        )
    tree: dict[str, Any] = {
        "setup": found.setup.value,
        "unit": "metre, radian unless a name says otherwise; T_a_b maps coordinates in b to a",
        "method": answer.method,
        "reason": found.reason,
        "outcome": answer.outcome.name.lower(),
        "sentence": answer.outcome.sentence,
        "usable": answer.outcome.usable,
        **answer.transforms,
        "forms": {name: _forms(T) for name, T in answer.transforms.items()},
        "scale": _scales(config, poses, answer),
        "scale_deviation": float(answer.scale_deviation[0]) if config.scales == "one" else None,
        "covariance": None,
        "deviation": None,
        "expected_error": None,
        "bootstrap_covariance": found.bootstrap,
        "outliers": [poses.places[k] for k in np.flatnonzero(found.outlier)],
    }
    covariance, looked = found.covariance, found.trust
    if covariance is not None:
        deviation = np.sqrt(np.diag(covariance))
        tree["covariance"] = {
            "of": name,
            "order": "rotation x y z (rad), translation x y z (m): R <- exp(d) R, t <- t + e",
            "matrix": covariance,
            "of_the_noise_alone": answer.covariance,
            "jackknife": None if looked is None else looked.spread,
            "widened_by": [] if looked is None else list(dict.fromkeys(one.cause for one in looked.findings)),
            "freedom": answer.freedom,
        }
        tree["deviation"] = {
            "rotation_deg": np.degrees(deviation[:3]),
            "translation_m": deviation[3:],
            **_weakest(covariance[3:, 3:]),
            "student_95": float(student.ppf((1 + CONFIDENCE) / 2, max(answer.freedom, 1.0))),
        }
        tree["expected_error"] = {
            "working_distance_m": distance,
            "given": config.working_distance is not None,
            "rms_m": expected_error(covariance, answer.transforms[name], distance, answer.freedom),
        }
    return tree


def disagreement(
    X: Float[np.ndarray, "k 4 4"],
) -> tuple[Float[np.ndarray, "k k"], Float[np.ndarray, "k k"]]:
    """Angle (deg) and distance between every two answers."""
    pairs = [differences(X, one) for one in X]
    return (
        np.degrees(np.array([np.linalg.norm(pair[:, :3], axis=1) for pair in pairs])),
        np.array([np.linalg.norm(pair[:, 3:], axis=1) for pair in pairs]),
    )


def _weakest(covariance: Float[np.ndarray, "3 3"]) -> dict[str, Any]:
    """The direction in which the translation is known worst, with its standard deviation there."""
    values, vectors = np.linalg.eigh(covariance)
    return {"worst_direction": vectors[:, 2], "worst_m": float(np.sqrt(max(values[2], 0.0)))}


def _forms(T: np.ndarray) -> dict[str, Any]:
    turn = Rotation.from_matrix(T[:3, :3])
    return {"translation": T[:3, 3], "quaternion_xyzw": turn.as_quat(), "rotation_vector": turn.as_rotvec()}


def _scales(config: Config, poses: PairedPoses, answer: Answer) -> Any:
    """One number, or one for each group or motion, with its deviation where it is known."""
    if config.scales in ("known", "one"):
        return float(answer.scale[0])
    names = [str(k) for k in range(len(answer.scale))]
    if config.scales == "per-group" and poses.groups is not None:
        names = [str(name) for name in sorted({g for g in poses.groups if poses.groups.count(g) > 1})]
    return {
        name: {"value": float(value), "deviation": float(deviation)}
        for name, value, deviation in zip(names, answer.scale, answer.scale_deviation, strict=True)
    }


def _method(answer: Answer, name: str, angle_deg: float, distance_m: float) -> dict[str, Any]:
    turns, shifts = np.degrees(answer.pair_rotation), answer.pair_translation
    return {
        "method": answer.method,
        "outcome": answer.outcome.name.lower(),
        "sentence": answer.outcome.sentence,
        name: answer.transforms[name],
        **_forms(answer.transforms[name]),
        "scale": answer.scale,
        "steps": answer.steps,
        "pairs": _spread(turns, shifts),
        "poses": _spread(np.degrees(answer.pose_rotation), answer.pose_translation),
        "from_recommended": {"angle_deg": angle_deg, "distance_m": distance_m},
    }


def _spread(turns_deg: np.ndarray, shifts_m: np.ndarray) -> dict[str, float] | None:
    """Medians and root mean squares; ``None`` where there is nothing to measure."""
    if len(turns_deg) == 0:
        return None
    return {
        "median_rotation_deg": float(np.median(turns_deg)),
        "median_translation_m": float(np.median(shifts_m)),
        "rms_rotation_deg": float(np.sqrt(np.mean(turns_deg**2))),
        "rms_translation_m": float(np.sqrt(np.mean(shifts_m**2))),
    }


def _verdict(answer: Answer, X: np.ndarray) -> dict[str, Any]:
    """What the motions determine, directions in the frame of the translation (the hand's, or the base's)."""
    tree: dict[str, Any] = {"outcome": answer.outcome.name.lower(), "sentence": answer.outcome.sentence}
    seen: Observability | None = answer.observability
    if seen is None:
        return tree
    for key, direction in (("free_direction", seen.free_direction), ("free_axis", seen.free_axis)):
        tree[key] = None if direction is None else X[:3, :3] @ direction
    return tree | {
        "independent_axes": seen.independent_axes,
        "linear_rank": seen.linear_rank,
        "alternatives": [se3.inverse(other) for other in seen.alternatives],
        "rotation_noise_deg": float(np.degrees(seen.rotation_noise)),
        "translation_noise_m": seen.translation_noise,
    }


def _outliers(poses: PairedPoses, found: Answers) -> list[dict[str, Any]]:
    answer = found.recommended
    return [
        {
            "pose": int(k),
            "place": poses.places[k],
            "score": float(found.score[k]),
            "rotation_residual_deg": float(np.degrees(answer.pose_rotation[k])),
            "translation_residual_m": float(answer.pose_translation[k]),
        }
        for k in np.flatnonzero(found.outlier)
    ]


def _influence(poses: PairedPoses, found: Answers) -> list[dict[str, Any]]:
    """Poses by how much the answer moves without them, the most first."""
    turn, shift = np.linalg.norm(found.left_out[:, :3], axis=1), np.linalg.norm(found.left_out[:, 3:], axis=1)
    known = np.flatnonzero(np.isfinite(shift))
    cook = found.recommended.influence
    return [
        {
            "pose": int(k),
            "place": poses.places[k],
            "angle_deg": float(np.degrees(turn[k])),
            "distance_m": float(shift[k]),
            "influence": None if cook is None else float(cook[k]),
        }
        for k in known[np.argsort(-shift[known], kind="stable")]
    ]


def _synchronisation(poses: PairedPoses) -> dict[str, Any] | None:
    both = poses.synchronised
    if both is None:
        return None
    return {
        "offset_s": both.offset_s,
        "sentence": f"the hand is read at the camera's time {both.offset_s:+.4f} s",
        "angle_error_deg": both.angle_error_deg,
        "sharpness": both.sharpness,
    }
