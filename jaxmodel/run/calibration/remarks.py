"""What the residuals of a calibration say against its files or options."""

import numpy as np

from jaxmodel.geometry import se3
from jaxmodel.run.calibration.answers import Answers
from jaxmodel.run.calibration.reason import finding_sentence


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
    return notes + [finding_sentence(finding) for finding in found.findings]
