"""Two kinds compared on made-up rows whose answer is known."""

from typing import Any

import numpy as np
import polars
import pytest

from jaxmodel.run.chapter2.comparison import (
    FIGURES,
    by_family,
    chart,
    columns,
    compare,
    family_tables,
    lines,
    text,
    verdict,
)

RATE, EITHER, ROTATION, TRANSLATION, STEPS, SECONDS = FIGURES


def rows(right: dict[str, np.ndarray], pairs: int, starts: int, family: str = "structured") -> polars.DataFrame:
    """One trial a pair; contours err by 0.5° in 10 steps, vertices by 1.5° in 30, plus a little."""
    parts = []
    for kind, is_right in right.items():
        n, better = pairs * starts, kind == "contours"
        small = np.random.default_rng(0).uniform(0, 0.1, n)
        parts.append(
            polars.DataFrame(
                {
                    "trial": np.repeat(np.arange(pairs), starts),
                    "pair": np.repeat([f"p{i}" for i in range(pairs)], starts),
                    "family": [family] * n,
                    "control_points": [kind] * n,
                    "start": np.tile(np.arange(starts), pairs),
                    "right": is_right,
                    "rotation_error_deg": np.where(is_right, (0.5 if better else 1.5) + small, 90.0),
                    "translation_error_of_size": np.where(is_right, 0.001 + small, 1.0),
                    "steps": np.where(is_right, 10 if better else 30, 300),
                }
            )
        )
    return polars.concat(parts)


def costs(pairs: int) -> list[dict[str, Any]]:
    return [
        {
            "trial": i,
            "control_points": kind,
            "points": {"target": 100, "source": 100},
            "extraction": 0.2 if kind == "contours" else 1.0,
            "table": 0.05,
            "registration": 0.01,
        }
        for i in range(pairs)
        for kind in ("contours", "vertices")
    ]


@pytest.fixture
def compared() -> dict[str, Any]:
    """Ten pairs of four starts: contours all right, vertices the first two of each; one start neither."""
    contours, vertices = np.ones(40, bool), np.tile([True, True, False, False], 10)
    contours[3::4] = False
    found = compare(rows({"contours": contours, "vertices": vertices}, 10, 4), costs(10), resamples=200)
    assert found is not None
    return found


def test_both_ways_of_counting(compared: dict[str, Any]) -> None:
    figures = compared["figures"]
    assert (compared["tests"], compared["pairs"], compared["both_right"]) == (40, 10, 20)
    assert figures["rate"]["contours"]["value"] == 0.75 and figures["rate"]["vertices"]["value"] == 0.5
    assert figures["rate_either"]["contours"]["value"] == 1.0  # the start where neither converged is left out
    assert figures["rate_either"]["vertices"]["value"] == pytest.approx(2 / 3)
    assert figures["rate"]["difference"]["value"] == pytest.approx(0.25)


def test_errors_and_steps_are_of_tests_where_both_are_right(compared: dict[str, Any]) -> None:
    figures = compared["figures"]
    assert 0.5 < figures["rotation_error_deg"]["contours"]["value"] < 0.6
    assert figures["rotation_error_deg"]["difference"]["value"] == pytest.approx(-1.0)
    assert figures["steps"]["contours"]["value"] == 10 and figures["steps"]["vertices"]["value"] == 30
    assert figures["rotation_error_deg"]["contours"]["count"] == 20
    assert figures["seconds"]["contours"]["value"] == pytest.approx(0.26)


def test_verdicts_follow_the_interval_of_the_difference(compared: dict[str, Any]) -> None:
    assert [verdict(compared, figure) for figure in (RATE, ROTATION, STEPS, SECONDS)] == ["contours"] * 4
    assert verdict(compared, TRANSLATION) == "undecided"  # the same values
    swapped = {**compared, "kinds": ["vertices", "contours"]}
    assert verdict(swapped, RATE) == "vertices"  # the sign alone decides


def test_kinds_that_never_meet_cannot_be_compared() -> None:
    table = rows({"contours": np.ones(4, bool)}, 2, 2)
    assert compare(table, []) is None
    assert by_family(table, []) == {} and family_tables({}) == []


def test_a_kind_without_points_costs_no_time() -> None:
    free = costs(10)
    free[0] = {**free[0], "points": {"target": 0, "source": 0}, "extraction": 0.0}
    right = {"contours": np.ones(20, bool), "vertices": np.ones(20, bool)}
    found = compare(rows(right, 10, 2), free, resamples=200)
    assert found is not None and found["figures"]["seconds"]["contours"]["count"] == 9


def test_families_are_kept_apart() -> None:
    right = {"contours": np.ones(10, bool), "vertices": np.zeros(10, bool)}
    other = rows({kind: ~is_right for kind, is_right in right.items()}, 5, 2, "free_form")
    both = polars.concat([rows(right, 5, 2), other.with_columns(polars.col("trial") + 5)])
    found = by_family(both, [], resamples=200)
    assert verdict(found["structured"], RATE) == "contours" and verdict(found["free_form"], RATE) == "vertices"
    (table,) = family_tables(found)
    assert len(table.rows) == 2 * len(FIGURES) and all(len(row) == len(table.columns) for row in table.rows)
    drawn = chart("c", "C", found)
    assert len(drawn.panels) == len(FIGURES) and drawn.panels[0].series[0].y == [100.0, 0.0]


def test_lines_fit_their_columns_and_say_nothing_where_there_is_nothing(compared: dict[str, Any]) -> None:
    assert all(len(line) == len(columns(compared)) for line in lines("x", compared))
    assert text({"value": None, "low": None, "high": None}, RATE) == "none"
    assert text({"value": 0.5, "low": None, "high": None}, RATE) == "50 %"
    assert text({"value": 0.0, "low": 0.0, "high": 0.25}, RATE) == "0 [0, 25] %"
    assert text({"value": 0.123, "low": 0.1, "high": 0.15}, ROTATION, signed=True) == "+0.12 [+0.10, +0.15]°"
