"""What the residuals of a calibration say against its files or options."""

import numpy as np
from scipy.stats import t as student

from jaxmodel.geometry import se3
from jaxmodel.run.calibration_answers import Answers

DOUBTFUL = 5.0
"""Methods that lie further apart than so many standard deviations are remarked on."""
LENGTHS_DIFFER, CHANCE = 0.01, 1e-4
"""The camera's lengths are remarked on where they differ so much from the hand's, and chance does that so rarely."""


def remarks(found: Answers) -> list[str]:
    """Sentences for whoever made the files."""
    notes = []
    A, B = (np.radians(se3.rotation_angle_deg(T[:, :3, :3])) for T in (found.motions.A, found.motions.B))
    typical = float(np.median(np.maximum(A, B)))
    if typical > 0 and float(np.median(np.abs(A - B))) > 0.2 * typical:
        notes.append(
            "the two streams do not turn by the same angles, which no calibration changes: look at the pairing of the "
            "rows, the kind and order of the rotations and their unit"
        )
    elif len(A) > 2:
        left = float(np.median(found.recommended.pair_rotation))
        if left > 0.2 * typical:
            notes.append(
                f"the streams turn by the same angles but not about axes that fit ({np.degrees(left):.1f} degrees are "
                "left): is the set-up right, and are the poses T_base_hand and T_camera_target, not their inverses?"
            )
    if found.outlier.any() and found.kept.all():
        notes.append(f"{int(found.outlier.sum())} of {len(found.kept)} poses contradict the others, but all are used")
    lengths = _lengths(found)
    if lengths:
        notes.append(lengths)
    covariance = found.recommended.covariance
    if covariance is not None and found.setup.x_name in found.recommended.transforms:
        expected = float(np.sqrt(np.trace(covariance[3:, 3:])))
        X = np.stack([answer.transforms[found.setup.x_name] for answer in found.answers])
        apart = np.linalg.norm(X[:, :3, 3] - found.recommended.transforms[found.setup.x_name][:3, 3], axis=1)
        if len(X) > 2 and float(np.median(apart)) > DOUBTFUL * expected:
            notes.append(
                f"the methods are {1e3 * np.median(apart):.1f} mm apart (median) where the standard deviation is "
                f"{1e3 * expected:.1f} mm: the poses have systematic errors, or so much noise that it biases the "
                "methods on pairs; take the deviation with care"
            )
    return notes


def _lengths(found: Answers) -> str | None:
    """Whether the hand's lengths contradict the camera's, by the scale that fits best and its deviation."""
    free = found.rescaled
    if free is None or not free.outcome.usable or not free.scale > 0 or not free.scale_deviation > 0:
        return None
    away = abs(np.log(free.scale))
    chance = 2 * student.sf(away * free.scale / free.scale_deviation, max(free.freedom, 1.0))
    if away < LENGTHS_DIFFER or chance > CHANCE:
        return None
    shift = np.linalg.norm(free.X[:3, 3] - found.recommended.transforms[found.setup.x_name][:3, 3])
    return (
        f"the camera's lengths would fit the hand's better times {free.scale:.4g} (standard deviation "
        f"{free.scale_deviation:.2g}), which moves the answer by {1e3 * shift:.1f} mm: check the size of the target's "
        "squares, the units of both streams and the camera's focal length, or let the hand say it with --unknown-scale"
    )
