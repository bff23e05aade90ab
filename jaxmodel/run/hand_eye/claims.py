"""What RR-3507 says of its methods, put to the test: ratios of errors over the same draws, with 95 % intervals.

Two measures, for they can disagree: the report's RMS, which a few bad draws decide, and the typical ratio, the
geometric mean of the ratios of single draws.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars
from jaxtyping import Float

from jaxmodel.calibrate.errors import quaternion_error, root_mean_square
from jaxmodel.view.table import Table

ROTATION, TRANSLATION = "rotation_deg", "translation"
_LEAST = 1e-14
Z95 = 1.96
NO_WORSE = 1.1
"""Up to here a method is called no worse than another."""


class Claim(NamedTuple):
    """``better`` has the smaller error of the two; several levels (noise, motions) are averaged.

    ``margin``: the ratio of errors that the claim allows, 1 for "better", ``NO_WORSE`` for "no worse".
    """

    says: str
    quantity: str
    better: str
    worse: str
    margin: float = 1.0


def column(method: str, quantity: str) -> str:
    """Name of a method's error in the table of results."""
    return f"{method}: {quantity}"


def error_columns(found: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, np.ndarray]:
    """Columns of both errors of each method; ``found`` maps methods to (degrees, relative translation)."""
    pairs = [((method, ROTATION), angle) for method, (angle, _) in found.items()]
    pairs += [((method, TRANSLATION), shift) for method, (_, shift) in found.items()]
    return {column(*key): values for key, values in pairs}


def described(rows: polars.DataFrame, method: str) -> dict[str, float]:
    """A method's errors over the draws of a cell: the report's RMS of both, in degrees too, and the medians."""
    angle = rows[column(method, ROTATION)].to_numpy()
    shift = rows[column(method, TRANSLATION)].to_numpy()
    return {
        "rotation_rms": float(root_mean_square(quaternion_error(angle))),
        "rotation_rms_deg": float(root_mean_square(angle)),
        "rotation_median_deg": float(np.median(angle)),
        "translation_rms": float(root_mean_square(shift)),
        "translation_median": float(np.median(shift)),
    }


def tested(claim: Claim, cells: Sequence[polars.DataFrame], resamples: int, seed: int) -> dict[str, Any]:
    """One claim over cells that share their number of draws: both ratios better / worse, intervals and verdicts."""
    errors = [
        np.stack([np.maximum(cell[column(method, claim.quantity)].to_numpy(), _LEAST) for cell in cells])
        for method in (claim.better, claim.worse)
    ]
    rms = _ratio_of_rms(errors[0], errors[1], resamples, seed, claim.margin)
    per_draw = np.mean(np.log(errors[0] / errors[1]), axis=0)
    reach = Z95 * float(np.std(per_draw, ddof=1)) / np.sqrt(len(per_draw)) if len(per_draw) > 1 else np.inf
    middle = float(np.mean(per_draw))
    typical = _estimate(np.exp(middle), np.exp(middle - reach), np.exp(middle + reach), claim.margin)
    return {**claim._asdict(), "draws": len(per_draw), "levels": len(cells), "rms": rms, "typical": typical}


def _ratio_of_rms(
    one: Float[np.ndarray, "l n"], other: Float[np.ndarray, "l n"], resamples: int, seed: int, margin: float
) -> dict[str, Any]:
    """Geometric mean over levels of the ratio of RMS; draws are resampled, the same for both methods."""
    n = one.shape[1]
    times = np.random.default_rng([seed, n]).multinomial(n, np.full(n, 1 / n), size=resamples).astype(float)
    with np.errstate(divide="ignore", invalid="ignore"):
        drawn = np.exp(np.mean(0.5 * np.log((times @ one.T**2) / (times @ other.T**2)), axis=1))
        value = np.exp(np.mean(0.5 * np.log(np.sum(one**2, axis=1) / np.sum(other**2, axis=1))))
    low, high = np.quantile(drawn, [0.025, 0.975]) if n > 1 else (0.0, np.inf)
    return _estimate(value, low, high, margin)


def _estimate(value: float, low: float, high: float, margin: float) -> dict[str, Any]:
    verdict = "confirmed" if high < margin else "contradicted" if low > margin else "undecided"
    return {"value": float(value), "low": float(low), "high": float(high), "verdict": verdict}


def shown(estimate: Mapping[str, Any]) -> str:
    """``0.8234 (0.8041 to 0.8422) confirmed``."""
    numbers = [estimate[key] for key in ("value", "low", "high")]
    if any(number is None for number in numbers):
        return "undecided"
    value, low, high = (f"{number:.4g}" for number in numbers)
    return f"{value} ({low} to {high}) {estimate['verdict']}"


def tested_twice(
    claim: Claim, cells: Sequence[polars.DataFrame], report_draws: int, resamples: int, seed: int
) -> dict[str, Any]:
    """As ``tested``, with the verdicts on the first ``report_draws`` draws alone under ``report``."""
    first = [cell.filter(polars.col("draw") < report_draws) for cell in cells]
    return {**tested(claim, cells, resamples, seed), "report": tested(claim, first, resamples, seed)}


def claims_table(found: Sequence[Mapping[str, Any]], command: str) -> Table:
    """Every tested claim: what the report says, and both ratios with their verdicts."""
    rows = [
        (
            claim["says"],
            "rotation" if claim["quantity"] == ROTATION else "translation",
            f"{claim['better']} / {claim['worse']}",
            f"{claim['draws']} x {claim['levels']}",
            shown(claim["rms"]),
            shown(claim["typical"]),
            _first_draws(claim),
        )
        for claim in found
    ]
    columns = ("published", "error of", "ratio", "draws x levels", "ours: RMS", "ours: typical draw",
               "the report's number of draws alone: RMS, typical")  # fmt: skip
    return Table(f"Published | ours: claims, below 1 is as claimed, 95 % intervals | {command}", columns, rows)


def _first_draws(claim: Mapping[str, Any]) -> str:
    if "report" not in claim:
        return ""
    first = claim["report"]
    return f"{first['draws']}: {first['rms']['verdict']}, {first['typical']['verdict']}"


class Statement(NamedTuple):
    """What the report says that is no ratio of two errors, and what was measured of it."""

    says: str
    ours: str
    confirmed: bool

    @property
    def row(self) -> dict[str, str]:
        """As it stands in a summary."""
        return {"says": self.says, "ours": self.ours, "verdict": "confirmed" if self.confirmed else "contradicted"}


def statements_table(found: Sequence[Mapping[str, str]], command: str) -> Table:
    """Every other statement of the report, beside ours."""
    rows = [(of["says"], of["ours"], of["verdict"]) for of in found]
    return Table(f"Published | ours: other statements | {command}", ("published", "ours", "verdict"), rows)
