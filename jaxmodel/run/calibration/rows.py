"""What a calibration found as tables: a row for each method and pose, and for each method and motion."""

import numpy as np
import polars
from scipy.spatial.transform import Rotation

from jaxmodel.geometry import se3
from jaxmodel.run.calibration.answers import Answers
from jaxmodel.run.calibration.paired_poses import PairedPoses


def pose_rows(poses: PairedPoses, found: Answers) -> polars.DataFrame:
    """``results.parquet``: a row for each method and pose; influence and leave-one-out with the recommended method."""
    n, tables = len(poses.hand), []
    none = np.full(n, np.nan)
    turn, shift = np.linalg.norm(found.left_out[:, :3], axis=1), np.linalg.norm(found.left_out[:, 3:], axis=1)
    for answer in found.answers:
        known, chosen = len(answer.pose_rotation) == n, answer is found.recommended
        tables.append(
            polars.DataFrame(
                {
                    "method": [answer.method] * n,
                    "pose": np.arange(n),
                    "place": poses.places,
                    "rotation_residual_deg": np.degrees(answer.pose_rotation) if known else none,
                    "translation_residual_m": answer.pose_translation if known else none,
                    "outlier": found.outlier,
                    "score": found.score,
                    "influence": none if answer.influence is None else answer.influence,
                    "left_out_angle_deg": np.degrees(turn) if chosen else none,
                    "left_out_distance_m": shift if chosen else none,
                }
            ).fill_nan(None)
        )
    return polars.concat(tables, how="vertical")


def motion_rows(found: Answers) -> polars.DataFrame:
    """``motions.parquet``: a row for each method and motion, with the hand's rotation axis in its own frame."""
    B, index = se3.inverse(found.motions.B), found.motions.index
    turn = Rotation.from_matrix(B[:, :3, :3]).as_rotvec()
    angle = np.linalg.norm(turn, axis=1)
    axis = turn / np.maximum(angle, 1e-300)[:, None]
    fixed = {
        "first": index[:, 0],
        "second": index[:, 1],
        "angle_deg": np.degrees(angle),
        **{f"axis_{letter}": axis[:, k] for k, letter in enumerate("xyz")},
        "length_m": np.linalg.norm(B[:, :3, 3], axis=1),
    }
    return polars.concat(
        [
            polars.DataFrame(
                {
                    "method": [answer.method] * len(index),
                    **fixed,
                    "rotation_residual_deg": np.degrees(answer.pair_rotation),
                    "translation_residual_m": answer.pair_translation,
                }
            )
            for answer in found.answers
        ],
        how="vertical",
    )
