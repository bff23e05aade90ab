"""Claims put to the test: verdicts follow the draws, and the two measures may disagree."""

import numpy as np
import polars
import pytest

from jaxmodel.run.hand_eye import claims
from jaxmodel.run.hand_eye.protocol import agreement

CLAIM = claims.Claim("a is better", claims.ROTATION, "a", "b")


def cell(a: np.ndarray, b: np.ndarray) -> polars.DataFrame:
    ones = np.ones(len(a))
    return polars.DataFrame({**claims.error_columns({"a": (a, ones), "b": (b, ones)}), "draw": np.arange(len(a))})


def test_a_ratio_is_found_with_its_interval_and_verdict() -> None:
    errors = np.exp(np.random.default_rng(0).normal(size=(2, 2000)))
    for factor, verdict in ((0.5, "confirmed"), (2.0, "contradicted")):
        found = claims.tested(CLAIM, [cell(factor * errors[0], errors[1])] * 2, 200, 0)
        for measure in ("rms", "typical"):
            assert found[measure]["low"] < factor < found[measure]["high"]
            assert found[measure]["verdict"] == verdict
    assert claims.tested(CLAIM, [cell(errors[0], errors[0])], 200, 0)["typical"]["verdict"] == "undecided"


def test_one_bad_draw_decides_the_rms_and_not_the_typical_ratio() -> None:
    b = np.ones(1000)
    a = np.full(1000, 0.5)
    a[:10] = 1000.0
    found = claims.tested(CLAIM, [cell(a, b)], 200, 0)
    assert found["rms"]["verdict"] == "contradicted" and found["typical"]["verdict"] == "confirmed"


def test_the_first_draws_have_verdicts_of_their_own() -> None:
    a, b = np.full(200, 0.5), np.ones(200)
    a[:50] = 2.0
    found = claims.tested_twice(CLAIM, [cell(a, b)], 50, 200, 0)
    assert found["typical"]["verdict"] == "confirmed" and found["report"]["typical"]["verdict"] == "contradicted"
    row = claims.claims_table([found], "the command").rows[0]
    assert row[-1] == "50: contradicted, contradicted" and row[3] == "200 x 1"


def test_the_described_rms_is_that_of_the_reports_measure() -> None:
    of = claims.described(cell(np.array([5.0, 10.0]), np.ones(2)), "a")
    expected = np.sqrt((1.9036e-3**2 + 7.6106e-3**2) / 2)  # Table 3.2
    assert of["rotation_rms"] == pytest.approx(expected, rel=1e-4) and of["rotation_median_deg"] == 7.5


def test_no_worse_is_a_ratio_below_a_tenth_more() -> None:
    errors = np.exp(np.random.default_rng(1).normal(size=2000))
    for factor, verdict in ((1.05, "confirmed"), (1.2, "contradicted")):
        found = claims.tested(CLAIM._replace(margin=claims.NO_WORSE), [cell(factor * errors, errors)], 200, 0)
        assert found["rms"]["verdict"] == found["typical"]["verdict"] == verdict
        assert claims.tested(CLAIM, [cell(factor * errors, errors)], 200, 0)["typical"]["verdict"] == "contradicted"


def test_a_published_value_is_placed_beside_ours() -> None:
    ours = {"value": 2.0, "low": 1.0, "high": 4.0}
    placed = [agreement(value, ours)[2] for value in (0.5, 1.0, 3.0, 5.0, None)]
    assert placed == ["below ours", "in our 90 %", "in our 90 %", "above ours", ""]
    assert agreement(0.5, ours)[:2] == ("0.5", "2 (1 to 4)")
