"""Why an answer is recommended, and what speaks against trusting its covariance, in words."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

from jaxmodel.calibrate.loss import contradicts
from jaxmodel.calibrate.resampling import differences
from jaxmodel.calibrate.trust import Finding
from jaxmodel.run.calibration.config import Config

if TYPE_CHECKING:
    from jaxmodel.run.calibration.answers import Answers


def reason_for(found: "Answers", config: Config) -> str:
    """One sentence on the choice, and one more where the methods or the data disagree with its deviation."""
    answer = found.recommended
    if not answer.outcome.usable:
        return f"no method determines more: {answer.outcome.sentence}"
    if config.method not in ("all", "joint"):
        return f"{answer.method} is the only method that was asked for"
    words = "it uses each absolute pose once, where pairs of poses count it many times, and knows its own covariance"
    wrong = int(found.outlier.sum())
    if not found.kept.all():
        words += f"; {wrong} of {len(found.kept)} poses contradict the others and are left out"
    elif config.loss != "none":
        words += (
            f"; the loss {config.loss} weighs down {int(np.sum(contradicts(weights_of(found), config.loss)))} of "
            f"{len(found.kept)} poses"
        )
    if found.noise == "depth":
        words += "; the camera's error along the line of sight differs from that across it and is weighed apart"
    doubts = [*_disagreement(found), *([] if found.trust is None or not found.trust.findings else [_widening(found)])]
    return "; ".join([words, *doubts])


def weights_of(found: "Answers") -> np.ndarray:
    """What a robust loss makes of each pose; 1 without one."""
    weights = found.recommended.weights
    return np.ones(len(found.kept)) if weights is None else weights


def finding_sentence(finding: Finding) -> str:
    """What one look at the data shows, for the notes."""
    turn, shift = np.linalg.norm(finding.shift[:3]), np.linalg.norm(finding.shift[3:])
    away = f"{1e3 * shift:.1f} mm and {np.degrees(turn):.2f} degrees"
    if finding.cause == "scale":
        return (
            f"the camera's lengths would fit the hand's better times {finding.size:.4g} (standard deviation "
            f"{finding.deviation:.2g}), which moves the answer by {away}: check the size of the target's squares, the "
            "units of both streams and the camera's focal length, or let the hand say it with --unknown-scale"
        )
    if finding.cause == "pairs":
        return (
            f"the linear method on all pairs is {away} away, {finding.size:.1f} times as far as the noise explains: "
            "some errors are shared by many poses (lens, target, robot)"
        )
    return (
        f"parts of the workspace disagree {finding.size:.1f} times as much as the noise explains: errors are shared by "
        "neighbouring poses"
    )


def _widening(found: "Answers") -> str:
    assert found.trust is not None
    model, stated = (1e3 * np.sqrt(np.trace(C[3:, 3:])) for C in (found.trust.model, found.trust.covariance))
    return (
        f"the data show more than the noise explains (see the notes), so the deviation stated is {stated:.1f} mm in "
        f"all where the noise alone gives {model:.1f} mm"
    )


def _disagreement(found: "Answers") -> list[str]:
    """A sentence where half of the other methods lie outside the stated 95 % of the answer."""
    covariance, name = found.covariance, found.setup.x_name
    others = [
        one.transforms[name] for one in found.answers[1:] if one.outcome.usable and not one.method.startswith("joint")
    ]
    if covariance is None or len(others) < 3:
        return []
    d = differences(np.stack(others), found.recommended.transforms[name])
    times = student.ppf(0.975, max(found.recommended.freedom, 1.0))
    turn, shift = (np.median(np.linalg.norm(d[:, part], axis=1)) for part in (slice(3), slice(3, 6)))
    limits = [times * np.sqrt(np.trace(covariance[part, part])) for part in (slice(3), slice(3, 6))]
    if turn <= limits[0] and shift <= limits[1]:
        return []
    return [
        f"half of the other methods lie more than {1e3 * shift:.1f} mm or {np.degrees(turn):.2f} degrees away, outside "
        f"of what the stated deviation allows ({1e3 * limits[1]:.1f} mm, {np.degrees(limits[0]):.2f} degrees)"
    ]
