"""Unfair comparisons are found and shown."""

from typing import Any

from jaxmodel.run.faults import fault_tables, unequal_counts, without_any


def entry(kind: str, target: int, source: int = 100, pair: str = "a", variant: str = "") -> dict[str, Any]:
    return {
        "pair": pair,
        "variant": variant,
        "control_points": kind,
        "points": {"target": target, "source": source},
        "note": "no edge",
    }


def test_five_percent_is_the_limit() -> None:
    assert unequal_counts([entry("contours", 100), entry("vertices", 105)]) == []
    assert unequal_counts([entry("contours", 100), entry("vertices", 95)]) == []
    (sentence,) = unequal_counts([entry("contours", 100), entry("vertices", 106)])
    assert sentence == "a, target: 100 contours and 106 vertices"
    assert unequal_counts([entry("contours", 100, 50), entry("vertices", 100, 60)]) == [
        "a, source: 50 contours and 60 vertices"
    ]


def test_only_kinds_of_the_same_pair_and_variant_are_compared() -> None:
    assert unequal_counts([entry("contours", 100), entry("vertices", 200, pair="b")]) == []
    assert unequal_counts([entry("contours", 100, variant="H"), entry("vertices", 200, variant="L")]) == []
    three = [entry("contours", 100), entry("vertices", 100), entry("subsample", 200)]
    assert len(unequal_counts(three)) == 2


def test_missing_kinds_are_named_and_not_compared() -> None:
    costs = [entry("contours", 0, 0, variant="H"), entry("vertices", 200, variant="H")]
    assert unequal_counts(costs) == [] and without_any(costs) == ["a H: no contours (no edge)"]


def test_tables_only_where_there_are_faults() -> None:
    assert fault_tables({}) == fault_tables({"unequal": [], "missing": []}) == []
    (table,) = fault_tables({"unequal": [f"pair {i}" for i in range(30)]})
    assert len(table.rows) == 21 and table.rows[-1] == ("and 10 more, see summary.json",)
